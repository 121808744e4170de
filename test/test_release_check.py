"""Whether something falls is looked at before the flight, and watched in it."""

import pytest

from iolspi_ros.bench.flying import Flying
from iolspi_ros.errors import InputError
from msg_bridge.mavlink.payload import Seen
from sim_nodes.autopilot.firmware import WITH_GRIPPER

LIKES = ["px4", "ardupilot"]


def looked(tmp_path, like, before=lambda flying: None, **options):
    """The line of the checklist, and the vehicle."""
    flying = Flying(tmp_path, like, **options)
    flying.world.open()
    try:
        before(flying)
        flying.preflight.run()
        return next(item.found for item in flying.checklist if item.name == "release"), flying
    finally:
        flying.world.close()


@pytest.mark.parametrize(
    ("like", "lacking"),
    [("px4", "PD_GRIPPER_EN"), ("ardupilot", "GRIP_ENABLE"), ("ardupilot", "GRIP_TYPE"),
     ("ardupilot", "SERVO9_FUNCTION")],
)  # fmt: skip
def test_what_is_missing_is_named_with_what_to_do(tmp_path, like, lacking):
    need = f"set {lacking}.* to {WITH_GRIPPER[like][lacking]}, and restart"
    with pytest.raises(InputError, match=need):
        looked(tmp_path, like, autopilot={lacking: 0})


@pytest.mark.parametrize(
    ("like", "why"),
    [("px4", "does not answer: with PD_GRIPPER_EN 1 it wants to be restarted"),
     ("ardupilot", "on output 9 of ardupilot says yes and does not move; restart")],
)  # fmt: skip
def test_parameters_set_since_the_boot_are_not_enough(tmp_path, like, why):
    def now(flying):
        for name, value in WITH_GRIPPER[like].items():
            flying.change(name, value)

    with pytest.raises(InputError, match=why):
        looked(tmp_path, like, now, autopilot=dict.fromkeys(WITH_GRIPPER[like], 0))


@pytest.mark.parametrize("like", LIKES)
def test_one_that_refuses_is_said(tmp_path, like):
    with pytest.raises(InputError, match="refused: MAV_RESULT_FAILED; nothing would fall"):
        looked(tmp_path, like, autopilot={"SIM_GRIP_FAIL": 1})


def test_a_release_is_proven_on_the_ground_where_its_output_moves(tmp_path):
    found, flying = looked(tmp_path, "ardupilot")
    assert found.startswith("gripper on output 9 went from 1500 to 1100 µs and back")
    assert flying.autopilot.body.attached
    found, _ = looked(tmp_path, "ardupilot", release="servo", servo=9)
    assert found.startswith("servo on output 9 went from 1500 to 1100 µs and back")


def test_what_cannot_be_seen_is_unproven(tmp_path):
    found, _ = looked(tmp_path, "px4")
    assert found == (
        "unproven yet: gripper on output 5 says yes, and moves when armed; it is watched in flight"
    )
    found, _ = looked(tmp_path, "px4", autopilot={"PWM_MAIN_FUNC5": 0})
    assert found.startswith("unproven: gripper says yes, and is on no output that could be seen")
    assert "PWM_MAIN_FUNC5 430" in found
    found, _ = looked(tmp_path, "px4", release="actuator")
    assert found.startswith("unproven: actuator says yes")


def test_it_is_not_tried_against_somebodys_wish(tmp_path):
    found, flying = looked(tmp_path, "ardupilot", test_release=False)
    assert found.startswith("unproven: gripper on output 9 is not tried")
    assert flying.autopilot.release.servos[9 - 5] == 1500


@pytest.mark.parametrize(
    ("like", "options", "seen"),
    [
        ("ardupilot", {}, Seen.FALL),
        ("ardupilot", {"load_source": "estimate"}, Seen.OUTPUT),
        ("px4", {"load_source": "estimate"}, Seen.OUTPUT),
        ("px4", {"load_source": "estimate", "autopilot": {"PWM_MAIN_FUNC5": 0}}, Seen.ACKNOWLEDGED),
    ],
)
def test_what_was_measured_is_told_from_what_was_assumed(tmp_path, like, options, seen):
    # Where the estimate strays, some episodes end without a release.
    options = {"autopilot": {}, **options}
    options["autopilot"] = {"SIM_WANDER": 0.0, **options["autopilot"]}
    with Flying(tmp_path, like, initial="narrow", **options) as f:
        f.episodes(2)
        assert f.flight.status()["releases"] == {str(seen): 2}


def test_an_output_that_stays_still_in_flight_is_no_release(tmp_path):
    with Flying(tmp_path, "px4", initial="narrow", load_source="estimate") as f:
        f.in_air()
        f.change("PWM_MAIN_FUNC5", 0)
        f.until(lambda: f.heard("says the gripper, but output 5 was not seen to move"))
        assert f.ends == []
        assert f.flight.status()["releases"] == {str(Seen.FAILED): 1}


@pytest.mark.parametrize("how", ["servo", "actuator"])
def test_what_it_is_let_go_by_has_limits_of_its_own(tmp_path, how):
    with pytest.raises(InputError, match=f"{how}_open is 2[0-9.]+; allowed"):
        Flying(tmp_path, "px4", **{f"{how}_open": {"servo": 2600.0, "actuator": 2.0}[how]})
