"""`iolspi fly`, from its plan to its report, on the embedded autopilot."""

import json
import os
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import psutil
import pytest

from iolspi_ros.cli import flight_plan, flight_report
from iolspi_ros.cli.flight import Flown, Warnings
from iolspi_ros.cli.flight_plan import describe, make_plan
from iolspi_ros.core.learner import greedy_policy
from iolspi_ros.errors import InputError
from iolspi_ros.experiments.headless import prepare
from iolspi_ros.saving import checkpoint
from msg_bridge.mavlink import flown
from msg_bridge.mavlink.memory import Identity, Memory, Remembered
from msg_bridge.mavlink.payload import Seen
from msg_bridge.mavlink.profiles import PROFILES
from sim_nodes.autopilot.firmware import Mode
from sim_nodes.autopilot.server import Sitl
from sim_nodes.tasks.slung_load import SlungLoad
from sim_nodes.tasks.slung_load.as_flown import AsFlown

CHANGES = {"px4": ("COM_OF_LOSS_T", "COM_OBL_RC_ACT"), "ardupilot": ("GUID_TIMEOUT", "PSC_JERK_XY")}

RESTING = {"SIM_UID": 7, "COM_OF_LOSS_T": 0.5, "COM_DISARM_PRFLT": 0.0}
"""Parameters of one that a killed bridge has left, and that stays armed on the ground."""


def plan(autopilot="embedded", task="slung_load", **given):
    options = {"url": None, "like": "px4", "speed_up": 1.0, "load": "feed", "demonstration": 5,
               "checkpoint": None, "practice": 500, "practise_on": "autopilot", "episodes": 10,
               "shown": 13, "seed": 0, "bridge": []} | given  # fmt: skip
    return make_plan(task, autopilot, **options)


@pytest.fixture
def places(tmp_path, domain):
    return os.environ | {
        "ROS_DOMAIN_ID": str(domain), "XDG_STATE_HOME": str(tmp_path / "state"),
        "XDG_CACHE_HOME": str(tmp_path / "cache"),
    }  # fmt: skip


def fly(places, *arguments, deadline=600.0):
    command = [sys.executable, "-m", "iolspi_ros", "fly", *map(str, arguments)]
    return subprocess.run(
        command, capture_output=True, text=True, env=places, timeout=deadline, check=False
    )


# ------------------------------------------------------------ the plan


@pytest.mark.parametrize("like", ["px4", "ardupilot"])
def test_the_plan_names_all_that_is_set_and_sent(like):
    said = "\n".join(describe(plan(like, load="estimate")))
    profile = PROFILES[like]
    for change in profile.changes:
        assert f"{' or '.join(change.names)} = {change.value:g}" in said
    for name, (value, *_) in profile.gripper.needs:
        assert f"{name} {value:g}" in said
    assert profile.mode_name(profile.controlled) in said
    assert f"0x{profile.acceleration:04X}" in said
    assert "estimated, and seen by nobody" in said


def test_the_plan_flies_nothing_and_sends_nothing(places, tmp_path):
    with Sitl("px4", ["udpin:127.0.0.1:0"]) as sitl:
        port = sitl.addresses[0][1]
        done = fly(places, "--plan", "--autopilot", "px4", "--url", f"udpout:127.0.0.1:{port}",
                   "--out", tmp_path / "out")  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert "COM_OF_LOSS_T = 0.5" in done.stdout
        assert sitl.autopilot.commander.ground_station_seen < 0.0
    assert not (tmp_path / "out").exists()


def test_a_folder_that_is_in_use_is_refused_before_anybody_is_asked(places, tmp_path):
    (tmp_path / "mine").write_text("kept")
    with Sitl("px4", ["udpin:127.0.0.1:0"]) as sitl:
        url = f"udpout:127.0.0.1:{sitl.addresses[0][1]}"
        done = fly(places, "--autopilot", "px4", "--url", url, "--out", tmp_path)
        assert done.returncode == 2
        assert "holds other files; allowed" in done.stderr
        assert sitl.autopilot.commander.ground_station_seen < 0.0


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ({"autopilot": "px4", "url": "udpin://0.0.0.0:14540"}, "allowed: udpin:127.0.0.1:14540"),
        ({"url": "tcp:127.0.0.1:5760"}, "allowed for the embedded autopilot: udpin, udpout"),
        ({"bridge": ["release"]}, "allowed: NAME=VALUE"),
        ({"bridge": ["release=magnet"]}, "release is 'magnet'; allowed: auto, gripper"),
        ({"practise_on": "mars"}, "--practise-on is 'mars'; allowed: autopilot, ideal"),
        ({"bridge": ["servo=40"]}, "servo is 40; allowed"),
    ],
)
def test_what_cannot_be_flown_is_refused_before_any_practice(given, why):
    with pytest.raises(InputError, match=why):
        plan(**given)


