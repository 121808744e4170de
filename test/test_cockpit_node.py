"""The node `cockpit` on a graph, with a browser that is a socket alone."""

import base64
import contextlib
import io
import json
import re
import socket
import time
import urllib.error
import urllib.request

import numpy as np
import PIL.Image
import pytest
from conftest import Peer
from sensor_msgs.msg import CompressedImage, Joy
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from iolspi_ros import qos, wire
from iolspi_ros.core.samples import Observation
from msg_bridge.cockpit import settings
from sim_nodes.tasks.pendulum import Pendulum

TASK = Pendulum().description
TOKEN = "0123456789abcdef"


@pytest.fixture(autouse=True)
def no_token(monkeypatch):
    monkeypatch.delenv(settings.TOKEN, raising=False)


class Page:
    """A browser that is a socket alone."""

    def __init__(self, address, **options):
        opened = connect(address.replace("http", "ws") + "socket", **options)
        self.socket = contextlib.ExitStack().enter_context(opened)
        self.shown = {}

    def say(self, **words):
        self.socket.send(json.dumps(words))

    def move(self, x, *buttons):
        self.say(say="move", axes=[x, 0.0], buttons=list(buttons))

    def look(self, timeout=0.005):
        """Read what has come."""
        with contextlib.suppress(TimeoutError):
            while True:
                said = json.loads(self.socket.recv(timeout=timeout))
                self.shown[said["part"]] = said["is"]


@pytest.fixture
def graph(ros, nodes):
    """A cockpit, its address, and a peer that is the vehicle and listens to the stick."""
    peer = Peer(ros)
    peer.listen("joy", Joy)
    peer.task = peer.be_vehicle(TASK)
    nodes.start("cockpit")
    nodes.wait_for("cockpit", "open http")
    peer.address = re.search(r"open (\S+)", nodes.log("cockpit"))[1]
    return peer


@pytest.fixture
def page(graph):
    opened = Page(graph.address)
    graph.until(lambda: opened.look() or "task" in opened.shown)
    return opened


def take(graph, page):
    """Take the stick, and hear it at rest."""
    page.say(say="ask")

    def repeated():
        page.move(0.0, 0, 0, 0, 0)
        page.look()
        return graph.heard["joy"]

    graph.until(repeated)


def test_the_page_is_served_whole_and_asks_nobody_else(graph):
    text = urllib.request.urlopen(graph.address).read().decode()
    script = urllib.request.urlopen(graph.address + "cockpit/cockpit.js").read().decode()
    assert 'id="vehicle"' in text or '"vehicle"' in text or "id=vehicle" in text
    assert "new WebSocket" in script
    elsewhere = re.findall(r"""(?:src|href|from|import)\W{1,3}(https?:)?//[^"' ]+""", text + script)
    assert elsewhere == []


def test_a_stick_becomes_joy_at_once_again_and_again_and_neutral_when_it_is_put_down(graph, page):
    take(graph, page)
    heard = graph.heard["joy"]
    page.move(1.0, 0, 0, 1, 0)
    graph.until(lambda: heard[-1].axes[0] == 1.0)
    assert list(heard[-1].axes) == [1.0, 0.0]
    assert list(heard[-1].buttons) == [0, 0, 1, 0]
    count = len(heard)
    end = time.monotonic() + 1.0
    while time.monotonic() < end:  # 60 Hz; the machine may be busy
        page.move(1.0, 0, 0, 1, 0)
        graph.spin(0.02)
    assert 20 < len(heard) - count < 80
    page.say(say="give")
    graph.until(lambda: not any(heard[-1].buttons))
    assert list(heard[-1].axes) == [0.0, 0.0]
    count = len(heard)
    graph.spin(0.3)
    assert len(heard) == count


def test_a_closed_socket_and_a_silent_one_let_go_in_time(graph, page):
    """Neutral within 0.3 s of the last word, by the stamp of the message."""
    heard = graph.heard["joy"]
    for end in (lambda: None, lambda: page.socket.close()):
        take(graph, page)
        page.move(1.0, 0, 0, 0, 1)
        graph.until(lambda: heard[-1].axes[0] == 1.0)
        last = time.time()
        end()
        graph.until(lambda: heard[-1].axes[0] == 0.0)
        stamp = heard[-1].header.stamp
        assert stamp.sec + stamp.nanosec / 1e9 - last < 0.3
        assert not any(heard[-1].buttons)
        heard.clear()


