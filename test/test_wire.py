import contextlib
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension

from iolspi_ros import bags, wire
from iolspi_ros.core.samples import Observation, Sample, Transition
from iolspi_ros.errors import InputError
from iolspi_ros.task import Action, TaskDescription, Variable

doubles = st.floats(width=64)
stamps = st.integers(0, 2**31 * 10**9 - 1)
joint_names = st.lists(st.from_regex(r"[a-z][a-z_0-9]{0,8}", fullmatch=True), min_size=1,
                       max_size=3, unique=True)  # fmt: skip


def over_the_wire(message):
    return deserialize_message(serialize_message(message), type(message))


def both_ways(packed, kind):
    """Packed bytes as they are, as rclpy reads them, and as rclpy writes them again."""
    message = deserialize_message(packed, kind)
    return packed, message, serialize_message(message)


@given(joint_names, st.data())
def test_states_come_back_as_they_went(joints, data):
    state = np.array(data.draw(st.lists(doubles, min_size=2 * len(joints),
                                        max_size=2 * len(joints))))  # fmt: skip
    stamp = data.draw(stamps)
    states = wire.JointStates(joints)
    packed = states.of(Observation(0, 0, state, stamp=stamp))
    for message in both_ways(packed, JointState):
        back, when = states.state(message)
        np.testing.assert_array_equal(back, state)
        assert when == stamp


@given(joint_names, st.data())
def test_states_of_other_variables_are_rows(names, data):
    state = np.array(data.draw(st.lists(doubles, min_size=len(names), max_size=len(names))))
    rows = wire.StateRows([f"x_{name}" for name in names])
    stamp = data.draw(stamps)
    for message in both_ways(rows.of(Observation(2, 3, state, stamp=stamp)), Float64MultiArray):
        back, when = rows.state(message)
        np.testing.assert_array_equal(back, state)
        assert when == stamp


def test_bytes_of_another_shape_are_read_by_name_all_the_same():
    """Joints in another order, with a frame; a row with more entries."""
    message = JointState(name=["b", "a"], position=[3.0, 1.0], velocity=[4.0, 2.0])
    message.header.frame_id = "world"
    state, _ = wire.JointStates(("a", "b")).state(serialize_message(message))
    assert state.tolist() == [1.0, 2.0, 3.0, 4.0]
    longer = wire.Rows("x", ("more", *wire.REWARD)).message(9, *range(9))
    assert list(wire.RewardRows().read(serialize_message(longer))) == list(range(9))


def test_a_reward_and_a_score_from_before_say_nothing_of_people():
    """Rows of nodes and bags that do not know these entries."""
    reward = wire.Rows("reward", wire.REWARD[:-1]).message(*range(8))
    score = wire.Rows("score", wire.SCORE[:-1]).message(*range(7))
    for message in (reward, serialize_message(reward)):
        assert list(wire.RewardRows().read(message)) == [*range(8), -1.0]
    assert list(wire.ScoreRows().read(score)) == [*range(7), 0.0]
    with pytest.raises(InputError, match="no entry source"):
        wire.Rows("action", wire.ACTION).read(wire.Rows("x", wire.ACTION[:-1]).message(*range(5)))


@given(joint_names, st.data())
def test_samples_come_back_as_they_went(joints, data):
    vectors = st.lists(doubles, min_size=2 * len(joints), max_size=2 * len(joints))
    transition = Transition(
        np.array(data.draw(vectors)), data.draw(st.integers(0, 9)), data.draw(doubles),
        np.array(data.draw(vectors)), data.draw(st.booleans()), data.draw(st.booleans()),
    )  # fmt: skip
    sample = Sample(data.draw(st.integers(0, 10**9)), 7, data.draw(stamps), transition, 3)
    rows = wire.SampleRows([f"{joint}.{what}" for joint in joints for what in ("p", "v")])
    for message in both_ways(rows.of(sample), Float64MultiArray):
        back = rows.sample(message)
        assert (back.episode, back.step, back.stamp, back.source) == (
            sample.episode, 7, sample.stamp, 3,
        )  # fmt: skip
        for found, sent in zip(back.transition, transition, strict=True):
            np.testing.assert_array_equal(found, sent)


