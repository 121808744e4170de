"""A person at the stick of whole nodes: takes over, demonstrates, and loses the stick."""

import signal
import time
from itertools import pairwise

import numpy as np
import pytest
from conftest import Peer
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import Joy
from std_msgs.msg import Float64MultiArray, Header, String
from std_srvs.srv import Trigger

from iolspi_ros import bags, qos, wire
from iolspi_ros.core.learner import Source
from iolspi_ros.resources import find
from iolspi_ros.wire import Phase
from sim_nodes.tasks.pendulum import Pendulum
from sim_nodes.tasks.slung_load import SlungLoad

TASK = Pendulum.description
PERIOD = 0.02
"""Seconds between two messages of the stick."""

NOTING = """
import numpy as np
from iolspi_ros.core.online import OnlineLSPI

class Noting(OnlineLSPI):
    '''Writes down what it learns from.'''
    def observe(self, transition):
        t = transition
        row = [*t.state, t.action, t.reward, *t.next_state, t.terminated, t.truncated, t.source]
        with open({notes!r}, "ab") as file:
            np.array(row, float).tofile(file)
        return super().observe(transition)
"""


class Person(Peer):
    """Holds a stick that says where it is all the time, and watches the vehicle."""

    def __init__(self, ros, task=TASK):
        super().__init__(ros)
        self.task, self.axis, self.buttons = task, 0.0, [0, 0]
        self.joy = self.publisher("joy", Joy)
        self.timer = self.node.create_timer(PERIOD, self.say)
        states = wire.states(task)
        self.listen("state", states.type, qos.RECORDING)
        self.listen("reward", Float64MultiArray, qos.RECORDING)
        self.listen("piloting", Float64MultiArray, qos.LATCHED)
        self.listen("score", Float64MultiArray, qos.REPORTS)
        self._rows, self._states = wire.RewardRows(), states

    def say(self):
        self.joy.publish(Joy(axes=[self.axis], buttons=self.buttons))

    def press(self, down):
        self.buttons = [int(down), 0]
        self.say()

    def newest(self):
        """Of the rewards: by name."""
        heard = self.heard["reward"]
        return dict(zip(wire.REWARD, heard[-1].data, strict=True)) if heard else None

    def source(self):
        return self.newest()["source"] if self.heard["reward"] else -1

    def piloting(self):
        heard = self.heard["piloting"]
        return (
            dict(zip(wire.PILOTING, heard[-1].data, strict=True))
            if heard
            else {"phase": -1, "held": -1}
        )

    def phase(self, phase):
        self.until(lambda: self.piloting()["phase"] == phase)

    def observations(self):
        """What the vehicle showed, by (episode, step); each must always be the same."""
        states, seen = {}, {}
        for message in self.heard["state"]:
            state, stamp = self._states.state(message)
            states[stamp] = state
        for message in self.heard["reward"]:
            values = self._rows.read(message)
            stamp = wire.join(values[2], values[3])
            if stamp in states:
                found = self._rows.observation(values, states[stamp], stamp)
                before = seen.setdefault((found.episode, found.step), found)
                assert before[3:] == found[3:]
        return seen

    def ask(self, verdict):
        return self.call(Trigger, f"/demonstrator/{verdict}", Trigger.Request())


@pytest.fixture
def person(ros):
    return Person(ros)


def stand_by(nodes, *arguments):
    """A demonstrator that has demonstrated, and is there to take over.

    A stick that is silent for half a second gives back; this one's person hears thousands of
    messages a second beside, and is late with their own.
    """
    nodes.start(
        "demonstrator", "-p", "source:=scripted", "-p", "episodes:=1", "-p", "takeover_button:=0",
        "-p", "joy_timeout:=5.0", *arguments,
    )  # fmt: skip
    nodes.wait_for("demonstrator", "button 0 takes the vehicle over")