def test_one_flies_others_watch_and_the_stick_is_handed_over(graph, page):
    take(graph, page)
    other = Page(graph.address)
    other.say(say="ask")
    other.move(-1.0, 0, 0, 0, 0)
    mine = page.shown["you"]

    def asked():
        page.move(0.5, 0, 0, 0, 0)
        page.look()
        other.look()
        return page.shown["stick"]["asking"]

    graph.until(asked)
    assert page.shown["stick"]["holder"] == mine
    assert all(message.axes[0] >= 0.0 for message in graph.heard["joy"])
    page.say(say="give")

    def handed():
        other.move(-1.0, 0, 0, 0, 0)
        other.look()
        return other.shown.get("stick", {}).get("holder") == other.shown["you"]

    graph.until(handed)
    graph.until(lambda: handed() and graph.heard["joy"][-1].axes[0] == -1.0)


def flood(socket):
    for _ in range(200_000):
        socket.send('{"say": "move", "axes": [1, 0], "buttons": [0, 0, 0, 0]}')


def test_nonsense_and_a_flood_end_nothing(graph, page):
    take(graph, page)
    for text in ("x", "[" * 1000, '{"say": "move", "axes": [NaN, 0], "buttons": [0,0,0,0]}'):
        page.socket.send(text)
    with Page(graph.address).socket as bytes_alone:
        bytes_alone.send(b"\x00\xff")
    with pytest.raises(ConnectionClosed):
        flood(Page(graph.address).socket)
    take(graph, page)
    assert all(message.axes[0] == 0.0 for message in graph.heard["joy"])


def test_what_the_vehicle_shows_comes_to_the_page(graph, page):
    states = graph.publisher("state", wire.states(TASK).type, qos.OUTGOING)
    rewards = graph.publisher("reward", Float64MultiArray, qos.OUTGOING)
    codec, rows = wire.states(TASK), wire.RewardRows()
    seen = []

    def told():
        step = len(seen)
        source = 2 if step else -1
        state = np.array([0.5, -0.25 * step])
        now = Observation(5, step, state, -1.0 * step, 1, stamp=step + 1, source=source)
        seen.append(now)
        states.publish(codec.of(now))
        rewards.publish(rows.of(now))
        page.look()
        return page.shown.get("now", {}).get("step", 0) > 3

    graph.until(told)
    now = page.shown["now"]
    assert now["episode"] == 5
    assert now["who"] == "person"
    assert now["state"] == [0.5, -0.25 * now["step"]]
    assert now["reward"] == -1.0 * now["step"]


def test_images_of_the_vehicle_come_to_the_page_and_nothing_else_does(graph, page, nodes):
    images = graph.publisher("image/compressed", CompressedImage, qos.LATCHED)
    images.publish(CompressedImage(format="gif", data=b"GIF89a" * 10))
    graph.until(lambda: "60 bytes of 'gif'" in nodes.log("cockpit"))
    drawn = io.BytesIO()
    PIL.Image.new("RGB", (3, 2), "red").save(drawn, "PNG")
    images.publish(CompressedImage(format="png", data=drawn.getvalue()))
    graph.until(lambda: page.look() or "image" in page.shown)
    kind, content = page.shown["image"].split(",")
    assert kind == "data:image/png;base64"
    assert base64.b64decode(content) == drawn.getvalue()


def test_verdicts_are_the_demonstrator_s_services(graph, page):
    called = []

    def keep(_, response):
        called.append("keep")
        response.success, response.message = True, "1 of 3 kept"
        return response

    graph.node.create_service(Trigger, "demonstrator/keep", keep)
    take(graph, page)

    def said():
        page.say(say="call", service="keep")
        page.look()
        graph.spin(0.05)
        return page.shown.get("said", {}).get("good")

    graph.until(said)
    assert called
    assert page.shown["said"]["text"] == "1 of 3 kept"


