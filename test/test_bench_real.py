"""`iolspi bench bridge --real`: what it refuses, flies, kills and prints."""

import json

import pytest

from iolspi_ros.bench import real
from iolspi_ros.bench.real import Kill
from iolspi_ros.cli import bench
from iolspi_ros.errors import InputError
from msg_bridge.mavlink.envelope import Limits
from sim_nodes.autopilot.firmware import WITH_GRIPPER
from sim_nodes.autopilot.server import Sitl

URL = "udpin:127.0.0.1:14999"


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ({"subjects": None}, "--real goes with one subject"),
        ({"subjects": ["bridge", "speed"]}, "--real goes with one subject"),
        ({"autopilot": None}, "--autopilot is ''; allowed: px4, ardupilot"),
        ({"autopilot": "betaflight"}, "--autopilot is 'betaflight'; allowed: px4"),
        ({"autopilot": "paparazzi"}, "cannot be flown over MAVLink"),
        ({"it_is_a_simulator": False}, "allowed with --it-is-a-simulator"),
        ({"real": "udpin:0.0.0.0:14540"}, "allowed: udpin:127.0.0.1:14540"),
        ({"speed_up": 99.0}, "--speed-up is 99"),
        ({"bridge": ["system"]}, "allowed: NAME=VALUE"),
        ({"real": None}, "--autopilot and --bridge go with --real"),
    ],
)
def test_what_it_refuses_before_anything_is_heard(given, why):
    options = {"subjects": ["bridge"], "real": URL, "autopilot": "px4",
               "it_is_a_simulator": True} | given  # fmt: skip
    with pytest.raises(InputError, match=why):
        bench.bench(**options)


def test_each_flight_is_one_of_iolspi_fly_with_a_seed_of_its_own(monkeypatch, tmp_path):
    asked = []
    monkeypatch.setattr(real, "rows", lambda *given: asked.append(given) or [])
    monkeypatch.chdir(tmp_path)
    bench.bench(subjects=["bridge"], real=URL, autopilot="px4", speed_up=4.0,
                bridge=["system=3"], flights=2, kills=5, it_is_a_simulator=True)  # fmt: skip
    ((commands, values, kills, folder, _),) = asked
    shared = ["--autopilot", "px4", "--url", URL, "--load", "estimate", "--speed-up", "4.0",
              "--bridge", "system=3", "--seed"]  # fmt: skip
    assert commands == [[*shared, "0"], [*shared, "1"]]
    assert kills == 5
    assert (values["url"], values["system"], values["real_time_factor"]) == (URL, 3, 4.0)
    assert values["load_source"] == "estimate"
    assert folder.is_dir()


def summary(status=0, successes=20, episodes=23, crashes=0, **more):
    seen = {"the output was seen to move": 20, "nothing was seen": 3}
    return {"autopilot": "px4", "status": status, "seconds": 300.0, "releases": str(seen),
            "flown_episodes": episodes, "flown_successes": successes, "flown_crashes": crashes,
            "episodes_abandoned": "2", "envelope_left": "1"} | more  # fmt: skip


def test_flights_are_counted_also_those_that_left_nothing():
    found = real.of_flights("px4", [summary(), summary(2, 10, 12, 1, seconds=60.0),
                                    {"status": 2, "seconds": 1.0}])  # fmt: skip
    rows = {row.name.split(": ", 1)[1]: row for row in found}
    assert rows["ended as planned"].value == pytest.approx(1 / 3)
    assert rows["dunks"].value == pytest.approx(30 / 35)
    assert rows["dunks"].holds
    assert rows["dunks of the worst flight"].value == 0.0
    assert rows["releases that were seen"].value == pytest.approx(40 / 46)
    assert (rows["crashes"].value, rows["crashes"].holds) == (1.0, False)
    assert rows["envelope left"].value == 2.0
    assert rows["broken off"].value == 4.0
    assert rows["took, the longest"].value == 5.0
    assert all("3 flights, 35 episodes" in row.name for row in found)


def test_the_nearest_wall_counts_on_either_side():
    """Walls at -6.5 and 3: 0.5 m are left on one side, and none on the other."""
    kills = [Kill(-5.0, -1.0, -6.0, -5.0), Kill(1.0, 2.5, 1.0, 3.2), Kill(-2.0, 0.0, -2.1, -1.8)]
    rows = {r.name.split(": ", 1)[1]: r for r in real.of_kills("px4", kills, Limits())}
    least = rows["least distance to a wall"]
    assert (least.value, least.holds) == (pytest.approx(-0.2), False)
    assert rows["the same, median"].value == pytest.approx(0.5)
    assert rows["longest way to rest"].value == pytest.approx(2.2)
    assert rows["fastest"].value == 2.5


def values(url, **more):
    given = {"url": url, "autopilot": "px4", "system": 1, "load_source": "estimate",
             "real_time_factor": 8.0, "action_timeout": 0.5, "telemetry_timeout": 1.0,
             "round_trip_limit": 2.0}  # fmt: skip
    return given | more


def test_whom_nobody_flies_is_watched_and_who_is_silent_is_named():
    with Sitl("px4", ["udpin:127.0.0.1:0"], {"SIM_SPEEDUP": 8.0}) as sitl:
        there = f"udpout:127.0.0.1:{sitl.addresses[0][1]}"
        seen = real.watch(values(there))
        assert max(abs(seen.least), abs(seen.most)) < 0.6  # on the ground, where it stands
        assert sitl.autopilot.commander.ground_station_seen < 0.0
    with pytest.raises(InputError, match="nothing is heard of the vehicle"):
        real.watch(values(there))


@pytest.mark.slow
def test_bridges_are_killed_and_the_last_one_lands_and_gives_back(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    booted = {"SIM_SPEEDUP": 8.0, "SIM_UID": 7} | WITH_GRIPPER["px4"]
    with Sitl("px4", ["udpin:127.0.0.1:0"], booted, ready_after=2.0) as sitl:
        there = values(f"udpout:127.0.0.1:{sitl.addresses[0][1]}")
        done = []
        rows = real.rows([], there, 2, tmp_path, done.append)
        assert not sitl.autopilot.commander.armed
    found = {row.name: row for row in rows}
    assert done == [1, 2]
    assert found["px4, bridge killed 2 times: least distance to a wall"].holds
    assert found["px4: parameters left changed"].value == 0.0
    assert len(json.loads((tmp_path / "kills.json").read_text())) == 2
    assert not list((tmp_path / "state").rglob("*.json"))