def learn(nodes, *arguments):
    nodes.start("learner", "-p", "wait_for_demonstrations:=false", *arguments)
    nodes.wait_for("learner", "acting on")


# ---------------------------------------------------------------- takeover


def steps(person):
    """Each step that the vehicle showed, by its two states."""
    seen = person.observations()
    return {
        before.state.tobytes() + after.state.tobytes(): [
            *before.state, after.action, after.reward, *after.state, after.terminated,
            after.truncated, after.source,
        ]
        for (episode, step), before in seen.items()
        if (after := seen.get((episode, step + 1))) is not None
    }  # fmt: skip


def test_who_stands_by_says_nothing_while_somebody_else_flies(nodes, person):
    person.listen("action", Float64MultiArray)
    nodes.start("simulator", "-p", "mode:=realtime")
    stand_by(nodes)
    learn(nodes)
    n = len(person.heard["action"])
    person.until(lambda: len(person.heard["action"]) > n + 300)
    assert Source.HUMAN not in {message.data[5] for message in person.heard["action"][n:]}
    person.press(True)
    person.until(lambda: person.source() == Source.HUMAN)


@pytest.mark.parametrize(
    ("count", "mode"),
    [(12, "lockstep"), (12, "realtime"), pytest.param(100, "lockstep", marks=pytest.mark.slow),
     pytest.param(100, "realtime", marks=pytest.mark.slow)],
)  # fmt: skip
def test_takeovers_at_random_moments_make_no_wrong_transition(nodes, person, tmp_path, count, mode):
    """Each transition learned from is one that the vehicle made, once, and says who flew it."""
    notes, rng = tmp_path / "notes", np.random.default_rng(count)
    (tmp_path / "noting.py").write_text(NOTING.format(notes=str(notes)))
    nodes.env["PYTHONPATH"] = f"{tmp_path}:{find('package.xml').parent}"
    noise = "sensor_noise:=[0.001]"  # tells each state from those of other episodes
    nodes.start("simulator", "-p", f"mode:={mode}", "-p", noise)
    stand_by(nodes)
    learn(nodes, "-p", "learner:=noting:Noting")
    for _ in range(count):
        person.spin(rng.uniform(0.0, 0.1))
        person.axis = float(rng.choice([-1.0, 0.0, 1.0]))
        person.press(True)
        person.until(lambda: person.source() == Source.HUMAN)
        person.spin(rng.uniform(0.0, 0.1))
        person.press(False)
        person.until(lambda: person.source() in (Source.EXPLOIT, Source.EXPLORE))
    assert nodes.end("learner") == 0
    learned = np.fromfile(notes).reshape(-1, 2 * TASK.n_dims + 5)
    keys = [row[:2].tobytes() + row[4:6].tobytes() for row in learned]
    assert len(set(keys)) == len(keys)  # none twice
    person.spin(1.0)
    seen, made = person.observations(), steps(person)
    heard = {found.state.tobytes() for found in seen.values()}
    judged = [  # a busy peer may miss some of thousands of messages a second
        (made.get(key), row.tolist())
        for row, key in zip(learned, keys, strict=True)
        if {key[:16], key[16:]} <= heard
    ]
    assert [row for _, row in judged] == [row for row, _ in judged]
    assert len(judged) > 0.5 * len(learned)
    shown = int((learned[:, -1] == Source.HUMAN).sum())
    assert shown >= count
    flown = [seen[key].source in (Source.HUMAN, Source.CORRUPTED) for key in sorted(seen)]
    assert rises(flown) >= count
    over = [wire.ScoreRows().read(m) for m in person.heard["score"]]
    for episode, steps_flown, *_, counted in over:
        sources = [seen[k].source for k in sorted(seen) if k[0] == episode]
        if len(sources) == steps_flown + 1:  # what the vehicle holds meanwhile is the person's
            flown = [source == Source.HUMAN for source in sources if source != Source.HOLD]
            assert counted <= rises(flown)  # the learner may miss one, while it does not fly


