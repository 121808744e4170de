"""A robot's own topics as a vehicle: what a file may say, and how the robot is treated."""

import json
import math
from pathlib import Path

import pytest
from geometry_msgs.msg import Quaternion, Twist
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from trajectory_msgs.msg import JointTrajectory

from iolspi_ros.core.learner import Source
from iolspi_ros.errors import InputError
from msg_bridge.ros.description import read_robot
from msg_bridge.ros.drive import Drive, Phase
from msg_bridge.ros.fields import Path as FieldPath
from msg_bridge.ros.fields import yaw
from msg_bridge.ros.sensing import Sensing

PARK = Path(__file__).parent.parent / "examples" / "robot" / "park.yaml"
CART = {
    "name": "cart", "sampling_time": 0.1, "episode_steps": 5, "gamma": 0.9,
    "variables": [{"name": "x"}, {"name": "v"}],
    "actions": [{"name": "push", "value": 1.0}, {"name": "rest", "value": 0.0}], "neutral": 1,
    "reward": "-abs(next.x) + 0 * action", "terminated": "next.x > 9",
    "state": {
        "x": {"topic": "place", "type": "std_msgs/msg/Float64", "field": "data"},
        "v": {"rate_of": "x", "filter": 0.0},
    },
    "command": {
        "topic": "push", "type": "std_msgs/msg/Float64",
        "fields": {"data": {"value": "2 * value", "low": -3, "high": 3}},
    },
    "reset": {"settle": 0.0},
}  # fmt: skip
S = 1_000_000_000


def robot(tmp_path, **more):
    path = tmp_path / "robot.yaml"
    path.write_text(json.dumps(CART | more))
    return read_robot(path)


class Body:
    """Remembers what the robot was told and what was shown."""

    def __init__(self):
        self.commands, self.shown, self.said, self.resets = [], [], [], 0

    def command(self, action):
        self.commands.append(action)

    def show(self, observation):
        self.shown.append(observation)

    def say(self, text):
        self.said.append(text)

    def reset(self):
        self.resets += 1


class Bench:
    """A drive, a clock, and a place that is heard every 0.01 s."""

    def __init__(self, described):
        self.body = Body()
        self.drive = Drive(described, self.body)
        self.now, self.x, self.silent = S, 0.0, False
        self.drive.begin()
        self.drive.placed(self.now)

    def step(self, action=None, x=None, source=Source.EXPLOIT):
        """One sampling time, the state answered at once; x is heard ever after."""
        self.x = self.x if x is None else x
        for _ in range(10):
            self.now += S // 100
            if not self.silent:
                self.drive.hear("place", Float64(data=self.x), self.now)
        self.drive.tick(self.now)
        if action is not None and self.body.shown:
            seen = self.body.shown[-1]
            self.drive.answer(seen.episode, seen.step, action, source)
        self.drive.check()

    @property
    def keys(self):
        return [(o.episode, o.step) for o in self.body.shown]


def test_states_follow_one_another_and_say_what_was_applied(tmp_path):
    bench = Bench(robot(tmp_path))
    bench.step(0)
    bench.step(1, x=0.5)
    bench.step(0, x=1.0)
    assert bench.keys == [(0, 0), (0, 1), (0, 2)]
    assert [o.action for o in bench.body.shown] == [-1, 0, 1]
    assert [o.reward for o in bench.body.shown] == [0.0, -0.5, -1.0]
    assert bench.body.commands[-1] == 0
    assert len({o.stamp for o in bench.body.shown}) == 3


def test_states_say_who_chose_what_was_applied(tmp_path):
    """The neutral action of the robot's own is nobody's."""
    bench = Bench(robot(tmp_path, allowed={"push": "x < 0.6"}))
    for x, source in ((0.0, Source.EXPLORE), (0.5, Source.HUMAN), (1.0, Source.HUMAN)):
        bench.step(0, x, source)
    bench.step(0)
    assert [(o.action, o.source) for o in bench.body.shown] == [
        (-1, -1), (0, Source.EXPLORE), (0, Source.HUMAN), (1, Source.HOLD)
    ]  # fmt: skip