HALL = "slung_load_3d"


@pytest.mark.parametrize(
    ("task", "given", "why"),
    [
        ("pendulum", {}, "--task is 'pendulum'; allowed: slung_load, slung_load_3d"),
        (HALL, {"bridge": ["box=[5.0, -5.0, -5.0, 5.0]"]}, "of each pair the least first"),
        (HALL, {"bridge": ["box=[-5.0, 5.0]"]}, "moves along 2; allowed: 4 numbers"),
        ("slung_load", {"bridge": ["box=[-5.0, 5.0, -5.0, 5.0]"]}, "moves along 1; allowed: 2"),
        (HALL, {"bridge": ["box=[-1.0, 1.0, -1.0, 1.0]"]}, "no room to start in"),
        (HALL, {"bridge": ["vertical=true"]}, "as it holds the altitude"),
        (HALL, {"bridge": ["basket=[2.0, 0.0, 1.0]"]}, "that is practised on \\(0.0, 0.0, 1.0\\)"),
        (HALL, {"bridge": ["basket=[2.0, 0.0, -1.0]"]}, "inside the ground"),
        (HALL, {"bridge": ["height=9.0"]}, "height is 9 m; allowed: within heights"),
        (HALL, {"bridge": ["origin=[.nan, 0.0]"]}, "origin is .* finite numbers"),
        (HALL, {"bridge": ["cable=1.2"]}, "cable of the bridge is 1.2"),
    ],
)
def test_what_does_not_fit_the_task_is_refused_too(task, given, why):
    with pytest.raises(InputError, match=why):
        plan(task=task, **given)


def test_what_is_practised_on_is_said_and_goes_from_ideal_to_more_than_the_autopilots():
    found, answer = plan("px4"), PROFILES["px4"].answer
    said = "\n".join(describe(found))
    most = 4 / 3 * answer.delay
    assert f"500 episodes on a model that answers as px4 may: up to {most:.2f} s late" in said
    assert "until 98% succeed there" in said
    responses = []
    for seed in range(300):
        model = found.model()
        model.begin(seed)
        responses.append(model.response)
    for name in ("delay", "lag", "drag"):
        drawn = [getattr(response, name) for response in responses]
        assert min(drawn) < 0.05 * getattr(answer, name)
        assert 1.25 < max(drawn) / getattr(answer, name) <= 4 / 3
    gains = [response.gain for response in responses]
    assert min(gains) < answer.gain < max(gains)
    assert 0.4 < max(response.push for response in responses) <= answer.push


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shares", "best", "flown_on"),
    [([0.99], 0, "3 episodes"), ([0.5, 0.9, 0.6], 1, "7 episodes"), ([0.5, 0.4, 0.98], 2, "7 epi")],
)
def test_practice_goes_on_until_it_is_good_and_the_best_is_flown(
    monkeypatch, tmp_path, shares, best, flown_on
):
    found, steps = plan("px4", practice=3), []
    learner = prepare(found.task, found.config, 0).learner
    monkeypatch.setattr(flight_plan, "_ROUND", 2)

    def judged(model, policy):
        assert isinstance(model, AsFlown)
        assert policy(model.begin(0)[None]).shape == (1,)
        steps.append(policies.pop(0))
        return SimpleNamespace(success_fraction=shares[len(steps) - 1])

    def watched(learner):
        policies.append(learner.step)
        return greedy_policy(learner)

    policies: list[int] = []
    monkeypatch.setattr("iolspi_ros.experiments.evaluate.evaluate", judged)
    monkeypatch.setattr("iolspi_ros.core.learner.greedy_policy", watched)
    practised = flight_plan.practise(found, tmp_path)
    assert flown_on in practised.pretrained_on
    assert f"{max(shares):.0%}" in practised.pretrained_on
    checkpoint.load(practised.checkpoint, learner, "iolspi")
    assert learner.step == steps[best]
    assert len(steps) == len(shares)


