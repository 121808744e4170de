"""The cockpit's page in a headless Chromium: a scripted person flies with keys or a gamepad.

Nothing here measures time: a machine with two busy cores shows the same, later. The person waits
for what they see, and who flies badly because the machine is slow flies again in slower motion.
"""

import json
import re
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from urllib.parse import urlsplit

import numpy as np
import pytest
from chromium import Browser, needs_chromium
from conftest import Peer
from sensor_msgs.msg import Joy
from std_msgs.msg import Float64MultiArray

from iolspi_ros import bags, qos, wire
from iolspi_ros.core.learner import Source
from iolspi_ros.pairing import Pairer
from iolspi_ros.wire import Phase
from sim_nodes.tasks import task_class
from sim_nodes.tasks.pendulum import Pendulum
from sim_nodes.tasks.pendulum.pilot import Perform

pytestmark = [pytest.mark.slow, pytest.mark.browser, needs_chromium]


@pytest.fixture
def browser():
    opened = []

    def make(address, **options):
        opened.append(Browser(**options))
        opened[-1].open(address)
        return opened[-1]

    yield make
    for one in opened:
        one.close()


class Graph(Peer):
    """Sees what the vehicle does and who does it, and hears the stick."""

    def __init__(self, ros, task):
        super().__init__(ros)
        self.seen = []
        self.pairer = Pairer(task)
        self.listen("joy", Joy)
        self.listen("piloting", Float64MultiArray, qos.LATCHED)
        self.rows = wire.Rows("piloting", wire.PILOTING)
        for topic, kind, take in (
            ("state", wire.states(task).type, self.pairer.state),
            ("reward", Float64MultiArray, self.pairer.reward),
        ):
            self.node.create_subscription(
                kind, topic, lambda message, take=take: self._note(take(message)), qos.CONTROL
            )

    def _note(self, observation):
        if observation is not None:
            self.seen.append(observation)

    @property
    def now(self):
        return self.seen[-1] if self.seen else None

    @property
    def phase(self):
        return int(self.rows.read(self.heard["piloting"][-1])[4]) if self.heard["piloting"] else -1

    def soon(self, ready, seconds=3.0):
        """Whether something comes to hold within so long."""
        end = time.monotonic() + seconds
        while not ready() and time.monotonic() < end:
            self.loop.once(0.02)
        return ready()

    @property
    def learner_flies(self):
        return self.now.source in (Source.EXPLOIT, Source.EXPLORE)


class Cockpit:
    """`iolspi cockpit`, whose address is known."""

    def __init__(self, folder, *options):
        self.folder = folder
        command = [sys.executable, "-m", "iolspi_ros", "cockpit", "--out", str(folder), *options]
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        said = ""
        while (found := re.search(r"Open (http\S+)", said)) is None:
            line = self.process.stdout.readline()
            assert line, said
            said += line
        self.address = found[1]

    def end(self):
        self.process.send_signal(signal.SIGINT)
        said, _ = self.process.communicate(timeout=60)
        return self.process.returncode, said


@pytest.fixture
def cockpit(tmp_path):
    begun = []

    def begin(*options):
        begun.append(Cockpit(tmp_path / "out", *options))
        return begun[-1]

    yield begin
    for one in begun:
        if one.process.poll() is None:
            one.end()


def has_the_stick(page):
    return "you have the stick" in page.text("crowd")


def take_the_stick(graph, page):
    graph.until(lambda: page.text("task") and not has_the_stick(page))
    page.click("stick-button")
    graph.until(lambda: has_the_stick(page))


class Keys:
    """A key for each action, none for neutral, and space to take over."""

    def __init__(self, page, keys):
        self.page, self.keys, self.held = page, keys, None

    def do(self, action):
        key = self.keys.get(action)
        if key != self.held:
            if self.held is not None:
                self.page.lift(self.held)
            if key is not None:
                self.page.press(key)
            self.held = key

    def take_over(self, held):
        (self.page.press if held else self.page.lift)(" ")