@given(doubles, st.integers(-1, 9), st.booleans(), st.booleans(), stamps)
def test_observations_come_back_as_they_went(reward, action, terminated, truncated, stamp):
    rows = wire.RewardRows()
    sent = Observation(3, 4, np.zeros(2), reward, action, terminated, truncated, stamp)
    for message in both_ways(rows.of(sent), Float64MultiArray):
        values = rows.read(message)
        back = rows.observation(values, np.zeros(2), stamp)
        assert wire.join(values[2], values[3]) == stamp
        assert back.reward == reward or math.isnan(reward)
        assert (back.action, back.terminated, back.truncated) == (action, terminated, truncated)


def test_numpy_numbers_and_flags_arrive_as_they_are():
    """rclpy does not check fields: unconverted, these arrive as garbage."""
    row = wire.Rows("action", wire.ACTION)
    sent = (np.int64(5), np.int32(2), 1, np.uint8(9), np.float32(1.5), np.bool_(True))
    assert list(row.read(over_the_wire(row.message(*sent)))) == [5.0, 2.0, 1.0, 9.0, 1.5, 1.0]


def test_entries_are_read_by_name():
    strange = wire.Rows("x", ("reward", "extra", *reversed(wire.KEY), "terminated", "truncated",
                              "action"))  # fmt: skip
    values = wire.RewardRows().read(strange.message(-2.5, 99, 4, 3, 2, 1, 0, 1, 2))
    assert list(values) == [1, 2, 3, 4, -2.5, 0, 1, 2, -1]


def test_what_is_missing_is_named():
    with pytest.raises(InputError, match="reward has no entry terminated, truncated, action"):
        wire.RewardRows().read(wire.Rows("x", (*wire.KEY, "reward")).message(0, 0, 0, 0, 0))
    with pytest.raises(InputError, match="reward has no entry"):
        wire.RewardRows().read(Float64MultiArray())
    short = wire.RewardRows().message(*range(9))
    short.data = short.data[:3]
    with pytest.raises(InputError, match="has 3 entries for the label"):
        wire.RewardRows().read(short)


def test_joints_are_found_by_name_and_missing_ones_named():
    sent = Observation(0, 0, np.array([1.0, 2.0, 3.0, 4.0]), stamp=5)
    message = deserialize_message(wire.JointStates(("b", "a")).of(sent), JointState)
    state, _ = wire.JointStates(("a", "b")).state(message)
    assert state.tolist() == [3.0, 4.0, 1.0, 2.0]
    with pytest.raises(InputError, match="not shaft; allowed"):
        wire.JointStates(("shaft",)).state(message)
    with pytest.raises(InputError, match="0 positions and 0 velocities"):
        wire.JointStates(("shaft",)).state(JointState(name=["shaft"]))


def test_weights_come_back():
    weights = np.random.default_rng(0).standard_normal((3, 7))
    back, number = wire.read_weights(over_the_wire(wire.weights_message(weights, 12)))
    np.testing.assert_array_equal(back, weights)
    assert number == 12


def test_a_bag_reads_what_rclpy_wrote_without_rclpy():
    states = wire.JointStates(("shaft",))
    message = states.of(Observation(0, 0, np.array([0.5, -1.0]), stamp=10**9 + 5))
    record = bags.Record("state", states.kind, 0, message)
    state, stamp = states.state(bags.deserialise(record))
    assert (state.tolist(), stamp) == ([0.5, -1.0], 10**9 + 5)


THREE = TaskDescription(
    "tank", (Variable("level", "m"), Variable("in.flow"), Variable("heat", "K")),
    (Action("shut"), Action("open")), 0.5,
)  # fmt: skip


@given(st.lists(doubles, min_size=3, max_size=3), stamps)
def test_states_of_any_variables_come_back_as_rows(values, stamp):
    states = wire.states(THREE)
    assert isinstance(states, wire.StateRows)
    assert THREE.joints == ()
    packed = states.of(Observation(3, 7, np.array(values), stamp=stamp))
    message = deserialize_message(packed, Float64MultiArray)
    assert message.layout.dim[0].label == "episode,step,sec,nanosec,level,in.flow,heat"
    assert list(message.data[:2]) == [3.0, 7.0]
    back, when = states.state(message)
    np.testing.assert_array_equal(back, values)
    assert when == stamp


def test_a_row_of_other_variables_names_what_is_missing():
    other = wire.StateRows(("level", "cold"))
    message = other.of(Observation(0, 0, np.zeros(2)))
    with pytest.raises(InputError, match=r"state has no entry in.flow, heat in its label"):
        wire.states(THREE).state(message)


def test_rows_of_states_are_found_by_name():
    mixed = wire.StateRows(("heat", "level", "in.flow"))
    message = mixed.of(Observation(0, 0, np.array([1.0, 2.0, 3.0]), stamp=5))
    state, stamp = wire.states(THREE).state(message)
    assert (state.tolist(), stamp) == ([2.0, 3.0, 1.0], 5)