def test_the_clock_cuts_and_another_episode_begins_after_a_reset(tmp_path):
    bench = Bench(robot(tmp_path))
    for _ in range(6):
        bench.step(0)
    assert bench.body.shown[-1].truncated
    assert bench.drive.phase is Phase.RESETTING
    assert bench.body.resets == 2
    assert bench.body.commands[-1] == 1  # neutral
    bench.step()
    bench.drive.placed(bench.now)
    bench.step(0)
    assert bench.keys[-1] == (1, 0)


def test_an_end_by_its_rule_is_terminated(tmp_path):
    bench = Bench(robot(tmp_path))
    bench.step(0)
    bench.step(0, x=10.0)
    assert (bench.body.shown[-1].terminated, bench.body.shown[-1].truncated) == (True, False)


def test_nobody_answers_so_the_robot_rests_and_no_transition_is_formed(tmp_path):
    bench = Bench(robot(tmp_path))
    bench.step(0)
    bench.step()
    assert bench.body.commands[-1] == 1
    bench.step(0)
    assert bench.keys == [(0, 0), (0, 1), (0, 3)]
    assert bench.drive.counts["not answered"] == 1


def test_an_answer_that_is_late_or_of_another_step_does_nothing(tmp_path):
    bench = Bench(robot(tmp_path))
    bench.step()
    told = len(bench.body.commands)
    bench.drive.answer(0, 0, 0)
    bench.step(1)
    bench.drive.answer(0, 7, 0)
    assert 0 not in bench.body.commands[told:]


def test_a_first_state_that_nobody_answers_begins_again_with_another_number(tmp_path):
    bench = Bench(robot(tmp_path))
    bench.step()
    for _ in range(11):
        bench.step()
    assert bench.keys[0] == (0, 0)
    assert bench.keys[-1] == (1, 0)


def test_a_sensor_that_falls_silent_makes_fewer_transitions_and_a_robot_that_rests(tmp_path):
    bench = Bench(robot(tmp_path))
    bench.step(0)
    bench.silent = True
    bench.step(0)
    assert bench.keys == [(0, 0)]
    assert bench.body.commands[-1] == 1
    bench.silent = False
    bench.step(0)
    assert bench.keys == [(0, 0), (0, 3)]  # never neighbours
    bench.silent = True
    for _ in range(12):
        bench.step(0)
    assert bench.drive.phase is Phase.RESETTING
    assert "x (from place)" in bench.body.said[-1]


def test_a_machine_that_slept_leaves_the_step_out(tmp_path):
    bench = Bench(robot(tmp_path))
    bench.step(0)
    bench.now += S
    bench.step(0)
    assert bench.keys == [(0, 0), (0, 2)]


def test_a_limit_stops_the_robot_at_once_and_ends_the_episode_as_cut(tmp_path):
    bench = Bench(robot(tmp_path, limits={"x": [-2, 2]}))
    bench.step(0)
    bench.drive.hear("place", Float64(data=2.5), bench.now + 1)
    assert bench.body.commands[-1] == 1
    bench.drive.answer(0, 0, 0)  # the learner cannot pass
    assert bench.body.commands[-1] == 1
    bench.step(x=2.5)
    last = bench.body.shown[-1]
    assert (last.truncated, last.terminated, last.step) == (True, False, 2)
    bench.drive.placed(bench.now)
    bench.step(0)
    assert bench.keys[-1] == (0, 2)
    assert "beyond its limits -2 to 2" in bench.drive.trouble
    bench.step(0, x=0.0)
    assert bench.keys[-1] == (1, 0)


def test_an_action_that_is_not_allowed_here_becomes_the_neutral_one(tmp_path):
    bench = Bench(robot(tmp_path, allowed={"push": "x < 1"}))
    bench.step(0)
    bench.step(0, x=1.5)
    assert bench.body.commands[-1] == 1
    bench.step(0)
    assert [o.action for o in bench.body.shown] == [-1, 0, 1]
    assert bench.drive.counts["not let through"] == 2


