import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iolspi_ros.core.moments import Moments, accumulate, forget_factor_for

ACTIONS, SIZE = 3, 4


def batch(seed, n):
    rng = np.random.default_rng(seed)
    return (
        rng.standard_normal((n, SIZE)), rng.integers(ACTIONS, size=n), rng.standard_normal(n),
        rng.standard_normal((n, SIZE)), rng.integers(ACTIONS, size=n),
    )  # fmt: skip


def dense(phi, action):
    """φ(s, a): φ(s) in the block of the action."""
    out = np.zeros(ACTIONS * SIZE)
    out[action * SIZE : (action + 1) * SIZE] = phi
    return out


def one_by_one(delta, eta, samples):
    """T Eqs. 9-10 to 9-12 as they stand."""
    n = ACTIONS * SIZE
    gram, cross, vector = delta * np.eye(n), np.zeros((n, n)), np.zeros(n)
    for phi, a, r, phi_next, a_next in zip(*samples, strict=True):
        here, there = dense(phi, a), dense(phi_next, a_next)
        gram = eta * gram + np.outer(here, here)
        cross = eta * cross + np.outer(here, there)
        vector = eta * vector + here * r
    return gram, cross, vector


@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, 30),
    st.sampled_from([1.0, 0.999, 0.7]),
    st.sampled_from([0.0, 0.01, 1.0]),
    st.integers(1, 30),
)
def test_a_batch_equals_one_sample_at_a_time(seed, n, eta, delta, cut):
    samples = batch(seed, n)
    moments = Moments.empty(ACTIONS, SIZE, delta)
    for part in (slice(0, cut), slice(cut, None)):  # two batches are as good as one
        moments = accumulate(moments, *(array[part] for array in samples), forget_factor=eta)
    gram, cross, vector = one_by_one(delta, eta, samples)
    blocks = np.zeros((ACTIONS, SIZE, ACTIONS, SIZE))
    for a in range(ACTIONS):
        blocks[a, :, a, :] = moments.gram[a]
    order = ACTIONS * SIZE
    np.testing.assert_allclose(blocks.reshape(order, order), gram, atol=1e-11)
    np.testing.assert_allclose(moments.cross.reshape(order, order), cross, atol=1e-11)
    np.testing.assert_allclose(moments.reward.ravel(), vector, atol=1e-11)
    assert moments.n_samples == n
    expected = sum(eta**i for i in range(1, n + 1))
    np.testing.assert_allclose(moments.weight, expected, rtol=1e-9)


def test_both_scales():
    moments = accumulate(Moments.empty(ACTIONS, SIZE), *batch(0, 7), forget_factor=0.5)
    assert moments.scale("samples") == 7
    np.testing.assert_allclose(moments.scale("weights"), 1 - 0.5**7)


@pytest.mark.parametrize(
    ("samples", "eta"),
    [
        (1000, 0.997700), (5000, 0.999540), (10000, 0.999770), (20000, 0.999885),
        (50000, 0.999954), (100000, 0.999977), (150000, 0.999985),
    ],
)  # fmt: skip
def test_table_9_1_lists_what_leaves_ten_percent(samples, eta):
    """Not one percent, as its Eq. 9-13 says: 0.01^(1/5000) is 0.999079."""
    assert round(forget_factor_for(samples, left=0.1), 6) == eta


@pytest.mark.parametrize(("samples", "eta"), [(50000, 0.99991), (10000, 0.9995)])
def test_the_forget_factors_of_part_1_leave_one_percent(samples, eta):
    """T IV-A-5."""
    assert abs(forget_factor_for(samples) - eta) < 5e-5
    assert forget_factor_for(samples) ** samples == pytest.approx(0.01)