def rises(flown):
    """How often false is followed by true, with false before the first."""
    return sum(now and not before for before, now in pairwise([False, *flown]))


def test_a_learner_in_the_vehicle_s_process_is_no_exception(nodes, person):
    nodes.start("simulator")
    stand_by(nodes)
    assert nodes.end("simulator") == 0
    nodes.start("graph", "-p", "learner:wait_for_demonstrations:=false")
    nodes.wait_for("graph", "acting on")
    for _ in range(3):
        before = len(person.heard["reward"])
        person.press(True)
        person.until(lambda: person.source() == Source.HUMAN)
        person.spin(0.3)
        sources = [m.data[8] for m in person.heard["reward"][before:]]
        held = sources[sources.index(Source.HUMAN) :]
        assert set(held) <= {-1.0, Source.HUMAN, Source.HOLD}
        person.press(False)
        person.until(lambda: person.source() in (Source.EXPLOIT, Source.EXPLORE))


def test_from_the_button_to_the_first_action_are_no_two_periods(nodes, ros):
    person = Person(ros, SlungLoad.description)
    nodes.start("simulator", "-p", "task:=slung_load", "-p", "mode:=realtime")
    stand_by(nodes, "-p", "joy_actions:=3")
    learn(nodes)
    took = []
    for _ in range(12):
        while True:  # in the middle of an episode
            count = len(person.heard["reward"])
            person.until(lambda count=count: len(person.heard["reward"]) > count)
            pressed = person.newest()
            if pressed["step"] < 20 and not pressed["terminated"]:
                break
        person.press(True)
        person.until(lambda: person.source() == Source.HUMAN)
        first = person.newest()
        if first["episode"] == pressed["episode"]:
            took.append(first["step"] - pressed["step"])
        person.press(False)
        person.until(lambda: person.source() in (Source.EXPLOIT, Source.EXPLORE))
    assert len(took) >= 6
    assert max(took) <= 2.0
    assert np.median(took) <= 1.0  # the present state is answered at once


@pytest.mark.parametrize("mode", ["lockstep", "realtime"])
def test_a_demonstrator_killed_while_holding_gives_the_vehicle_back(nodes, person, mode):
    nodes.start("simulator", "-p", f"mode:={mode}")
    stand_by(nodes)
    learn(nodes)
    person.axis = 1.0
    person.press(True)
    person.until(lambda: person.source() == Source.HUMAN)
    nodes.end("demonstrator", signal.SIGKILL)
    person.until(lambda: person.source() in (Source.EXPLOIT, Source.EXPLORE))
    seen = person.observations()
    last = max(key for key in seen if seen[key].source == Source.HUMAN)
    gap = [seen[key] for key in sorted(seen) if key > last and seen[key].step > 0]
    until = next(n for n, o in enumerate(gap) if o.source != Source.HOLD)
    assert {o.action for o in gap[:until]} <= {TASK.neutral}


def test_a_vehicle_that_waits_for_its_pilot_says_so_again(nodes, ros):
    """Also when the pilot has answered once, and the vehicle was given back and taken since."""
    pilot = Peer(ros)
    pilot.listen("reward", Float64MultiArray, qos.RECORDING)
    holding = pilot.publisher("takeover", Float64MultiArray, qos.LATCHED)
    acting = pilot.publisher("action", Float64MultiArray, qos.OUTGOING)
    rows, rewards = wire.Rows("takeover", wire.TAKEOVER), wire.RewardRows()
    say = lambda: holding.publish(rows.message(0, 0, 0, 0, 1))  # noqa: E731
    pilot.node.create_timer(0.05, say)
    nodes.start("simulator", "-p", "mode:=realtime", "-p", "real_time_factor:=1.0")

    def seen():
        return [tuple(rewards.read(message)[:2]) for message in pilot.heard["reward"]]

    def waits():
        """For an episode that began while it was held."""
        keys = seen()
        return keys and keys[-1][1] == 0 and keys.count(keys[-1]) > 3

    pilot.until(waits)
    episode = seen()[-1][0]
    answer = wire.Rows("action", wire.ACTION)
    acting.publish(answer.message(episode, 0, 0, 0, 2, Source.HUMAN))
    pilot.until(lambda: (episode, 1) in seen())