class Gamepad:
    """The left stick steers, A is the last action, a shoulder button takes over.

    A fake: no device is plugged in, and the page's own `getGamepads` is replaced. What is real is
    all behind it: the page's reading of it, the socket, `joy`, the demonstrator, and the vehicle.
    """

    FAKE = """
        const buttons = Array.from({length: 16}, () => ({pressed: false}));
        window.fakePad = {axes: [0, 0], buttons};
        navigator.getGamepads = () => [null, window.fakePad];
    """

    def __init__(self, page, task):
        self.page, self.task, self.held = page, task, None
        page.run(self.FAKE)

    def do(self, action):
        if action == self.held:
            return
        self.held, release = action, action == self.task.n_actions - 1
        value = (0.0,) if release else self.task.actions[action].value
        x, y = value if len(value) == 2 else (0.0, -value[0])
        stick = [-y / 3.0, -x / 3.0]  # right and down are its positive ends
        self.page.run(f"fakePad.axes = {stick}; fakePad.buttons[0].pressed = {int(release)};")

    def take_over(self, held):
        self.page.run(f"fakePad.buttons[4].pressed = {int(held)};")


@dataclass
class Person:
    """Flies by a law and by what they see, and judges how it went."""

    graph: Graph
    page: Browser
    hands: Keys | Gamepad
    law: object
    task: object
    speed: float
    towards: int

    def begin(self):
        """Do what the page says until an episode is theirs."""
        graph, begun = self.graph, (Phase.FLYING, Phase.REVIEW)

        def move():
            self.hands.do(self.towards if graph.phase == Phase.WAITING else self.task.neutral)
            phase = graph.phase
            graph.soon(lambda: graph.phase != phase)

        self.insist(move, lambda: graph.phase in begun)

    def insist(self, act, done):
        """Do something until it is done: a page that hung has lost the stick, and knows no key."""
        end = time.monotonic() + 90.0
        while not self.graph.soon(done, 0.0):
            assert time.monotonic() < end, (self.graph.phase, self.page.text("crowd"))
            if not has_the_stick(self.page):
                take_the_stick(self.graph, self.page)
            act()
            self.graph.soon(done)

    def fly(self):
        """Fly until the episode waits for a verdict; its number, and whether it went well."""
        graph, paused, before = self.graph, False, None
        self.begin()
        while graph.phase != Phase.REVIEW:
            if graph.now is before:
                graph.until(
                    lambda seen=before: graph.now is not seen or graph.phase == Phase.REVIEW
                )
            before = graph.now
            self.hands.do(self.law.decide(before.state, 0.0))
            paused |= graph.phase == Phase.PAUSED
        self.hands.do(self.task.neutral)
        episode = int(graph.rows.read(graph.heard["piloting"][-1])[0])
        return episode, not paused and self.went_well(episode)

    def went_well(self, episode):
        """Whether the person flew it, and it swung up or ended as the task wants it."""
        flown = [seen for seen in self.graph.seen if seen.episode == episode]
        theirs = sum(seen.source == Source.HUMAN for seen in flown)
        if theirs < 0.95 * flown[-1].step:
            return False  # on a busy machine the vehicle may have waited for them too often
        if self.task.name == "pendulum":
            return min(abs(seen.state[0]) for seen in flown) < 0.3
        ending = self.task.ending(flown[-1].reward, flown[-1].terminated)
        return self.task.endings[int(ending)] == self.task.endings[1]

    def judge(self, verdict):
        self.insist(lambda: self.tap(verdict), lambda: self.graph.phase != Phase.REVIEW)

    def tap(self, key):
        self.page.press(key)
        self.page.lift(key)

    def demonstrate(self, wanted):
        """Keep so many that went well, and discard the others and the second; the kept ones."""
        verdicts, discards = {}, wanted > 1
        while list(verdicts.values()).count("k") < wanted:
            assert len(verdicts) < 12, verdicts
            episode, well = self.fly()
            verdicts[episode] = "k" if well and not (discards and "k" in verdicts.values()) else "d"
            discards = discards and not (well and verdicts[episode] == "d")
            self.judge(verdicts[episode])
            if not well and self.speed > 0.1:
                self.slow_down()
        return sorted(episode for episode, verdict in verdicts.items() if verdict == "k")

    def slow_down(self):
        self.speed = max(0.1, round(self.speed / 2, 1))  # the slider goes by 0.05
        self.insist(
            lambda: self.page.set("speed", self.speed),
            lambda: self.page.part("speed") == self.speed,
        )


