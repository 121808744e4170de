"""Whatever comes from outside is taken or refused with words; nothing else, and at once."""

import array
import contextlib
import io
import shutil
import zipfile

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, String

from iolspi_ros import arguments, bags, task, wire
from iolspi_ros.bags import Damage, reader, survey
from iolspi_ros.errors import InputError
from iolspi_ros.saving import checkpoint
from iolspi_ros.task import plain
from sim_nodes.tasks.pendulum import Pendulum

WHOLE = task.dump(Pendulum.description)
PARTS = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=12), inner),
    max_leaves=12,
)
TEXTS = st.text(max_size=300) | st.text("[]{}:,-&*!|>?%@`'\" \n\tab01", max_size=300)


def changed(text, place, new):
    place %= len(text)
    return text[:place] + new + text[place + len(new) :]


CHANGES = st.builds(changed, st.just(WHOLE), st.integers(0, 2**16), st.text(max_size=8))


@given(TEXTS | CHANGES)
def test_any_text_is_a_task_or_refused(text):
    with contextlib.suppress(InputError):
        task.load(text, "here")
    with contextlib.suppress(InputError):
        wire.read_task(String(data=text.encode("utf-8", "replace").decode()), "there")


@given(st.dictionaries(st.sampled_from(list(plain.parse(WHOLE, "here"))), PARTS))
def test_any_value_in_a_task_is_taken_or_refused(values):
    import json

    with contextlib.suppress(InputError):
        task.load(json.dumps(plain.parse(WHOLE, "here") | values), "here")


@given(TEXTS)
def test_any_text_is_parameters_or_refused(tmp_path, text):
    path = tmp_path / "file.yaml"
    path.write_text(text, encoding="utf-8", errors="replace")
    with contextlib.suppress(InputError):
        arguments.read_sections(path)
    (tmp_path / bags.CARD).write_text(text, encoding="utf-8", errors="replace")
    with contextlib.suppress(InputError):
        assert isinstance(bags.read_card(tmp_path), dict)


LAYOUTS = st.lists(
    st.tuples(st.text(max_size=60), st.integers(0, 9), st.integers(0, 9)), max_size=3
)


@given(LAYOUTS, st.lists(st.floats(), max_size=20), st.integers(0, 5))
@pytest.mark.parametrize("label", [None, wire.ACTION, wire.SCORE, wire.DEMONSTRATION])
def test_any_row_is_read_or_refused(label, layout, data, offset):
    message = Float64MultiArray(data=array.array("d", data))
    message.layout.data_offset = offset
    message.layout.dim = [MultiArrayDimension(label=a, size=b, stride=c) for a, b, c in layout]
    if label and message.layout.dim:
        message.layout.dim[0].label = ",".join(label)
    readers = [
        wire.Rows("action", wire.ACTION).read, wire.Rows("update", wire.UPDATE).read_all,
        wire.SampleRows(Pendulum.description.names).sample, wire.RewardRows().read,
        wire.read_weights,
    ]  # fmt: skip
    for read in readers:
        with contextlib.suppress(InputError):
            read(message)


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf, 1e300, 0.5])
def test_no_number_of_an_update_is_more_than_unknown(number):
    message = wire.weights_message(np.ones((2, 3)), 4)
    message.data[0] = number
    weights, found = wire.read_weights(message)
    assert (weights.shape, found) == ((2, 3), -1)


@given(st.binary(max_size=400), st.booleans())
def test_any_bytes_are_a_checkpoint_or_refused(tmp_path, data, sealed):
    path, file = tmp_path / "c.npz", io.BytesIO()
    with zipfile.ZipFile(file, "w") as packed:
        packed.writestr("about.npy", data)
        packed.comment = bytes(71)
    if sealed:
        end = file.seek(-71, 2)
        data = file.getvalue()[:end] + checkpoint._digest(file, end)
    path.write_bytes(data)
    with pytest.raises(InputError):
        checkpoint.read(path)


@given(st.binary(max_size=400), st.sampled_from(["bag.mcap", "bag.db3"]), st.booleans())
def test_any_bytes_are_a_bag_or_refused(tmp_path, data, name, magic):
    for path in tmp_path.iterdir():
        path.unlink()
    (tmp_path / name).write_bytes(b"\x89MCAP0\r\n" + data if magic else data)
    damage = Damage()
    assert not list(bags.records(tmp_path, damage))
    assert damage.notes


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["task", "/v1/task", "sample", "/v1/sample", "state", "reward"]),
            st.sampled_from([reader.TEXT, wire.ROW, "sensor_msgs/msg/JointState"]),
            st.binary(max_size=120) | st.binary(max_size=120).map(b"\0\1\0\0".__add__),
        ),
        max_size=5,
    )
)
def test_any_message_of_a_whole_bag_is_read_or_refused(tmp_path, messages):
    shutil.rmtree(tmp_path / "bag", ignore_errors=True)
    with bags.BagWriter(tmp_path / "bag") as writer:
        for n, (topic, kind, data) in enumerate(messages):
            writer.write(topic, kind, n, data)
    with contextlib.suppress(InputError):
        bags.read_demonstration(tmp_path / "bag", Pendulum.description)
    survey.contents(tmp_path / "bag")


def test_a_task_in_a_bag_that_is_none_is_refused_with_words(tmp_path):
    with bags.BagWriter(tmp_path / "bag") as writer:
        writer.write("task", reader.TEXT, 0, b"")
    assert "a message on task is unreadable: 0 bytes" in survey.contents(tmp_path / "bag").damage[0]
    with pytest.raises(InputError, match="a message on task is unreadable"):
        bags.read_demonstration(tmp_path / "bag", Pendulum.description)
