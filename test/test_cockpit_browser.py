"""The cockpit's page in a headless Chromium: a scripted person flies with the keys alone."""

import re
import signal
import subprocess
import sys
import time
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
        said, _ = self.process.communicate(timeout=30)
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


def take_the_stick(graph, page):
    graph.until(lambda: page.text("task") and "you have the stick" not in page.text("crowd"))
    page.click("stick-button")
    graph.until(lambda: "you have the stick" in page.text("crowd"))


class Hands:
    """Arrow keys for actions: the first to the left, the last to the right, none for neutral."""

    def __init__(self, page, actions):
        self.page, self.keys, self.held = page, actions, None

    def do(self, action):
        key = self.keys.get(action)
        if key != self.held:
            if self.held is not None:
                self.page.lift(self.held)
            if key is not None:
                self.page.press(key)
            self.held = key


def fly(graph, hands, law):
    """Fly until the episode waits for a verdict; its number."""
    end = time.monotonic() + 60.0
    while graph.phase != Phase.REVIEW:
        assert time.monotonic() < end, graph.now
        graph.loop.once(0.01)
        hands.do(law.decide(graph.now.state, 0.0))
    hands.do(None)
    return int(graph.rows.read(graph.heard["piloting"][-1])[0])


def test_a_person_demonstrates_keeps_discards_hands_over_takes_over_and_lets_go(
    ros, cockpit, browser
):
    task = Pendulum().description
    run = cockpit("--speed", "0.2", "--seed", "1")
    graph = Graph(ros, task)
    page = browser(run.address)
    take_the_stick(graph, page)
    hands, law = Hands(page, {0: "ArrowLeft", 2: "ArrowRight"}), Perform(9.81)
    graph.until(lambda: graph.phase == Phase.WAITING)
    page.press("ArrowRight")
    page.lift("ArrowRight")
    verdicts = {}
    for verdict in ("k", "d", "k", "k"):
        graph.until(lambda: graph.phase == Phase.FLYING, 30.0)
        verdicts[fly(graph, hands, law)] = verdict
        page.press(verdict)
        page.lift(verdict)
        graph.until(lambda: graph.phase != Phase.REVIEW)
    page.press("f")
    page.lift("f")
    graph.until(lambda: graph.phase == Phase.ENDED)
    graph.until(lambda: graph.now.source in (Source.EXPLOIT, Source.EXPLORE), 60.0)
    graph.until(lambda: page.text("who").startswith("learner"))

    graph.until(lambda: 20 < graph.now.step < 100)  # in flight
    page.press(" ")
    graph.until(lambda: graph.now.source == Source.HUMAN, 5.0)
    page.press("ArrowLeft")
    graph.until(lambda: (graph.now.source, graph.now.action) == (Source.HUMAN, 0), 5.0)
    page.lift("ArrowLeft")
    page.lift(" ")
    graph.until(lambda: graph.now.source in (Source.EXPLOIT, Source.EXPLORE), 5.0)
    graph.until(lambda: page.part("scores") and any(row[3] for row in page.part("scores")), 30.0)
    assert page.complaints() == []
    status, said = run.end()
    assert status == 0, said
    assert (run.folder / "checkpoint.npz").exists()

    kept = sorted(episode for episode, verdict in verdicts.items() if verdict == "k")
    bag = run.folder / "demonstration"
    demonstration = bags.read_demonstration(bag, task)
    assert sorted({sample.episode for sample in demonstration.samples}) == kept
    assert len(demonstration.samples) == 3 * task.episode_steps
    sources = [sample.source for sample in demonstration.samples]
    # The vehicle holds the first state until the person answers it; all else is theirs.
    assert sources.count(Source.HUMAN) >= 0.98 * len(sources)
    assert set(sources) <= {Source.HUMAN, Source.HOLD}
    assert "person" in bags.read_card(bag)["pilot"]
    swung_up = [
        min(abs(s.transition.state[0]) for s in demonstration.samples if s.episode == episode)
        for episode in kept
    ]
    assert max(swung_up) < 0.3


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