STORIES = {
    "pendulum": ("0.2", 2, lambda page, task: Keys(page, {0: "ArrowLeft", 2: "ArrowRight"})),
    "slung_load": ("0.5", 2, Gamepad),
    "slung_load_3d": ("0.5", 1, Gamepad),
}
"""Speed, the action to begin with, and what is flown with."""


@pytest.mark.parametrize(
    ("name", "wanted"), [("pendulum", 3), ("slung_load", 3), ("slung_load_3d", 1)]
)
def test_a_person_demonstrates_keeps_discards_hands_over_takes_over_and_lets_go(
    ros, cockpit, browser, name, wanted
):
    vehicle = task_class(name)()
    task, (speed, towards, hands) = vehicle.description, STORIES[name]
    run = cockpit("--task", name, "--speed", speed, "--seed", "1")
    graph = Graph(ros, task)
    page = browser(run.address)
    take_the_stick(graph, page)
    law = (
        Perform(9.81) if name == "pendulum" else vehicle.pilot("perform", np.random.default_rng(0))
    )
    law.begin()
    person = Person(graph, page, hands(page, task), law, task, float(speed), towards)
    kept = person.demonstrate(wanted)
    if wanted > 1:
        hand_over_take_over_and_let_go(person)
    assert page.complaints() == []
    status, said = run.end()
    assert status == 0, said
    assert (run.folder / "checkpoint.npz").exists() == (wanted > 1)

    bag = run.folder / "demonstration"
    demonstration = bags.read_demonstration(bag, task)
    assert sorted({sample.episode for sample in demonstration.samples}) == kept
    assert "person" in bags.read_card(bag)["pilot"]
    seen = {(each.episode, each.step): each for each in graph.seen}
    for episode in kept:
        flown = [sample for sample in demonstration.samples if sample.episode == episode]
        # On a busy machine a message may be lost: then there are fewer, and never wrong ones.
        assert len(flown) >= 0.9 * max(step for number, step in seen if number == episode)
        for sample in flown:
            after = seen.get((episode, sample.step + 1))
            assert after is None or after.state.tolist() == sample.transition.next_state.tolist()
        sources = [sample.source for sample in flown]
        # The vehicle holds while it waits for the person's answer; all else is theirs.
        assert sources.count(Source.HUMAN) >= 0.9 * len(sources)
        assert set(sources) <= {Source.HUMAN, Source.HOLD}
    if name == "pendulum":
        assert taught(bag) < 1.02


def hand_over_take_over_and_let_go(person):
    """The learner flies, then the person, in flight, and then the learner again."""
    graph, page, task = person.graph, person.page, person.task
    person.insist(lambda: person.tap("f"), lambda: graph.phase == Phase.ENDED)
    graph.until(lambda: graph.learner_flies)
    graph.until(lambda: page.text("who").startswith("learner"))
    graph.until(lambda: 2 < graph.now.step < task.episode_steps / 3 and graph.learner_flies)
    person.insist(lambda: person.hands.take_over(True), lambda: graph.now.source == Source.HUMAN)
    person.hands.do(0)
    graph.until(lambda: (graph.now.source, graph.now.action) == (Source.HUMAN, 0))
    person.hands.do(task.neutral)
    person.hands.take_over(False)
    graph.until(lambda: graph.learner_flies)
    graph.until(lambda: any(score[3] for score in page.part("scores") or []))


def taught(bag):
    """Cost of a policy that is learned from a bag and two minutes, as a ratio to near-optimal."""
    command = [sys.executable, "-m", "iolspi_ros", "learn", "--demos", bag, "--episodes", "80",
               "--out", bag.parent / "learned"]  # fmt: skip
    subprocess.run(list(map(str, command)), check=True, capture_output=True)
    summary = json.loads((bag.parent / "learned" / "summary.json").read_text())
    return summary["ratio_to_near_optimal"]


def test_the_page_asks_nobody_but_its_own_server(ros, nodes, browser):
    nodes.start("cockpit")
    nodes.wait_for("cockpit", "open http")
    address = re.search(r"open (\S+)", nodes.log("cockpit"))[1]
    page = browser(address, log=True)
    graph = Peer(ros)
    kept = graph.be_vehicle(Pendulum().description)
    graph.until(lambda: page.text("task") == "pendulum")
    asked = page.requests()
    assert {urlsplit(url).netloc for url in asked} == {urlsplit(address).netloc}
    assert page.complaints() == []
    del kept