def test_a_silent_stick_takes_nothing_and_a_latched_one_is_let_go(nodes, person):
    nodes.start("simulator")
    stand_by(nodes, "-p", "takeover_latched:=true", "-p", "joy_timeout:=2.0")
    learn(nodes)
    for silent in (False, True):
        person.press(True)
        person.until(lambda: person.piloting()["held"] == 1.0)
        person.press(False)
        person.until(lambda: person.source() == Source.HUMAN)
        person.spin(0.3)
        assert person.piloting()["held"] == 1.0  # and stays taken over
        if silent:
            person.timer.cancel()
        else:
            person.press(True)
        person.until(lambda: person.piloting()["held"] == 0.0)
        person.press(False)
        person.until(lambda: person.source() in (Source.EXPLOIT, Source.EXPLORE))


# ---------------------------------------------------------------- demonstrating


def demonstrate(nodes, *arguments, **values):
    """A demonstrator by joystick, which a busy machine may keep silent for a while."""
    given = {"source": "joy", "countdown": 0.0, "joy_timeout": 5.0} | values
    texts = [f"{name}:={str(v).lower() if isinstance(v, bool) else v}" for name, v in given.items()]
    return nodes.start("demonstrator", *arguments, *(x for t in texts for x in ("-p", t)))


def fly(person, then):
    """An episode flown at random, from a movement to what follows it."""
    person.until(person.newest)
    person.axis = -person.axis or 1.0
    person.until(lambda: person.piloting()["phase"] in (Phase.FLYING, then))
    person.phase(then)
    return person.piloting()["episode"]


def test_it_begins_at_a_movement_and_an_episodes_beginning(nodes, person):
    """Whoever flew before, and in real time: the vehicle waits for its pilot."""
    nodes.start("simulator", "-p", "mode:=realtime")
    learn(nodes)
    person.until(lambda: person.newest() and person.newest()["step"] > 50)
    person.listen("sample", Float64MultiArray, qos.SAMPLES)
    demonstrate(nodes, episodes=1, countdown=0.5)
    person.phase(Phase.WAITING)
    person.spin(1.0)  # it repeats, and does not move
    assert person.piloting()["phase"] == Phase.WAITING
    person.axis = 1.0
    person.until(lambda: person.piloting()["phase"] == Phase.FLYING)
    person.until(lambda: len(person.heard["sample"]) >= 295)
    person.phase(Phase.ENDED)
    rows = wire.SampleRows(TASK.names)
    found = [rows.sample(m) for m in person.heard["sample"]]
    assert {s.source for s in found} <= {Source.HUMAN, Source.HOLD}
    assert [s.source for s in found].count(Source.HOLD) <= 1  # the first, if it came late
    assert found[0].step == 0
    assert len({s.episode for s in found}) == 1