def test_a_hidden_or_closed_page_lets_go(ros, nodes, browser):
    nodes.start("cockpit")
    nodes.wait_for("cockpit", "open http")
    address = re.search(r"open (\S+)", nodes.log("cockpit"))[1]
    graph = Graph(ros, Pendulum().description)
    kept = graph.be_vehicle(Pendulum().description)
    page = browser(address)
    heard = graph.heard["joy"]

    def released(how):
        take_the_stick(graph, page)
        page.press("ArrowLeft")
        graph.until(lambda: heard and heard[-1].axes[0] == 1.0)
        begin = time.time()
        how()
        graph.until(lambda: heard[-1].axes[0] == 0.0)
        stamp = next(m.header.stamp for m in heard if m.axes[0] == 0.0 and stamped(m) > begin)
        heard.clear()
        return stamp.sec + stamp.nanosec / 1e9 - begin

    def stamped(message):
        return message.header.stamp.sec + message.header.stamp.nanosec / 1e9

    hide = """
        Object.defineProperty(document, 'hidden', {value: true, configurable: true});
        document.dispatchEvent(new Event('visibilitychange'));
    """
    hang = "setTimeout(() => { const end = Date.now() + 1500; while (Date.now() < end); })"
    assert released(lambda: page.run(hang)) < 0.3
    graph.spin(1.5)
    page.lift("ArrowLeft")
    page.click("stick-button")  # put down
    assert released(lambda: page.run(hide)) < 0.3
    page.run("Object.defineProperty(document, 'hidden', {value: false, configurable: true})")
    assert released(lambda: page.run("window.dispatchEvent(new Event('pagehide'))")) < 0.3
    assert released(page.driver.close) < 0.3
    graph.spin(0.2)  # what is under way
    heard.clear()
    graph.spin(0.5)
    assert heard == []
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


FAKE_GAMEPAD = """
    const buttons = Array.from({length: 16}, () => ({pressed: false}));
    window.fakePad = {axes: [0, 0], buttons};
    navigator.getGamepads = () => [null, window.fakePad];
"""
"""A fake: no device is plugged in, and the page's own `getGamepads` is replaced. What is real is
all behind it: the page's reading of it, the socket, `joy`, the demonstrator, and the vehicle."""


def stick_for(value):
    """Where a gamepad's left stick is for an acceleration: right and down are its positive ends."""
    x, y = value if len(value) == 2 else (0.0, -value[0])
    return [-y / 3.0, -x / 3.0]


@pytest.mark.parametrize(("name", "towards"), [("slung_load", 2), ("slung_load_3d", 1)])
def test_the_load_is_flown_with_a_gamepad_until_it_dunks(ros, cockpit, browser, name, towards):
    """By a scripted person with a fake gamepad: the stick steers, A releases."""
    vehicle = task_class(name)()
    task = vehicle.description
    run = cockpit("--task", name, "--speed", "0.5", "--seed", "1")
    graph = Graph(ros, task)
    page = browser(run.address)
    take_the_stick(graph, page)
    page.run(FAKE_GAMEPAD)
    held = [None]

    def hold(action):
        """The stick, or for the last of the actions A."""
        if action == held[0]:
            return
        held[0], last = action, action == task.n_actions - 1
        stick = [0, 0] if last else stick_for(task.actions[action].value)
        page.run(f"fakePad.axes = {stick}; fakePad.buttons[0].pressed = {int(last)};")

    law = vehicle.pilot("perform", np.random.default_rng(0))
    law.begin()
    graph.until(lambda: graph.phase == Phase.WAITING, 30.0)
    hold(towards)
    graph.until(lambda: graph.phase == Phase.COUNTDOWN, 30.0)
    hold(task.neutral)
    dunk, end = task.endings[1], time.monotonic() + 100.0
    assert dunk.success
    ended = []
    while dunk.name not in ended and time.monotonic() < end:
        graph.until(lambda: graph.phase in (Phase.FLYING, Phase.REVIEW), 30.0)
        while graph.phase == Phase.FLYING and time.monotonic() < end:
            graph.loop.once(0.01)
            # Where it will be when the word has come: a person looks ahead, too.
            ahead = graph.now.state.copy()
            ahead[0::2] += 0.1 * ahead[1::2]
            hold(law.decide(ahead, 0.0))
        hold(task.neutral)
        graph.until(lambda: graph.phase == Phase.REVIEW, 30.0)
        last = next(seen for seen in reversed(graph.seen) if seen.last)
        ended.append(task.endings[int(task.ending(last.reward, last.terminated))].name)
        verdict = "k" if ended[-1] == dunk.name else "d"
        page.press(verdict)
        page.lift(verdict)
        graph.until(lambda: graph.phase != Phase.REVIEW)
    assert ended[-1] == dunk.name, ended
    assert page.complaints() == []
    status, said = run.end()
    assert status == 0, said
    demonstration = bags.read_demonstration(run.folder / "demonstration", task)
    assert demonstration.samples[-1].transition.reward == dunk.reward
    assert {sample.source for sample in demonstration.samples} <= {Source.HUMAN, Source.HOLD}
    assert demonstration.samples[-1].source == Source.HUMAN