NOTE_WORDS = """
    const send = WebSocket.prototype.send;
    window.words = [];
    WebSocket.prototype.send = function (text) {
      if (String(text).startsWith('{"say"')) window.words.push(JSON.parse(text).say);
      return send.call(this, text);
    };
"""
HIDE = """
    Object.defineProperty(document, 'hidden', {value: true, configurable: true});
    document.dispatchEvent(new Event('visibilitychange'));
"""
SHOW = "Object.defineProperty(document, 'hidden', {value: false, configurable: true})"
HANG = """
    setTimeout(() => {
      const end = Date.now() + 2000;
      while (Date.now() < end);
      window.hung = Date.now();
    })
"""


def test_a_page_that_is_hidden_closed_or_stopped_lets_go(ros, nodes, browser):
    """Who sees it coming says so; who is silent is centred, and then has no stick any more."""
    nodes.start("cockpit")
    nodes.wait_for("cockpit", "open http")
    address = re.search(r"open (\S+)", nodes.log("cockpit"))[1]
    graph = Graph(ros, Pendulum().description)
    kept = graph.be_vehicle(Pendulum().description)
    page, watcher = browser(address), browser(address)
    page.run(NOTE_WORDS)
    heard = graph.heard["joy"]

    def let_go(how):
        """When the page let go, after it had held the stick to the left [s]."""
        take_the_stick(graph, page)
        page.press("ArrowLeft")
        graph.until(lambda: heard and heard[-1].axes[0] == 1.0)
        heard.clear()
        how()
        graph.until(lambda: any(message.axes[0] == 0.0 for message in heard))
        stamp = next(message for message in heard if message.axes[0] == 0.0).header.stamp
        return stamp.sec + stamp.nanosec / 1e9

    when = let_go(lambda: page.run(HANG))
    graph.until(lambda: page.run("return window.hung || 0"))
    assert when < page.run("return window.hung") / 1000
    page.lift("ArrowLeft")
    if "you have the stick" in page.text("crowd"):
        page.click("stick-button")
    let_go(lambda: page.run(HIDE))
    assert page.run("return window.words.pop()") == "give"
    page.run(SHOW)
    let_go(lambda: page.run("window.dispatchEvent(new Event('pagehide'))"))
    assert page.run("return window.words.pop()") == "give"

    try:
        let_go(page.stop)
        graph.until(lambda: watcher.part("stick")["holder"] is None)
        take_the_stick(graph, watcher)
        watcher.click("stick-button")
    finally:
        page.go_on()
    page.lift("ArrowLeft")
    graph.until(lambda: page.text("link") == "connected")

    let_go(page.driver.close)
    graph.until(lambda: watcher.part("stick") == {"holder": None, "asking": [], "browsers": 1})
    graph.spin(0.2)  # what is under way
    heard.clear()
    graph.spin(0.5)
    assert heard == []
    assert watcher.complaints() == []
    del kept


