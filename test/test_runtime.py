"""How nodes end: by a signal, with the graph still there for their last word."""

import os
import select
import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import numpy as np
import pytest
import rclpy
from conftest import ENDS, Peer
from sensor_msgs.msg import Joy
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import Trigger

from iolspi_ros import qos, runtime, wire
from iolspi_ros.core.learner import Source
from iolspi_ros.core.samples import Observation
from iolspi_ros.process import say
from iolspi_ros.vehicle_topics import Answer, VehicleTopics
from sim_nodes.tasks.pendulum import Pendulum


@pytest.mark.parametrize("number", ENDS)
def test_a_signal_asks_and_shuts_no_context_down(number):
    asked, before = [], signal.getsignal(number)
    with runtime.session([], lambda: asked.append(number)):
        loop = runtime.Loop(rclpy.create_node("asked"))
        assert runtime.ok()
        os.kill(os.getpid(), number)
        loop.once(0.1)  # takes the node in
        assert not runtime.ok()
        assert rclpy.ok()
        os.kill(os.getpid(), number)
        loop.once(0.1)
        with pytest.raises(KeyboardInterrupt):
            runtime.check()
    assert asked == [number] * 2
    assert signal.getsignal(number) is before
    assert not rclpy.ok()
    with runtime.session([]):
        assert runtime.ok()


def test_who_is_ignored_stays_so():
    signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as below nohup
    with runtime.session([]):
        os.kill(os.getpid(), signal.SIGHUP)
        assert runtime.ok()


def test_a_message_without_an_event_makes_no_later_one_late(ros):
    """Here its event is lost with an executor; at a start it may never have been made."""
    talker, listener, heard = ros.create_node("talker"), ros.create_node("listener"), []
    out = talker.create_publisher(String, "word", qos.LATCHED)
    listener.create_subscription(String, "word", lambda m: heard.append(m.data), qos.TASK)
    subscription = next(s for s in listener.subscriptions if s.topic_name == "/word")
    end = time.monotonic() + 60.0
    while not subscription.get_publisher_count() and time.monotonic() < end:
        time.sleep(0.01)
    out.publish(String(data="first"))
    before = runtime.executor()
    before.add_node(listener)
    before.spin_once(timeout_sec=1.0)  # begins to listen, and hears nothing
    before.shutdown()
    executor = runtime.executor()
    executor.add_node(listener)
    executor.spin_once(timeout_sec=0.1)
    out.publish(String(data="second"))
    while not heard and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.1)
    assert heard == ["first"]  # one too late, as are all later ones
    executor.shutdown()
    loop = runtime.Loop(listener)
    while len(heard) < 2 and time.monotonic() < end:
        loop.once(0.1)
    out.publish(String(data="third"))
    while len(heard) < 3 and time.monotonic() < end:
        loop.once(0.1)
    assert heard == ["first", "second", "third"]


def listening(node):
    """An executor that listens: of what comes from now on it is told, and nobody else."""
    executor = runtime.executor()
    executor.add_node(node)
    for _ in range(5):
        executor.spin_once(timeout_sec=0.1)
    return executor


def test_a_call_without_an_event_is_answered_all_the_same(ros):
    """Both the request and the answer: their events are lost with an executor."""
    asker, answerer = ros.create_node("asker"), ros.create_node("answerer")
    asked = []

    def answer(_, response):
        asked.append(1)
        response.success = True
        return response

    answerer.create_service(Trigger, "question", answer)
    client = asker.create_client(Trigger, "question")
    assert client.wait_for_service(60.0)
    of_asker, of_answerer = listening(asker), listening(answerer)
    pending = client.call_async(Trigger.Request())
    time.sleep(0.5)  # until it is there; should it come later, the test shows nothing
    of_answerer.shutdown()
    loop, end = runtime.Loop(answerer), time.monotonic() + 60.0
    while not asked and time.monotonic() < end:
        loop.once(0.1)
    time.sleep(0.5)
    of_asker.shutdown()
    loop = runtime.Loop(asker)
    while not pending.done() and time.monotonic() < end:
        loop.once(0.1)
    assert asked == [1]
    assert pending.result().success


