"""An autopilot's parameters are as they were after every end, whoever and wherever it is."""

import itertools
import json
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from iolspi_ros.bench.flying import Flying
from iolspi_ros.errors import InputError
from msg_bridge.mavlink.memory import Identity, Memory, Remembered
from msg_bridge.mavlink.preflight import Preflight
from msg_bridge.mavlink.settings import LinkSettings
from sim_nodes.autopilot import firmware

LIKES = ["px4", "ardupilot"]
FOLDERS = itertools.count()


def values(flying):
    own = flying.autopilot.parameters
    return {name: own[name] for name in own.names if not name.startswith("SIM_")}


def another(flying, url="udpin:127.0.0.1:14540", going_on=lambda: True, **settings):
    """Another bridge's preflight, of the same vehicle and the same memory."""
    link = LinkSettings(url=url, patience=5.0, **settings)
    folder = flying.log.parent
    said = flying.checklist.append
    return Preflight(flying.link, link, flying.settings, flying.clock,
                     Memory(folder / "memory", folder), said, going_on)  # fmt: skip


@pytest.fixture
def vehicle(tmp_path):
    """Make one that no bridge has met; its world lives, and nothing flies."""
    opened = []

    def make(like, **options):
        folder = tmp_path / f"{next(FOLDERS)}"
        folder.mkdir()
        flying = Flying(folder, like, **options)
        flying.world.open()
        opened.append(flying)
        return flying

    yield make
    for flying in opened:
        flying.world.close()


@pytest.mark.parametrize("like", LIKES)
@pytest.mark.parametrize("fails", ["load", "clock", "gripper"])
def test_after_a_preflight_that_failed(vehicle, like, fails):
    f = vehicle(like, autopilot={"load": {"SIM_LOAD_RATE": 0.0}, "clock": {"SIM_SPEEDUP": 2.0},
                                 "gripper": {"SIM_GRIP_FAIL": 1}}[fails])  # fmt: skip
    before, preflight = values(f), another(f)
    with pytest.raises(InputError):
        preflight.run()
    assert values(f) != before
    assert not preflight.restore()
    assert values(f) == before
    assert not list(f.log.parent.glob("memory/*"))


@pytest.mark.parametrize("like", LIKES)
@pytest.mark.parametrize("looks", [1, 5, 20, 60, 120, 250, 400])
def test_after_an_interrupt_at_any_moment_of_the_preflight(vehicle, like, looks):
    f = vehicle(like)
    left = itertools.count(looks, -1)
    before, preflight = values(f), another(f, going_on=lambda: next(left) > 0)
    with pytest.raises(InputError, match="interrupted"):
        preflight.run()
    assert not preflight.restore()
    assert values(f) == before


@pytest.mark.parametrize("like", LIKES)
@pytest.mark.parametrize("uid", [0, 77])
def test_after_a_kill_the_next_run_by_another_url_gives_them_back(vehicle, like, uid):
    f = vehicle(like, autopilot={"SIM_UID": uid})
    before = values(f)
    another(f).run()
    later = another(f, url="udpin:127.0.0.1:14550")
    later.run()
    assert not later.restore()
    assert values(f) == before


def test_a_vehicle_that_tells_its_number_is_not_taken_for_another(vehicle, tmp_path):
    """Both have system 1, and were met at the same URL: what one lent is not the other's."""
    memory = Memory(tmp_path, tmp_path)
    for uid, value in ((5, 0.7), (6, 0.9)):
        f = vehicle("px4", autopilot={"SIM_UID": uid, "COM_OF_LOSS_T": value})
        f.log = tmp_path / "flight.tlog"
        another(f).run()
    remembered = {about.uid: kept.before["COM_OF_LOSS_T"]
                  for about, kept in Memory(tmp_path / "memory").all()}  # fmt: skip
    assert remembered == {"05": pytest.approx(0.7), "06": pytest.approx(0.9)}
    assert memory.all() == []


@pytest.mark.parametrize("first", [True, False])
def test_a_number_that_is_told_only_in_one_of_two_runs_loses_nothing(vehicle, first):
    f = vehicle("px4", autopilot={"SIM_UID": 77})
    before, take = values(f), f.telemetry.take
    told = [first]
    f.telemetry.take = lambda message, now: (
        True if message.get_type() == "AUTOPILOT_VERSION" and not told[0] else take(message, now)
    )
    another(f).run()  # and is killed
    told[0], f.telemetry.uid = not first, None
    preflight = another(f)
    preflight.run()
    assert preflight.restore() == []
    assert values(f) == before
    assert Memory(f.log.parent / "memory").all() == []


@pytest.mark.parametrize("taken", [0.6, 1.0])
def test_what_the_autopilot_took_instead_is_given_back(vehicle, taken):
    """It may have limits of its own; that it is not what was asked for ends the preflight."""
    f = vehicle("px4")
    before, change = values(f), f.autopilot.change
    f.autopilot.change = lambda name, value: change(
        name, max(value, taken) if name == "COM_OF_LOSS_T" and value == 0.5 else value
    )
    preflight = another(f)
    with pytest.raises(InputError, match="COM_OF_LOSS_T of px4 cannot be set"):
        preflight.run()
    assert preflight.restore() == []
    assert values(f) == before