@pytest.mark.parametrize(
    "given",
    [{"practise_on": "ideal"}, {"autopilot": "ardupilot"}, {"task": HALL, "load": "estimate"}],
)
def test_the_ideal_model_is_practised_on_where_that_is_asked_for_or_nothing_else_is_known(given):
    found = plan(**{"autopilot": "px4"} | given)
    assert "500 episodes on the model." in next(describe(found))
    assert type(found.model()) is flown.TASKS[found.task]


def test_what_can_be_flown_is_what_the_bridge_flies():
    assert tuple(flown.TASKS) == flight_plan.TASKS


def test_the_plan_of_another_task_is_of_its_own_files():
    found = plan("px4", HALL, load="estimate")
    assert found.config.name == "slung_load_3d.yaml"
    assert found.bag.parts[-2:] == (HALL, "set_5")
    said = "\n".join(describe(found))
    assert "episodes of slung_load_3d" in said
    assert "climb to 2.8 m" in said


def test_the_autopilot_that_is_expected_is_told_to_the_bridge():
    assert plan("px4", url="tcp:127.0.0.1:1").parameters()["autopilot"] == "px4"
    assert plan(like="ardupilot").parameters()["autopilot"] == "ardupilot"


@pytest.mark.parametrize(("asked", "there"), [("px4", "ardupilot"), ("ardupilot", "px4")])
def test_the_wrong_autopilot_is_named_before_any_practice(places, tmp_path, asked, there):
    with Sitl(there, ["udpin:127.0.0.1:0"]) as sitl:
        url = f"udpout:127.0.0.1:{sitl.addresses[0][1]}"
        done = fly(places, "--autopilot", asked, "--url", url, "--out", tmp_path / "out")
        before = dict(sitl.autopilot.parameters._values)
    assert done.returncode == 2
    assert f"is {there}, not {asked}; allowed: --autopilot {there}" in done.stderr
    assert "practising" not in done.stdout
    assert before == sitl.autopilot.parameters._values


@pytest.mark.parametrize("like", ["px4", "ardupilot"])
def test_another_speed_than_was_said_is_named_before_any_practice(places, tmp_path, like):
    with Sitl(like, ["udpin:127.0.0.1:0"], {"SIM_SPEEDUP": 4.0}, ready_after=2.0) as sitl:
        url = f"udpout:127.0.0.1:{sitl.addresses[0][1]}"
        done = fly(places, "--autopilot", like, "--url", url, "--out", tmp_path / "out")
    assert done.returncode == 2
    assert "is expected; allowed: for a simulator iolspi fly --speed-up" in done.stderr
    assert "practising" not in done.stdout


# ------------------------------------------------------------ what is said


def test_warnings_are_shown_as_they_come_and_the_same_not_all_the_time(capfd):
    warnings = Warnings.__new__(Warnings)
    warnings._said, warnings._more = {}, {}
    for now, text in [(0.0, "a"), (0.1, "b"), (1.0, "a"), (2.0, "a"), (11.0, "a"), (12.0, "b")]:
        warnings.take(text, now)
    warnings.take("b", 12.5)
    warnings.finish()
    said = [line.strip() for line in capfd.readouterr().out.splitlines()]
    assert said == ["a", "b", "a (said 2 times more)", "b", "b (said 1 times more)"]


def test_what_was_flown_comes_first_and_what_was_seen_of_it():
    said = {"releases": str({str(Seen.OUTPUT): 9, str(Seen.FAILED): 1}), "envelope_left": "2",
            "episodes_abandoned": "11", "chances": "7.3 of 9"}  # fmt: skip
    facts = flight_report._facts(SlungLoad(), 5, 13, "shown", Flown(10, said))
    assert facts[0] == ("38%", "end with a dunk as flown: 5 of 13 episodes shown")
    assert ("9", f"releases in all: {Seen.OUTPUT}") in facts
    assert ("1", f"releases in all: {Seen.FAILED}") in facts
    assert ("7.3 of 9", "releases expected inside, by how well it was known where") in facts
    assert ("11", "episodes broken off") in facts
    assert flight_report._facts(SlungLoad(), 0, 0, "shown", Flown(0, {}))[0][0] == "none"