def test_verdicts_decide_what_the_bag_and_the_learner_get(nodes, person, tmp_path):
    person.listen("sample", Float64MultiArray, qos.SAMPLES)
    person.listen("demonstration", Float64MultiArray, qos.RECORDING)
    nodes.start("simulator")
    demonstrate(nodes, review=True, countdown=2.0, record=tmp_path / "bag")
    person.phase(Phase.WAITING)
    assert not person.ask("keep").success
    flown = []
    for verdict in ("keep", "discard", "keep", "keep"):
        flown.append(fly(person, Phase.REVIEW))
        answer = person.ask(verdict)
        assert answer.success, answer.message
        if len(flown) == 3:  # what the two that are kept cover
            assert "2 kept, 1 discarded; 600 samples, " in answer.message
            assert "of the boxes of shaft.position and shaft.velocity seen" in answer.message
    for _ in range(3):
        assert person.ask("undo").success  # the last, the third and the second
    assert person.ask("keep").success  # the second after all
    assert person.ask("discard").success  # the third
    assert person.heard["sample"] == []
    answer = person.ask("finish")
    assert answer.success
    assert answer.message == "2 kept, 1 discarded, 1 not decided"
    kept = flown[:2]
    person.until(lambda: len(person.heard["sample"]) == 600)
    person.until(lambda: person.heard["demonstration"])
    assert list(person.heard["demonstration"][-1].data[-2:]) == [0.0, 600.0]
    rows = wire.SampleRows(TASK.names)
    sent = [rows.sample(m) for m in person.heard["sample"]]
    assert sorted({s.episode for s in sent}) == kept
    nodes.wait_for("demonstrator", "samples are in")
    found = bags.read_demonstration(tmp_path / "bag", TASK)
    assert sorted({s.episode for s in found.samples}) == kept
    assert "episodes that were not kept are left out: 2" in found.notes
    assert found.card["samples"] == len(found.samples) == 600
    assert person.piloting()["phase"] == Phase.ENDED
    assert "has ended" in person.ask("undo").message


def test_advice_says_what_would_be_learned_and_what_helps_most(nodes, person):
    person.listen("advice", String, qos.LATCHED)
    nodes.start("simulator")
    demonstrate(nodes, review=True)
    advice = lambda: person.heard["advice"][-1].data if person.heard["advice"] else ""  # noqa: E731
    person.until(lambda: advice().startswith("Perform"))  # nothing is kept yet
    for taught in ("Taught by this episode", "Taught by these 2 episodes"):
        fly(person, Phase.REVIEW)
        assert person.ask("keep").success
        person.until(lambda: advice().startswith("Learning beside"))
        person.until(lambda taught=taught: advice().startswith(taught), 180.0)
        assert "end upright from" in advice()
        assert "Kept: " in advice()
    assert person.ask("undo").success
    person.until(lambda: "Kept: 300 samples" in advice())
    person.until(lambda: advice().startswith("Taught by this episode"), 180.0)


def test_a_kill_costs_the_running_episode_alone(nodes, person, tmp_path):
    nodes.start("simulator")
    demonstrate(nodes, review=True, record=tmp_path / "bag")
    person.phase(Phase.WAITING)
    kept = []
    for verdict in ("keep", "discard", "keep"):
        episode = fly(person, Phase.REVIEW)
        if verdict == "keep":
            kept.append(episode)
        assert person.ask(verdict).success
    person.axis = -person.axis
    nodes.end("demonstrator", signal.SIGKILL)
    found = bags.read_demonstration(tmp_path / "bag", TASK)
    assert [*dict.fromkeys(s.episode for s in found.samples)] == kept
    assert len(found.samples) == 600


def test_a_stick_that_falls_silent_pauses_and_marks_the_episode(nodes, person, tmp_path):
    """In slow real time: a part of an episode flown, then nothing is a person's."""
    nodes.start("simulator", "-p", "mode:=realtime", "-p", "real_time_factor:=0.2")
    demonstrate(nodes, episodes=1, record=tmp_path / "bag", joy_timeout=2.0)
    person.phase(Phase.WAITING)
    person.axis = 1.0
    person.phase(Phase.FLYING)
    person.until(lambda: person.source() == Source.HUMAN)
    person.timer.cancel()
    person.phase(Phase.PAUSED)
    person.until(lambda: person.source() == Source.HOLD)
    marked = person.newest()["episode"]
    person.until(lambda: person.piloting()["discarded"] == 1.0)
    person.timer.reset()
    person.phase(Phase.WAITING)
    person.axis = -1.0
    person.until(lambda: person.piloting()["kept"] == 1.0)
    nodes.wait_for("demonstrator", "demonstration ended")
    found = bags.read_demonstration(tmp_path / "bag", TASK)
    assert marked not in {s.episode for s in found.samples}
    assert "episodes that were not kept are left out: 1" in found.notes
    assert len(found.samples) >= 290


