import numpy as np
import pytest

from iolspi_ros.experiments.statistics import difference, interval, intervals, proportion


def test_the_interval_is_that_of_the_book():
    """Ten values of mean 3 and standard deviation 1: 3 ± 2.262 / √10 (Student, 9 degrees)."""
    values = np.repeat([2.0, 4.0], 5) * np.sqrt(0.9) + 3.0 - 3.0 * np.sqrt(0.9)
    assert np.std(values, ddof=1) == pytest.approx(1.0)
    assert interval(values) == pytest.approx((3.0, 3.0 - 0.7153, 3.0 + 0.7153), abs=1e-4)
    assert interval(np.array([7.0])) == (7.0, -np.inf, np.inf)


def test_many_realisations_give_the_bounds_of_the_thesis():
    """T 9-16 and 9-17: mean ± 1.96 σ / √n."""
    values = np.random.default_rng(0).normal(5.0, 2.0, (4000, 3))
    mean, low, high = intervals(values)
    half = 1.96 * values.std(axis=0) / np.sqrt(4000)
    np.testing.assert_allclose(high - mean, half, rtol=1e-3)
    np.testing.assert_allclose(mean - low, half, rtol=1e-3)


def test_an_interval_holds_the_mean_in_19_of_20_cases():
    values = np.random.default_rng(1).normal(1.0, 3.0, (8, 4000))
    _, low, high = intervals(values)
    assert np.mean((low <= 1.0) & (high >= 1.0)) == pytest.approx(0.95, abs=0.01)


def test_what_the_seeds_share_cancels_in_a_difference():
    rng = np.random.default_rng(2)
    shared = rng.normal(0.0, 100.0, 50)
    gap = difference(shared + 1.0 + rng.normal(0.0, 0.1, 50), shared)
    assert 0.9 < gap.low < 1.0 < gap.high < 1.1
    assert difference(shared[:20], shared) == (0.0, 0.0, 0.0)


def test_shares_have_the_intervals_of_wilson():
    """Brown, Cai and DasGupta (2001): of 0 in 10, and 8 in 10."""
    assert proportion(0, 10) == pytest.approx((0.0, 0.0, 0.2775), abs=1e-4)
    assert proportion(8, 10) == pytest.approx((0.8, 0.4902, 0.9433), abs=1e-4)