def test_a_division_by_zero_stops_the_robot_and_says_where(tmp_path):
    bench = Bench(robot(tmp_path, reward="1 / next.x"))
    bench.step(0, x=1.0)
    bench.step(0, x=0.0)
    assert bench.drive.phase is Phase.STOPPED
    assert "reward (1 / next.x) cannot be computed" in bench.drive.trouble
    assert bench.body.commands[-1] == 1
    told = len(bench.body.shown)
    bench.step(0, x=1.0)
    assert len(bench.body.shown) == told
    bench.drive.begin()  # a person asks for it
    bench.drive.placed(bench.now)
    bench.step(0)
    assert bench.drive.phase is Phase.EPISODE


def test_an_episode_waits_until_the_robot_is_where_it_is_to_start(tmp_path):
    bench = Bench(robot(tmp_path, reset={"settle": 0.0, "ready": "abs(x) < 0.1"}))
    bench.step(0, x=3.0)
    assert bench.keys == []
    assert "abs(x) < 0.1 does not hold" in bench.drive.trouble
    bench.step(0, x=0.05)
    bench.step(0)
    assert bench.keys[0] == (0, 0)


def test_rates_are_filtered_differences_and_periodic_ones_take_the_short_way(tmp_path):
    turning = {
        "variables": [{"name": "a", "low": -math.pi, "high": math.pi, "periodic": True},
                      {"name": "w"}],
        "reward": 0.0, "terminated": False,
        "state": {"a": {"topic": "place", "type": "std_msgs/msg/Float64", "field": "data",
                        "scale": "pi / 180"},
                  "w": {"rate_of": "a", "filter": 0.1}},
    }  # fmt: skip
    sensing = Sensing(robot(tmp_path, **turning))
    sensing.hear("place", Float64(data=175.0), S)
    with pytest.raises(InputError, match=r"w \(from place\) was never heard"):
        sensing.state(S)
    sensing.hear("place", Float64(data=-175.0), 2 * S)
    angle, rate = sensing.state(2 * S)
    assert angle == pytest.approx(math.radians(-175))
    assert rate == pytest.approx(math.radians(10))
    sensing.hear("place", Float64(data=-165.0), round(2.1 * S))  # 100 degrees a second, half of it
    assert sensing.state(round(2.1 * S))[1] == pytest.approx(math.radians((10 + 100) / 2))
    with pytest.raises(InputError, match=r"0.200 s old; allowed: less than 0.1 s"):
        sensing.state(round(2.3 * S))


def test_fields_are_read_by_name_place_and_yaw():
    joints = JointState(name=["wheel", "shaft"], position=[1.0, 2.0])
    assert FieldPath("position[shaft]", JointState, "x").number(joints) == 2.0
    assert FieldPath("position[0]", JointState, "x").number(joints) == 1.0
    with pytest.raises(InputError, match="its list has 2 entries"):
        FieldPath("position[arm]", JointState, "x").number(joints)
    odometry = Odometry()
    odometry.pose.pose.orientation = Quaternion(z=math.sin(0.6), w=math.cos(0.6))
    found = FieldPath("pose.pose.orientation", Odometry, "x").get(odometry)
    assert yaw(found) == pytest.approx(1.2)


def test_what_actions_publish(tmp_path):
    (output,) = read_robot(PARK).outputs
    assert output.message(1) == Twist(linear=SimpleTwist(0.5), angular=output.message(1).angular)
    arm = robot(
        tmp_path,
        command={
            "topic": "arm/joint_trajectory", "type": "trajectory_msgs/msg/JointTrajectory",
            "constants": {"joint_names": ["shaft"]},
            "fields": {"points[0].velocities[0]": "value",
                       "points[0].time_from_start.nanosec": 200000000},
        },
    )  # fmt: skip
    message = arm.outputs[0].message(0)
    assert isinstance(message, JointTrajectory)
    assert message.joint_names == ["shaft"]
    assert list(message.points[0].velocities) == [1.0]
    assert message.points[0].time_from_start.nanosec == 200000000


