from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from iolspi_ros.core.buffer import Buffer, Cells
from iolspi_ros.core.samples import Transitions

CELLS = Cells((0.0,), (4.0,), (4,))


def batch(places, action=0, first=0):
    """Transitions in given places; the reward numbers them."""
    n = len(places)
    state = np.array(places, float)[:, None]
    none = np.zeros(n, bool)
    reward = np.arange(first, first + n, dtype=float)
    return Transitions(state, np.full(n, action), reward, state, none, none)


def numbers(buffer):
    return buffer.transitions.reward.astype(int).tolist()


def test_the_oldest_of_a_crowded_box_goes():
    buffer = Buffer.empty(CELLS, 2, 100, True).add(batch([0.1, 3.5, 0.2, 0.3]), step=4)
    assert numbers(buffer) == [1, 2, 3]
    assert buffer.born.tolist() == [2, 3, 4]
    other = buffer.add(batch([0.5, 0.6], action=1, first=4), step=6)  # another action: apart
    assert numbers(other) == [1, 2, 3, 4, 5]


def test_beyond_the_limits_counts_as_the_outermost_box():
    cell = CELLS(np.array([[-9.0], [0.1], [3.9], [99.0]]), np.zeros(4, int))
    assert cell.tolist() == [0, 0, 3, 3]


def test_when_full_the_fullest_boxes_are_thinned_and_then_the_oldest_go():
    buffer = Buffer.empty(CELLS, 3, 4, True).add(batch([0, 0, 0, 1, 1, 2]), step=6)
    assert numbers(buffer) == [2, 3, 4, 5]  # one of each box, and the newest of the seconds
    small = Buffer.empty(CELLS, 3, 2, True).add(batch([0, 1, 2, 3]), step=4)
    assert numbers(small) == [2, 3]


def test_demonstrations_stay_by_choice():
    for keep, left in ((True, [1, 2, 3]), (False, [2, 3])):
        buffer = Buffer.empty(CELLS, 2, 100, keep).add(batch([0, 0]), step=0, demonstrated=True)
        assert numbers(buffer) == [0, 1]
        assert numbers(buffer.add(batch([0, 0], first=2), step=2)) == left
        shown = np.array([True, False, False, False])  # some of what came while flying
        mixed = Buffer.empty(CELLS, 2, 100, keep).add(batch([0] * 4), 4, shown)
        assert numbers(mixed) == ([0, 2, 3] if keep else [2, 3])


@given(
    st.lists(st.tuples(st.integers(0, 3), st.booleans()), min_size=1, max_size=40),
    st.integers(1, 4),
    st.integers(1, 12),
)
def test_it_is_bounded_and_loses_nothing_that_fits(stream, per_cell, bound):
    buffer = Buffer.empty(CELLS, per_cell, bound, keep_demonstrations=False)
    for step, (place, action) in enumerate(stream, 1):
        buffer = buffer.add(batch([place + 0.5], int(action), step), step)
    assert len(buffer) <= bound
    per_box = [stream.count(box) for box in set(stream)]
    assert len(buffer) == min(bound, sum(min(n, per_cell) for n in per_box))
    assert buffer.born.tolist() == numbers(buffer) == sorted(numbers(buffer))
    assert numbers(buffer)[-1] == len(stream)  # the newest is always there


def test_crowds_count_no_more_than_one():
    buffer = Buffer.empty(CELLS, 8, 100, True).add(batch([0, 0, 0, 0, 2, 3, 3]), step=7)
    np.testing.assert_allclose(buffer.weight(7, 1.0), [0.25] * 4 + [1.0] + [0.5] * 2)


def test_what_is_k_steps_old_counts_eta_to_the_k():
    eta = 0.9
    alone = Buffer.empty(CELLS, 8, 100, True).add(batch([0, 1, 2]), step=3)
    np.testing.assert_allclose(alone.weight(13, eta), eta ** np.array([12, 11, 10]))
    box = replace(alone, transitions=batch([1, 1, 1]))
    shares = eta ** np.array([2.0, 1.0, 0.0])
    np.testing.assert_allclose(box.weight(3, eta), shares / shares.sum())