@pytest.mark.parametrize(
    ("values", "level", "words"),
    [({"joy_axis": 3}, 2, "the joystick has no axis 3; allowed: 0 to 0"),
     ({"takeover_button": 6}, 2, "the joystick has no button 6; allowed: 0 to 1"),
     ({"nan": True}, 1, "messages of the joystick were no positions of a stick"),
     ({"two": True}, 1, "publish on /joy, where only one may"),
     ({"two": True}, 1, "messages of another joystick were not listened to")],
)  # fmt: skip
def test_a_stick_that_cannot_be_trusted_is_said(nodes, person, values, level, words):
    person.listen("/diagnostics", DiagnosticArray, qos.RECORDING)
    if "two" in values:
        other = person.publisher("joy", Joy)
    if "nan" in values:
        person.axis = float("nan")
    nodes.start("simulator")
    demonstrate(nodes, **{k: v for k, v in values.items() if k not in ("two", "nan")})

    def said():
        if "two" in values:
            other.publish(Joy(header=Header(frame_id="other"), axes=[1.0], buttons=[1, 1]))
        return any(
            words in status.message and status.level == bytes([level])
            for m in person.heard["/diagnostics"] for status in m.status
            if status.name == "demonstrator: demonstrating"
        )  # fmt: skip

    person.until(said)
    if "two" not in values:
        assert person.piloting()["phase"] in (-1, Phase.NO_STICK)
        assert all(m.data[1] == 0.0 for m in person.heard["reward"])


def test_a_place_to_record_to_is_looked_at_before_anybody_flies(run_here, tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "file").write_text("")
    for place, words in (("there", "exists already"), ("file/bag", "cannot be made in")):
        status, said = run_here("demonstrator", "-p", "source:=joy", "-p",
                                f"record:={tmp_path / place}")  # fmt: skip
        assert status == 2
        assert words in said
        assert "Traceback" not in said


def test_who_flies_in_slow_motion_flies_each_step(nodes, ros):
    """A state is shown every half second there, and answered at once."""
    person = Person(ros, SlungLoad.description)
    slow = ("mode:=realtime", "real_time_factor:=0.2")
    nodes.start("simulator", "-p", "task:=slung_load", *(x for text in slow for x in ("-p", text)))
    demonstrate(nodes, joy_actions=3)
    person.until(lambda: person.piloting()["phase"] == Phase.WAITING)
    person.axis = 1.0
    person.until(lambda: person.source() == Source.HUMAN)
    count = len(person.heard["reward"])
    person.until(lambda: len(person.heard["reward"]) >= count + 4)
    flown = [message.data[7:9].tolist() for message in person.heard["reward"][count : count + 4]]
    assert flown == [[0.0, float(Source.HUMAN)]] * 4


def test_slow_motion_while_it_runs(nodes, person):
    nodes.start("simulator", "-p", "mode:=realtime", "-p", "real_time_factor:=20.0")
    heard = person.heard["reward"]
    person.until(lambda: heard)
    assert person.set("simulator", real_time_factor=0.1)[0].successful
    count = 0
    while len(heard) > count:  # what came at the pace before
        count = len(heard)
        person.spin(0.02)
    begin, count = time.monotonic(), len(heard)
    person.until(lambda: len(heard) >= count + 20)
    assert time.monotonic() - begin > 0.9  # twenty steps a second, and were four thousand
    assert not person.set("simulator", real_time_factor=0.0)[0].successful
    assert person.set("simulator", real_time_factor=1.0)[0].successful
    count = len(heard)
    person.until(lambda: len(heard) > count + 50)