def SimpleTwist(x):
    from geometry_msgs.msg import Vector3

    return Vector3(x=x)


def changed(part, **more):
    return {part: CART[part] | more}


PLACE = CART["state"]["x"]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"reward": "-abs(next.y)"}, "there is no next.y"),
        ({"reward": "-absolute(x)"}, "there is no function absolute"),
        ({"reward": "__import__('os').system('touch owned')"}, "there is no function"),
        ({"terminated": "x >"}, "terminated is 'x >'"),
        ({"wings": 2}, "'wings'; allowed"),
        ({"state": {"x": PLACE}}, "state has no v"),
        (changed("state", z=PLACE), "state has 'z'; allowed: x, v"),
        (changed("state", x=PLACE | {"type": "std_msgs/msg/Float"}), "which is not installed"),
        (changed("state", x=PLACE | {"type": "os.system"}), "a type such as"),
        (changed("state", x=PLACE | {"field": "value"}), "has no field value; allowed: data"),
        (changed("state", x=PLACE | {"field": "data.x"}), "float has no field x"),
        (changed("state", x=PLACE | {"field": "data", "yaw": "data"}), "and not both"),
        (changed("state", x=PLACE | {"topic": "a b"}), "a name such as /odom"),
        (changed("state", x=PLACE | {"qos": "fast"}), "allowed: best_effort, reliable, latched"),
        (changed("state", x=PLACE | {"scale": "1 / 0"}), "division by zero"),
        (changed("state", v={"expression": "2 * v"}), "there is no v"),
        ({"inputs": {"x": PLACE}}, "inputs has 'x', which is a variable"),
        (changed("state", v={"rate_of": "v"}), "rate_of in state of v is 'v'; allowed: x"),
        (changed("command", fields={"data": "2 * speed"}), "there is no speed"),
        (changed("command", fields={"datum": 1}), "has no field datum"),
        (changed("command", fields={"data": {"value": 5, "high": 3}}), "is 5.0 for action push"),
        ({"command": {"topic": "t", "type": "std_msgs/msg/String", "fields": {"data": 1}}},
         "no number"),
        ({"limits": {"x": [2, 1]}}, "allowed: lowest < highest"),
        ({"limits": {"y": [1, 2]}}, "limits has 'y'"),
        ({"allowed": {"rest": "x > 1"}}, "the neutral action; it is always allowed"),
        ({"allowed": {"fly": "x > 1"}}, "allowed has 'fly'; allowed: push, rest"),
        ({"reset": {"service": "a", "button": 1}}, "one of them, or none"),
        ({"answer_within": 1.0}, "answer_within in the task is 1.0; allowed: [0.0, 0.05]"),
        ({"sampling_time": 0.0}, "sampling_time"),
    ],
)  # fmt: skip
def test_a_file_that_will_not_do_is_named(tmp_path, monkeypatch, change, says):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError) as error:
        robot(tmp_path, **change)
    assert says in str(error.value)
    assert "robot.yaml" in str(error.value)
    assert not (tmp_path / "owned").exists()


def test_code_in_a_file_is_not_run(tmp_path):
    path = tmp_path / "robot.yaml"
    path.write_text(f"name: !!python/object/apply:os.system ['touch {tmp_path}/owned']")
    with pytest.raises(InputError, match="is no YAML"):
        read_robot(path)
    assert not (tmp_path / "owned").exists()


def test_the_example_is_a_robot():
    described = read_robot(PARK)
    assert described.task.names == ("distance", "bearing")
    assert described.rules.judge((1, 0), 1, (0.1, 0)) == (10.0, True, False)
    sensing, odometry = Sensing(described), Odometry()
    odometry.pose.pose.position.x, odometry.pose.pose.position.y = -3.0, 4.0
    odometry.pose.pose.orientation = Quaternion(z=math.sin(0.5), w=math.cos(0.5))
    sensing.hear("odom", odometry, S)
    assert sensing.state(S) == pytest.approx([5.0, math.atan2(-4.0, 3.0) - 1.0])