# ------------------------------------------------------------ given back


@pytest.mark.slow
def test_restore_shows_what_is_remembered_and_gives_it_back(places, tmp_path):
    memory = Memory(tmp_path / "state" / "iolspi_ros" / "autopilots", tmp_path)
    vehicle = Identity("px4", 1, "07")
    with Sitl("px4", ["udpin:127.0.0.1:0"], RESTING) as sitl:
        url = f"udpout:127.0.0.1:{sitl.addresses[0][1]}"
        kept = Remembered({"COM_OF_LOSS_T": 1.5}, {"COM_OF_LOSS_T": 0.5})
        memory.keep(vehicle, "udpout:127.0.0.1:9", kept)
        nobody = fly(places, "--restore")
        assert nobody.returncode == 1
        assert "COM_OF_LOSS_T was 1.5, set to 0.5" in nobody.stdout
        assert "nothing comes at udpout:127.0.0.1:9" in nobody.stdout
        assert sitl.autopilot.parameters["COM_OF_LOSS_T"] == 0.5
        with sitl.lock:
            sitl.autopilot.commander.armed = True
        armed = fly(places, "--restore", "--url", url)
        assert armed.returncode == 1
        assert "it is armed: nothing is changed" in armed.stdout
        with sitl.lock:
            sitl.autopilot.commander.armed = False
        done = fly(places, "--restore", "--url", url)
        assert done.returncode == 0, done.stdout + done.stderr
        assert sitl.autopilot.parameters["COM_OF_LOSS_T"] == 1.5
    assert memory.all() == []
    assert "Nothing is left changed" in fly(places, "--restore").stdout


@pytest.mark.slow
def test_restore_reaches_another_system_elsewhere(places, tmp_path):
    memory = Memory(tmp_path / "state" / "iolspi_ros" / "autopilots", tmp_path)
    with Sitl("px4", ["udpin:127.0.0.1:0"], RESTING | {"MAV_SYS_ID": 3}) as sitl:
        kept = Remembered({"COM_OF_LOSS_T": 1.5}, {"COM_OF_LOSS_T": 0.5})
        memory.keep(Identity("px4", 3, "07"), "udpin:127.0.0.1:9", kept)
        (memory.folder / "px4_4.json").write_text("{")
        memory.keep(Identity("px4", 5), "nowhere", kept)
        assert "5" in fly(places, "--restore").stdout
        memory.forget(Identity("px4", 5))
        url = f"udpout:127.0.0.1:{sitl.addresses[0][1]}"
        wrong = fly(places, "--restore", "--url", url, "--bridge", "system=many")
        assert (wrong.returncode, "Traceback" in wrong.stderr) == (2, False)
        done = fly(places, "--restore", "--url", url)
        assert done.returncode == 0, done.stdout + done.stderr
        assert "px4_4.json" in done.stdout
        assert sitl.autopilot.parameters["COM_OF_LOSS_T"] == 1.5


# ------------------------------------------------------------ whole flights