def test_mouse_touch_and_gamepad_are_sticks(ros, nodes, browser):
    nodes.start("cockpit")
    nodes.wait_for("cockpit", "open http")
    task = task_class("slung_load")().description
    graph = Graph(ros, task)
    kept = graph.be_vehicle(task)
    page = browser(re.search(r"open (\S+)", nodes.log("cockpit"))[1], width=390, height=844)
    take_the_stick(graph, page)
    heard = graph.heard["joy"]

    def newest(x, buttons):
        return heard and abs(heard[-1].axes[0] - x) < 0.1 and list(heard[-1].buttons) == buttons

    rest = [0] * 5
    point = """
        const at = document.querySelector(arguments[0]).getBoundingClientRect();
        const event = new PointerEvent(arguments[1], {bubbles: true, buttons: 1, pointerId: 1,
            clientX: at.left + arguments[2] * at.width, clientY: at.top + 0.5 * at.height});
        const target = document.querySelector(arguments[0]);
        target.setPointerCapture = () => {};
        target.dispatchEvent(event);
    """
    page.driver.execute_script(point, "#pad", "pointerdown", 0.0)
    graph.until(lambda: newest(1.0, rest))
    page.driver.execute_script(point, "#pad", "pointermove", 1.0)
    graph.until(lambda: newest(-1.0, rest))
    page.driver.execute_script(point, "#pad", "pointerup", 1.0)
    graph.until(lambda: newest(0.0, rest))
    page.driver.execute_script(point, ".action:nth-child(4)", "pointerdown", 0.5)
    graph.until(lambda: newest(0.0, [0, 0, 0, 1, 0]))
    page.driver.execute_script(point, ".action:nth-child(4)", "pointerup", 0.5)
    page.click("takeover")  # latched, until it is pressed again
    graph.until(lambda: newest(0.0, [0, 0, 0, 0, 1]))
    page.click("takeover")
    graph.until(lambda: newest(0.0, rest))
    page.press("1")
    graph.until(lambda: newest(0.0, [1, 0, 0, 0, 0]))
    page.lift("1")
    pad = """
        const buttons = Array.from({length: 16}, (_, i) => ({pressed: i === arguments[1]}));
        const pad = {axes: [arguments[0], 0], buttons};
        navigator.getGamepads = () => [null, pad];
    """
    page.driver.execute_script(pad, 0.5, -1)
    graph.until(lambda: newest(-0.5, rest))
    page.driver.execute_script(pad, 0.05, 0)  # in its dead zone, with A for the last action
    graph.until(lambda: newest(0.0, [0, 0, 0, 1, 0]))
    page.driver.execute_script(pad, None, 5)  # an axis that is no number, and a shoulder
    graph.until(lambda: newest(0.0, [0, 0, 0, 0, 1]))
    assert page.complaints() == []
    del kept


@pytest.mark.parametrize("name", ["pendulum", "slung_load", "slung_load_3d", "cart_pole"])
def test_every_task_is_shown(ros, nodes, browser, name):
    """With a picture, or bars and lines where there is none."""
    nodes.start("simulator", "-p", f"task:={name}", "-p", "mode:=realtime")
    nodes.start("cockpit")
    nodes.wait_for("cockpit", "open http")
    page = browser(re.search(r"open (\S+)", nodes.log("cockpit"))[1])
    graph = Graph(ros, task_class(name)().description)
    graph.until(lambda: page.part("now") and page.part("visits"))
    assert page.text("task").replace(" ", "_") == name
    painted = """
        const c = document.getElementById('vehicle');
        const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
        return d.filter((v, i) => i % 4 === 3 && v > 0).length;
    """
    graph.until(lambda: page.run(painted) > 500)
    views = page.run(
        "return [...document.querySelectorAll('#views button')].map(b => b.textContent)"
    )
    deep = name == "slung_load_3d"
    assert views == (["behind", "on board", "above", "side"] if deep else [])
    for view in views[1:]:
        page.press("v")
        page.lift("v")
        graph.until(
            lambda view=view: (
                page.text("views").split("\n")
                and page.run(
                    "return document.querySelector('#views [aria-pressed=true]').textContent"
                )
                == view
            )
        )
        graph.until(lambda: page.run(painted) > 500)
    assert page.complaints() == []


def test_a_camera_sees_what_a_pinhole_does(nodes, browser):
    nodes.start("cockpit")
    nodes.wait_for("cockpit", "open http")
    page = browser(re.search(r"open (\S+)", nodes.log("cockpit"))[1])
    eye, towards, size = np.array([-4.0, 1.0, 3.0]), np.array([2.0, -1.0, 0.5]), (600.0, 400.0)
    ahead = (towards - eye) / np.linalg.norm(towards - eye)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    focal = 300.0 / np.tan(np.radians(37.5))
    camera = np.array([right, np.cross(right, ahead), ahead])
    for point in np.random.default_rng(0).uniform(-1.0, 2.0, (20, 3)):
        u, v, far = camera @ (point - eye)
        seen = page.driver.execute_script(
            "return space.camera(arguments[0], arguments[1], 600, 400).at(arguments[2])",
            eye.tolist(), towards.tolist(), point.tolist(),
        )  # fmt: skip
        np.testing.assert_allclose(
            seen, [size[0] / 2 + focal * u / far, size[1] / 2 - focal * v / far]
        )
