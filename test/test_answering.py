"""Nothing that is computed keeps a learner from answering, saving and ending."""

import signal

import pytest
from conftest import Peer, spin_until
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool

from iolspi_ros import runtime
from iolspi_ros.core.learner import Source
from iolspi_ros.resources import find
from iolspi_ros.saving import checkpoint

SLOW = """
import sys, time
sys.path.insert(0, {examples!r})
from q_learning import QLearning

class Slow(QLearning):
    def begin_update(self):
        def compute():
            print("computing", flush=True)
            time.sleep(600.0)
        return compute

class Busy(QLearning):
    def begin_update(self):
        def compute():
            print("computing", flush=True)
            while True:
                pass
        return compute

class Failing(QLearning):
    def begin_update(self):
        return lambda: 1 / 0

class Lasting(QLearning):
    def pretrain(self, demonstrations, proceed=None):
        self.weights[:] = 1.0
        time.sleep(600.0)
"""


@pytest.fixture
def slow(nodes, tmp_path):
    examples = find("package.xml").parent / "examples"
    (tmp_path / "slow.py").write_text(SLOW.format(examples=str(examples / "learner")))
    path = nodes.env.get("PYTHONPATH", "")
    nodes.env["PYTHONPATH"] = f"{tmp_path}:{find('package.xml').parent}:{path}"
    return nodes


def arguments(tmp_path, learner, *more):
    return [
        "-p", f"learner:learner:=slow:{learner}", "-p", "learner:update_interval:=100",
        "-p", f"learner:checkpoint:={tmp_path / 'c.npz'}", *more,
    ]  # fmt: skip


def answer(ros, seconds):
    """A service's answer, within some seconds."""
    node = ros.create_node("asker")
    loop = runtime.Loop(node)
    client = node.create_client(SetBool, "/learner/learn")
    spin_until(loop, client.service_is_ready)
    future = client.call_async(SetBool.Request(data=True))
    spin_until(loop, future.done, seconds)
    node.destroy_node()
    return future.result().success


@pytest.mark.parametrize("learner", ["Slow", "Busy"])
@pytest.mark.parametrize("background", ["false", "true"])
def test_an_update_without_end(slow, ros, tmp_path, learner, background):
    more = ["-p", "learner:wait_for_demonstrations:=false",
            "-p", f"learner:background:={background}"]  # fmt: skip
    slow.start("graph", *arguments(tmp_path, learner, *more))
    slow.wait_for("graph", "computing")
    assert answer(ros, 60.0)
    assert slow.end("graph", signal.SIGTERM) == 0, slow.log("graph")  # soon, or it is killed
    step = checkpoint.read(tmp_path / "c.npz").about["parts"]["learner"]["step"]
    assert step == 100 if background == "false" else step >= 100


@pytest.mark.parametrize("vehicle", ["beside", "in this process"])
def test_a_vehicle_that_does_not_wait_for_an_update_is_flown_and_it_is_said(
    slow, ros, tmp_path, vehicle
):
    """In real time, with an update that never ends, and `background` left as it is."""
    peer = Peer(ros)
    peer.listen("action", Float64MultiArray)
    more = ["-p", "learner:wait_for_demonstrations:=false", "-p", "simulator:mode:=realtime"]
    parts = ("graph",) if vehicle == "in this process" else ("learner", "simulator")
    for part in parts:
        slow.start(part, *arguments(tmp_path, "Slow", *more))
    slow.wait_for(parts[0], "the vehicle does not wait")
    n = len(peer.heard["action"])
    peer.until(lambda: len(peer.heard["action"]) > n + 50)
    answered = [message.data[5] for message in peer.heard["action"][n:]]
    assert {Source.EXPLORE, Source.EXPLOIT} & set(answered)
    assert slow.log(parts[0]).count("does not wait") == 1
    assert slow.end(parts[0], signal.SIGTERM) == 0, slow.log(parts[0])
    assert checkpoint.read(tmp_path / "c.npz").about["parts"]["learner"]["step"] > 100


def test_an_update_that_fails_is_said_and_the_flight_goes_on(slow, tmp_path):
    more = ["-p", "learner:wait_for_demonstrations:=false", "-p", "simulator:episodes:=2"]
    slow.start("graph", *arguments(tmp_path, "Failing", *more))
    slow.wait_for("graph", "update failed, the policy before it stays: ZeroDivisionError")
    slow.wait_for("graph", "done: 2 episodes")
    assert slow.end("graph") == 0


def test_half_of_offline_learning_is_not_saved_and_not_flown(slow, tmp_path):
    bag = find("demos", "pendulum", "set_5")
    slow.start("graph", *arguments(tmp_path, "Lasting", "-p", f"demonstrator:bags:=[{bag}]"))
    slow.wait_for("graph", "learning offline from")
    assert slow.end("graph") == 0
    content = checkpoint.read(tmp_path / "c.npz")
    assert not content.arrays["learner.weights"].any()
    assert content.about["parts"]["flight"]["ready"] is False
    again = arguments(tmp_path, "Lasting", "-p", "learner:resume:=true")
    slow.start("graph", *again, name="again")
    slow.wait_for("again", "waiting for a demonstration")
    assert slow.end("again") == 0