@pytest.mark.slow
@pytest.mark.timeout(700)
@pytest.mark.parametrize("like", ["px4", "ardupilot"])
def test_it_flies_the_whole_way(tmp_path, places, like):
    out = tmp_path / "out"
    done = fly(places, "--like", like, "--speed-up", 4, "--practice", 0, "--episodes", 2,
               "--shown", 3, "--out", out)  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    lines = done.stdout.splitlines()
    checklist = [line for line in lines[lines.index("Preflight:") + 1 :] if "bridge: " not in line]
    assert checklist[0].startswith(f"  autopilot: {like}, system 1, at udpin:127.0.0.1:")
    names = [line.split(":")[0].strip() for line in checklist[:9]]
    assert names[1:] == [
        "signed", "identity", *CHANGES[like], "position estimate", "clock", "release", "load",
    ]  # fmt: skip
    summary = json.loads((out / "summary.json").read_text())
    assert summary["autopilot"] == f"embedded, like {like}"
    assert summary["load"] == "reported by its own system"
    assert summary["envelope_left"] == "0"
    assert summary["demonstrated_samples"] > 1000
    assert 0.0 <= summary["shown_success_fraction"] <= 1.0
    page = (out / "report.html").read_text()
    assert page.index("as flown") < page.index("the same policy on the model")
    for name in ("report.html", "flight.tlog", "checkpoint.npz", "bridge.log"):
        assert (out / name).stat().st_size > 0
    assert "Traceback" not in (out / "bridge.log").read_text()
    assert not (out / "sitl.log").read_text().count("Traceback")
    assert Memory(tmp_path / "state" / "iolspi_ros" / "autopilots", tmp_path).all() == []


@pytest.mark.slow
@pytest.mark.timeout(700)
def test_it_flies_the_hall_the_whole_way(tmp_path, places):
    out = tmp_path / "out"
    done = fly(places, "--task", HALL, "--like", "ardupilot", "--speed-up", 2, "--practice", 40,
               "--episodes", 2, "--shown", 3, "--out", out)  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    summary = json.loads((out / "summary.json").read_text())
    assert summary["task"] == HALL
    assert summary["flown_episodes"] >= 3
    assert summary["envelope_left"] == "0"
    assert "as flown" in (out / "report.html").read_text()
    assert "Traceback" not in (out / "bridge.log").read_text()
    assert Memory(tmp_path / "state" / "iolspi_ros" / "autopilots", tmp_path).all() == []


def _child(of, node):
    """Process of a node that a command has started."""
    children = psutil.Process(of).children()
    return next(process for process in children if node in process.cmdline())


@pytest.mark.slow
@pytest.mark.timeout(700)
@pytest.mark.parametrize("ends", ["killed", "interrupted"])
def test_a_flight_that_is_cut_says_what_flies_and_what_is_changed(tmp_path, places, ends):
    """A bridge that was killed cannot give back: it is said, and done by the next."""
    log = (tmp_path / "said").open("w+")
    booted = {"SIM_LOAD_RATE": 20.0, "SIM_SPEEDUP": 4.0, "PD_GRIPPER_EN": 1}
    with Sitl("px4", ["udpin:127.0.0.1:0"], booted, ready_after=2.0) as sitl:
        url = f"udpout:127.0.0.1:{sitl.addresses[0][1]}"
        options = ("--autopilot", "px4", "--url", url, "--speed-up", "4", "--practice", "5")
        command = [sys.executable, "-m", "iolspi_ros", "fly", *options, "--out", tmp_path / "out"]
        process = subprocess.Popen(command, stdout=log, stderr=log, env=places)
        try:
            body = sitl.autopilot.body
            _until(lambda: sitl.autopilot.commander.airborne and body.height > 4.0, log)
            if ends == "killed":
                _child(process.pid, "bridge").kill()
            else:
                process.send_signal(signal.SIGINT)
            assert process.wait(240.0) == {"killed": 2, "interrupted": 130}[ends]
        finally:
            process.kill()
            process.wait()
        said, changed = _said(log), sitl.autopilot.parameters["COM_OBL_RC_ACT"] == 5
        if ends == "killed":
            assert "may still be in the air" in said
            assert "Not given back" in said
            assert "COM_OBL_RC_ACT (was 0)" in said
            assert changed
            _until(lambda: not sitl.autopilot.commander.armed, log, land=sitl)
            done = fly(places, "--restore")
            assert done.returncode == 0, done.stdout
        else:
            assert not changed
        assert sitl.autopilot.parameters["COM_OBL_RC_ACT"] == 0
        assert sitl.autopilot.parameters["COM_OF_LOSS_T"] == 1.0


def _until(ready, log, deadline=300.0, land=None):
    if land is not None:  # a person does
        with land.lock:
            land.autopilot.commander.set_mode(Mode.LAND)
    end = time.monotonic() + deadline
    while not ready():
        assert time.monotonic() < end, _said(log)
        time.sleep(0.05)


def _said(log):
    log.seek(0)
    return log.read()