def test_an_action_for_what_was_not_shown_yet_takes_no_vehicle(ros):
    topics = VehicleTopics(ros.create_node("vehicle"), Pendulum.description)
    topics.show(Observation(3, 7, np.zeros(2)))
    for episode, step in ((4, 0), (3, 8), (1000, 7)):
        assert not topics.admits(Answer(episode, step, 0, Source.HUMAN))
        assert not topics.takeover.held
    assert topics.admits(Answer(3, 7, 0, Source.HUMAN))
    assert topics.takeover.held


def test_who_holds_a_vehicle_and_is_ended_gives_it_back(nodes, ros):
    """With a word, not by silence."""
    peer = Peer(ros)
    peer.listen("takeover", Float64MultiArray, qos.LATCHED)
    joy = peer.publisher("joy", Joy)
    pressed = Joy(axes=[0.0], buttons=[1])
    peer.node.create_timer(0.02, lambda: joy.publish(pressed))
    nodes.start("simulator")
    nodes.start("demonstrator", "-p", "source:=scripted", "-p", "episodes:=1",
                "-p", "takeover_button:=0", "-p", "joy_timeout:=5.0")  # fmt: skip
    rows = wire.Rows("takeover", wire.TAKEOVER)

    def said():
        return [rows.read(message)[-1] for message in peer.heard["takeover"]]

    peer.until(lambda: said()[-3:] == [1.0, 1.0, 1.0])
    assert nodes.end("demonstrator") == 0
    peer.until(lambda: said()[-1] == 0.0)


def nobody(kind):
    """A place that takes no words."""
    if kind == "full":
        return open("/dev/full", "w")
    out, into = os.pipe()
    os.close(out)
    return open(into, "w")


@pytest.mark.parametrize("kind", ["full", "unread"])
def test_words_that_nothing_takes_change_no_end(domain, kind):
    command = [sys.executable, "-m", "iolspi_ros.nodes.start", "simulator", "--ros-args"]
    place = nobody(kind)
    refused = subprocess.run([*command, "-p", "task:=nowhere"], stdout=place, stderr=place)
    assert refused.returncode == 2


def test_without_a_stream_nothing_is_said(monkeypatch):
    with open(os.devnull, "w") as closed:
        pass
    for stream in (None, closed):
        monkeypatch.setattr(sys, "stderr", stream)
        say("a word")


TALKER = """
import sys
from rclpy.node import Node
from std_msgs.msg import String
from iolspi_ros import qos, runtime

class Talker(Node):
    failure = None

    def __init__(self, arguments):
        super().__init__("talker")
        self.out = self.create_publisher(String, "word", qos.OUTGOING)
        self.create_subscription(String, "begin", self.out.publish, qos.TASK)
        self.own = len(sys.argv) > 1

    def close(self):
        for number in range(200):
            self.out.publish(String(data=f"{number} ".ljust(20_000)))
        if self.own:
            runtime.destroy_publishers(self, self.out)

raise SystemExit(runtime.main(Talker, "talker", []))
"""
LISTENER = """
import rclpy
from std_msgs.msg import String
from iolspi_ros import qos
rclpy.init()
node = rclpy.create_node("listener")
node.create_subscription(String, "word", lambda m: print("heard", flush=True), qos.SAMPLES)
rclpy.spin(node)
"""


@contextmanager
def python(code, *arguments):
    process = subprocess.Popen([sys.executable, "-c", code, *arguments], stdout=subprocess.PIPE)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@pytest.mark.parametrize("own", [(), ("own",)])
def test_what_is_said_last_is_heard(ros, own):
    peer = Peer(ros)
    peer.listen("word", String, qos.SAMPLES)
    with python(TALKER, *own) as talker:
        peer.publisher("begin", String, qos.LATCHED).publish(String())
        peer.until(lambda: peer.heard["word"])  # each has found the other
        talker.send_signal(signal.SIGINT)
        peer.until(lambda: talker.poll() is not None)
        peer.until(lambda: len(peer.heard["word"]) == 201)
    assert talker.returncode == 0


def test_who_listens_no_more_is_not_waited_for_without_end(ros):
    peer = Peer(ros)
    with python(LISTENER) as listener, python(TALKER) as talker:
        begin = peer.publisher("begin", String, qos.LATCHED)

        def found():
            begin.publish(String())
            return select.select([listener.stdout], [], [], 0.1)[0]

        peer.until(found)
        listener.kill()
        talker.send_signal(signal.SIGINT)
        peer.until(lambda: talker.poll() is not None, deadline=15.0)  # its lease is 20 s
    assert talker.returncode == 0