@pytest.mark.parametrize(
    "names",
    [("x.position",), ("x.position", "y.velocity"), ("x.velocity", "x.position"),
     ("x.position", "x.velocity", "y.position"), ("x", "v")],
)  # fmt: skip
def test_only_pairs_of_position_and_velocity_are_joints(names):
    task = TaskDescription("t", tuple(map(Variable, names)), (Action("a"),), 0.1)
    assert task.joints == ()
    assert isinstance(wire.states(task), wire.StateRows)


def test_the_order_on_the_wire_is_the_contract_s():
    """docs/interfaces.md says it; nothing follows from the order of a dataclass's fields."""
    transition = Transition(np.array([1.0, 2.0, 3.0]), 1, -4.0, np.array([5.0, 6.0, 7.0]), 1, 0)
    packed = wire.SampleRows(THREE.names).of(Sample(8, 9, 10 * 10**9 + 11, transition, 2))
    message = deserialize_message(packed, Float64MultiArray)
    assert message.layout.dim[0].label == (
        "episode,step,sec,nanosec,level,in.flow,heat,action,reward,next.level,next.in.flow,"
        "next.heat,terminated,truncated,source"
    )
    assert list(message.data) == [8, 9, 10, 11, 1, 2, 3, 1, -4, 5, 6, 7, 1, 0, 2]
    packed = wire.RewardRows().of(Observation(1, 2, np.zeros(3), -3.0, 4, False, True, 5, 2))
    message = deserialize_message(packed, Float64MultiArray)
    assert message.layout.dim[0].label == (
        "episode,step,sec,nanosec,reward,terminated,truncated,action,source"
    )
    assert list(message.data) == [1, 2, 0, 5, -3, 0, 1, 4, 2]
    assert ",".join(wire.ACTION) == "episode,step,sec,nanosec,action,source"


def test_a_task_travels_as_a_text():
    message = over_the_wire(wire.task_message(THREE))
    assert wire.read_task(message, "here") == THREE
    message.data = "]:"
    with pytest.raises(InputError, match="here is no YAML"):
        wire.read_task(message, "here")


def test_no_number_is_taken_for_another():
    assert [wire.whole(x) for x in (2.0, -3.0, 2.5, math.nan, math.inf, 2.0**53)] == [
        2, -3, -1, -1, -1, -1,
    ]  # fmt: skip
    assert wire.join(1.0, 5.0) == 10**9 + 5
    assert wire.join(-1.0, 5.0) == wire.join(0.0, -2.0) == wire.join(0.5, 0.0) == -1


row_names = st.lists(st.from_regex(r"[a-z._]{1,9}", fullmatch=True), min_size=1, max_size=9,
                     unique=True)  # fmt: skip


@given(row_names, st.data())
def test_packed_rows_are_the_message_for_any_length_of_the_label(names, data):
    rows = wire.Rows("x", names)
    values = data.draw(st.lists(doubles, min_size=len(names), max_size=len(names)))
    packed, message = rows.pack(*values), rows.message(*values)
    there = deserialize_message(packed, Float64MultiArray)
    assert there.layout == message.layout
    for sent in (packed, there, serialize_message(message)):
        np.testing.assert_array_equal(rows.read(sent), values)
    assert list(rows.read_all(message)) == names


def test_bytes_are_checked_as_messages_are():
    rows = wire.Rows("x", ("a", "b"))
    two = rows.message(1.0, 2.0)
    two.layout.dim = [two.layout.dim[0], MultiArrayDimension(label="b,a")]  # the first counts
    assert list(rows.read(serialize_message(two))) == [1.0, 2.0]
    short = rows.message(1.0, 2.0)
    short.data = short.data[:1]
    with pytest.raises(InputError, match="x has 1 entries for the label"):
        rows.read(serialize_message(short))


@given(st.binary(max_size=200), st.integers(0, 200))
def test_bytes_that_are_no_message_are_refused(junk, cut):
    rows, states = wire.Rows("x", ("a", "b")), wire.JointStates(("a",))
    whole = rows.pack(1.0, 2.0)
    for data in (junk, whole[: min(cut, len(whole) - 1)], whole[:20] + junk):
        with contextlib.suppress(InputError):
            assert len(rows.read(data)) == 2
        with contextlib.suppress(InputError):
            assert states.state(data)[0].shape == (2,)
