import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from msg_bridge.frames import swap_body, swap_world

vectors = arrays(float, (4, 3), elements=st.floats(-1e6, 1e6))


def test_known_vectors():
    """One metre east, north and up; forward, left and up (REP-103, and NED, FRD beside it)."""
    np.testing.assert_array_equal(swap_world(np.eye(3)), [[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    np.testing.assert_array_equal(swap_body(np.eye(3)), [[1, 0, 0], [0, -1, 0], [0, 0, -1]])


@given(vectors)
def test_there_and_back(v):
    np.testing.assert_array_equal(swap_world(swap_world(v)), v)
    np.testing.assert_array_equal(swap_body(swap_body(v)), v)


def test_both_frames_stay_right_handed():
    for swap in (swap_world, swap_body):
        x, y, z = swap(np.eye(3))
        np.testing.assert_array_equal(np.cross(x, y), z)