def test_a_port_in_use_is_said(run_here):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        status, said = run_here("cockpit", "-p", f"port:={port}")
    assert status == 2
    assert f"port {port}: Address already in use; allowed" in said
    assert "Traceback" not in said


def test_for_others_a_token_is_needed(run_here):
    status, said = run_here("cockpit", "-p", "host:=0.0.0.0")
    assert status == 2
    assert "IOLSPI_COCKPIT_TOKEN is missing; allowed: at least 16 characters" in said
    assert "Traceback" not in said


def test_a_wrong_token_is_refused_in_words(nodes, monkeypatch):
    nodes.env[settings.TOKEN] = TOKEN
    nodes.start("cockpit", "-p", "host:=0.0.0.0")
    nodes.wait_for("cockpit", "open http")
    address = re.search(r"open (\S+)\?token=", nodes.log("cockpit"))[1]
    address = address.replace("0.0.0.0", "127.0.0.1")
    for query in ("", "?token=0123456789abcdee"):
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(address + query)
        assert refused.value.code == 403
        assert b"yours is missing or wrong" in refused.value.read()
    with pytest.raises(InvalidStatus):
        Page(address)
    answer = urllib.request.urlopen(f"{address}?token={TOKEN}")
    cookie = answer.headers["set-cookie"].partition(";")[0]
    Page(address, additional_headers={"Cookie": cookie}).look(1.0)
    assert nodes.end("cockpit") == 0


def test_it_is_a_managed_node(graph, nodes):
    """Deactivated it shows and does not fly; cleaned up and configured it serves again."""
    from lifecycle_msgs.msg import Transition
    from lifecycle_msgs.srv import ChangeState

    def change(number):
        request = ChangeState.Request(transition=Transition(id=number))
        return graph.call(ChangeState, "cockpit/change_state", request).success

    assert change(Transition.TRANSITION_DEACTIVATE)
    page = Page(graph.address)
    page.say(say="ask")
    for _ in range(10):
        page.move(1.0, 0, 0, 0, 0)
        graph.spin(0.02)
    assert graph.heard["joy"] == []
    assert change(Transition.TRANSITION_CLEANUP)
    assert change(Transition.TRANSITION_CONFIGURE)
    graph.until(lambda: nodes.log("cockpit").count("open http") == 2)
    graph.address = re.findall(r"open (\S+)", nodes.log("cockpit"))[1]
    assert change(Transition.TRANSITION_ACTIVATE)
    page = Page(graph.address)
    graph.until(lambda: page.look() or "task" in page.shown)
    take(graph, page)
    assert nodes.end("cockpit") == 0


def test_the_map_is_of_the_learner_s_own_settings(graph, page, nodes):
    """A learner with a grid of its own, which only its parameters say."""
    nodes.start("learner", "-p", "centers:=[4, 3]", "-p", "wait_for_demonstrations:=false")
    states = graph.publisher("state", wire.states(TASK).type, qos.OUTGOING)
    rewards = graph.publisher("reward", Float64MultiArray, qos.OUTGOING)
    seen = Observation(0, 0, np.array([0.5, 1.0]), 0.0, -1, stamp=1)

    def drawn():
        states.publish(wire.states(TASK).of(seen))
        rewards.publish(wire.RewardRows().of(seen))
        graph.spin(0.05)
        page.look()
        return "policy" in page.shown

    graph.until(drawn)
    shown = page.shown["policy"]
    assert len(shown["action"]) == len(shown["value"]) == shown["points"] ** 2
    assert set(shown["action"]) <= {0, 1, 2}
    assert min(shown["value"]) == 0.0
    assert max(shown["value"]) == 1.0


@pytest.mark.parametrize("named", ["os:system", "nobody"])
def test_a_class_that_the_graph_names_is_not_imported(graph, page, nodes, named):
    from rcl_interfaces.srv import GetParameters
    from rclpy.parameter import Parameter

    asked = []

    def answer(request, response):
        asked.append(list(request.names))
        response.values = [Parameter("learner", value=named).get_parameter_value()]
        return response

    graph.node.create_service(GetParameters, "learner/get_parameters", answer)
    graph.until(lambda: f"{named} is no registered learner" in nodes.log("cockpit"))
    assert all(names == ["learner"] for names in asked)