def test_who_else_is_on_board_does_not_speak_for_the_autopilot(vehicle):
    f = vehicle("px4", autopilot={"SIM_UID": 77})
    gimbal = dialect.MAVLink_autopilot_version_message(0, 0, 0, 0, 0, [], [], [], 0, 0, 999)
    gimbal._header = dialect.MAVLink_header(148, srcSystem=1, srcComponent=154)
    f.telemetry.take(gimbal, f.clock.now())
    assert f.telemetry.uid is None
    another(f).run()
    assert [who.uid for who, _ in Memory(f.log.parent / "memory").all()] == ["4d"]


def test_nothing_is_changed_that_cannot_be_written_down(vehicle):
    f = vehicle("px4")
    before = values(f)
    (f.log.parent / "memory").write_text("a file where the folder should be")
    with pytest.raises(InputError, match="nothing is changed without that"):
        another(f).run()
    assert values(f) == before


PX4 = {"autopilot": "px4", "system": 1, "uid": ""}


@pytest.mark.parametrize("about", [None, "px4", {}, PX4 | {"system": "one"}, PX4 | {"more": 1}])
def test_a_file_about_nobody_hides_no_other(tmp_path, about):
    memory = Memory(tmp_path, tmp_path)
    kept = Remembered({"A": 1.0}, {"A": 2.0})
    memory.keep(Identity("px4", 1, "07"), "udpin:127.0.0.1:14540", kept)
    path = tmp_path / "px4_3.json"
    path.write_text((tmp_path / "px4_1_07.json").read_text())
    path.write_text(json.dumps(json.loads(path.read_text()) | {"vehicle": about}))
    assert [vehicle for vehicle, _ in memory.all()] == [Identity("px4", 1, "07")]
    assert memory.damaged() == [path]


def test_what_somebody_else_has_set_since_is_left(vehicle):
    f = vehicle("px4")
    another(f).run()
    f.change("COM_OF_LOSS_T", 3.0)
    preflight = another(f)
    preflight.find()
    said = []
    assert not preflight.restore(said.append)
    assert f.autopilot.parameters["COM_OF_LOSS_T"] == 3.0
    assert f.autopilot.parameters["COM_OBL_RC_ACT"] == 0
    assert any("COM_OF_LOSS_T is 3, which no bridge has set: left" in text for text in said)


def test_what_cannot_be_given_back_stays_remembered(vehicle):
    f = vehicle("px4")
    preflight = another(f)
    preflight.run()
    f.change("SIM_CUT", 60.0)
    failed = preflight.restore()
    assert "COM_OF_LOSS_T" in failed[0]
    assert "(it was 1)" in failed[0]
    assert "COM_OBL_RC_ACT was 0" in failed[1]
    f.change("SIM_CUT", 0.0)
    assert not preflight.restore()
    assert f.autopilot.parameters["COM_OF_LOSS_T"] == 1.0


def test_what_an_older_version_left_by_url_is_taken_over_and_cleaned(vehicle):
    f = vehicle("px4", autopilot={"COM_OF_LOSS_T": 0.5, "COM_OBL_RC_ACT": 5})
    old = f.log.parent / "before_udpin_127.0.0.1_14540_1.json"
    old.write_text(json.dumps({"COM_OF_LOSS_T": 1.25, "COM_OBL_RC_ACT": 2.0}))
    preflight = another(f)
    preflight.run()
    assert not old.exists()
    assert not preflight.restore()
    assert f.autopilot.parameters["COM_OF_LOSS_T"] == 1.25
    assert f.autopilot.parameters["COM_OBL_RC_ACT"] == 2


def test_a_memory_that_is_broken_is_as_good_as_none(tmp_path):
    memory, vehicle = Memory(tmp_path, tmp_path), Identity("px4", 1)
    memory.keep(vehicle, "udpin:a:1", Remembered({"A": 1.0}, {"A": 2.0}))
    assert memory.of(vehicle).before == {"A": 1.0}
    for content in ("", "[]", "{}", '{"before": 3}', '{"before": {"A": "x"}, "changed": {}}'):
        (tmp_path / "px4_1.json").write_text(content)
        assert memory.of(vehicle).before == {}
        assert memory.all() == []


@pytest.mark.parametrize("name", ["PSC_JERK_XY", "PSC_JERK_NE", "PSC_NE_JERK"])
def test_a_parameter_goes_by_the_name_that_this_version_answers(vehicle, monkeypatch, name):
    older = firmware.ARDUPILOT
    renamed = {name if key == "PSC_JERK_XY" else key: value
               for key, value in older.parameters.items()}  # fmt: skip
    monkeypatch.setitem(firmware.FIRMWARES, "ardupilot", replace(older, parameters=renamed))
    f = vehicle("ardupilot")
    preflight = another(f)
    preflight.run()
    assert f.autopilot.parameters[name] == 20.0
    assert name in [item.name for item in f.checklist]
    assert not preflight.restore()
    assert f.autopilot.parameters[name] == 5.0


@pytest.mark.parametrize(("like", "other"), [("px4", "ardupilot"), ("ardupilot", "px4")])
def test_the_wrong_autopilot_is_named_before_it_is_told_anything(vehicle, like, other):
    f = vehicle(like)
    sent, send = [], f.link.send
    f.link.send = lambda message: sent.append(message.get_type()) or send(message)
    with pytest.raises(InputError, match=f"is {like}, not {other}; allowed: --autopilot {like}"):
        another(f, autopilot=other).run()
    assert set(sent) <= {"HEARTBEAT", "TIMESYNC"}
