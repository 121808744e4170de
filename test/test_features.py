import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iolspi_ros.core.features import ChebyshevGrid, RBFGrid
from iolspi_ros.errors import InputError

numbers = st.floats(-3.0, 3.0)


def by_the_thesis(state, low, high, counts, asymmetric, width):
    """T Eqs. 9-2 to 9-9, one centre after the other."""
    reference = next((c for c in counts if c > 1), 1)
    scale = [(c - 1) / (reference - 1) if reference > 1 else 0.0 for c in counts]
    if not asymmetric:
        scale = [1.0 if c > 1 else 0.0 for c in counts]
    sigma = width * 2.0 / (reference - 1) if reference > 1 else 1.0
    values = []
    for index in np.ndindex(*counts):
        square = 0.0
        for d, i in enumerate(index):
            center = -1.0 + 2.0 * i / (counts[d] - 1) if counts[d] > 1 else 0.0
            normal = -1.0 + 2.0 * (state[d] - low[d]) / (high[d] - low[d])
            square += (scale[d] * (normal - center)) ** 2
        values.append(math.exp(-square / (2.0 * sigma**2)))
    return np.array(values)


@given(
    st.lists(numbers, min_size=2, max_size=2),
    st.tuples(st.integers(1, 5), st.integers(1, 6)),
    st.booleans(),
    st.floats(0.5, 2.0),
)
def test_functions_are_those_of_the_thesis(state, counts, asymmetric, width):
    low, high = (-2.0, -1.0), (2.0, 3.0)
    name = "asymmetric" if asymmetric else "symmetric"
    grid = RBFGrid(low, high, counts, name, width)
    expected = by_the_thesis(state, low, high, counts, asymmetric, width)
    np.testing.assert_allclose(grid(np.array(state)), expected, rtol=1e-10, atol=1e-14)


def test_neighbours_are_one_width_apart():
    grid = RBFGrid((-1.0, -10.0), (1.0, 10.0), (5, 3))
    values = grid(grid.points)
    np.testing.assert_allclose(np.diag(values), 1.0)
    np.testing.assert_allclose(values[0, 1], math.exp(-0.5))  # next along the second dimension
    np.testing.assert_allclose(values[0, 3], math.exp(-0.5))  # next along the first


@given(st.lists(numbers, min_size=3, max_size=3), st.tuples(*[st.integers(1, 4)] * 3))
def test_one_state_alone_gives_the_same_sum(state, counts):
    grid = RBFGrid((-1.0, -2.0, 0.0), (1.0, 2.0, 3.0), counts, "asymmetric", 0.8)
    weights = np.random.default_rng(0).standard_normal((5, grid.size))
    found = grid.weigh(weights, np.array(state), np.empty(5))
    np.testing.assert_allclose(found, weights @ grid(np.array(state)), atol=1e-12)


def test_a_batch_is_its_rows_and_nothing_follows_an_end():
    grid = RBFGrid((-1.0, -1.0), (1.0, 1.0), (4, 3))
    states = np.random.default_rng(0).uniform(-1, 1, (6, 2))
    ended = np.array([0, 1, 0, 0, 1, 0], bool)
    values = grid(states, ended)
    assert (values[ended] == 0).all()
    for row in np.flatnonzero(~ended):
        np.testing.assert_array_equal(values[row], grid(states[row]))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (((0.0,), (0.0,), (3,)), r"low\[0\], high\[0\] are 0.0, 0.0"),
        (((1.0,), (0.0,), (3,)), "allowed: low < high"),
        (((0.0,), (1.0,), (0,)), r"centers\[0\] is 0"),
        (((0.0,), (1.0, 2.0), (3,)), "one each per dimension"),
        (((0.0,), (1.0,), (3,), "lopsided"), "asymmetric, symmetric"),
        (((0.0,), (1.0,), (3,), "symmetric", -1.0), "width is -1.0"),
        (((0.0,), (float("nan"),), (3,)), "nan"),
    ],
)
def test_what_makes_no_grid_is_refused(arguments, words):
    with pytest.raises(InputError, match=words):
        RBFGrid(*arguments)


def test_a_state_of_other_dimensions_is_refused():
    with pytest.raises(InputError, match=r"allowed: \(..., 2\)"):
        RBFGrid((0.0, 0.0), (1.0, 1.0), (2, 2))(np.zeros(3))


@given(st.lists(numbers, min_size=2, max_size=2))
def test_on_a_periodic_dimension_high_is_low_again(state):
    grid = RBFGrid((-1.0, -1.0), (1.0, 1.0), (5, 4), periodic=(True, False))
    here = grid(np.array(state))
    np.testing.assert_allclose(grid(np.add(state, (2.0, 0.0))), here, atol=1e-9)
    # Moved by one centre, the functions are the same, one further.
    turned = np.roll(here.reshape(5, 4), 1, axis=0).ravel()
    np.testing.assert_allclose(grid(np.add(state, (0.4, 0.0))), turned, atol=1e-9)


@given(st.lists(st.floats(0.0, 1.0), min_size=2, max_size=2))
def test_chebyshev_polynomials_are_cosines_of_multiples(share):
    """ψ_n(cos t) = cos(n t), multiplied out with the last dimension fastest (T Eq. 4-5)."""
    low, high = (-2.0, 0.0), (4.0, 0.5)
    grid = ChebyshevGrid(low, high, (4, 3))
    state = np.array(low) + np.array(share) * np.subtract(high, low)
    angles = np.arccos(np.clip(2.0 * np.array(share) - 1.0, -1.0, 1.0))
    parts = [np.cos(n * t) for n, t in zip((np.arange(4), np.arange(3)), angles, strict=True)]
    np.testing.assert_allclose(grid(state), np.kron(*parts), atol=1e-6)
    np.testing.assert_array_equal(grid(np.array([99.0, 99.0])), np.ones(12))  # at the limit


def test_polynomials_of_the_action_span_what_blocks_do():
    """T multiplies by polynomials of u; with one for each action it is a change of basis."""
    psi = ChebyshevGrid((-3.0,), (3.0,), (3,))(np.array([[-3.0], [0.0], [3.0]]))
    assert np.linalg.matrix_rank(psi) == 3


def test_trimmed_to_the_hull_the_functions_left_are_the_same():
    grid = RBFGrid((-1.0, -1.0), (1.0, 1.0), (5, 5))
    corners = np.array([[-0.6, -0.6], [0.6, -0.6], [0.0, 0.7]])
    trimmed = grid.trim(corners)
    inside = {(-0.5, -0.5), (0.0, -0.5), (0.5, -0.5), (0.0, 0.0), (0.0, 0.5)}
    assert {tuple(point) for point in trimmed.points} == inside
    states = np.random.default_rng(0).uniform(-1, 1, (7, 2))
    np.testing.assert_array_equal(trimmed(states), grid(states)[:, list(trimmed.kept)])
    weights = np.random.default_rng(1).standard_normal((3, trimmed.size))
    one = trimmed.weigh(weights, states[0], np.empty(3))
    np.testing.assert_allclose(one, weights @ trimmed(states[0]))


def test_dimensions_that_do_not_vary_do_not_count_for_the_hull():
    grid = RBFGrid((0.0, 0.0, 0.0), (4.0, 1.0, 1.0), (5, 1, 1))
    states = np.array([[0.9, 7.0, 7.0], [3.1, 7.0, 7.0]])
    assert grid.trim(states).points[:, 0].tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("states", "words"),
    [
        ([[0.0, 0.0], [0.5, 0.5]], "2 states span no convex hull in 2 dimensions"),
        ([[0.0, 0.0], [0.5, 0.5], [1.0, 1.0]], "do not lie in a plane or a line"),
        ([[0.1, 0.1], [0.2, 0.1], [0.1, 0.2]], "none of 25 centres is in the convex hull"),
    ],
)
def test_a_degenerate_hull_is_refused(states, words):
    grid = RBFGrid((-1.0, -1.0), (1.0, 1.0), (5, 5))
    with pytest.raises(InputError, match=words):
        grid.trim(np.array(states))


def test_unnormalised_functions_and_a_constant():
    grid = RBFGrid((-1.0, -2.0), (1.0, 2.0), (2, 3), "none", 0.7, constant=True)
    state = np.array([0.4, -0.9])
    expected = [1.0]
    for x in (-1.0, 1.0):
        for y in (-2.0, 0.0, 2.0):
            expected += [math.exp(-((0.4 - x) ** 2 + (-0.9 - y) ** 2) / (2 * 0.7**2))]
    np.testing.assert_allclose(grid(state), expected, rtol=1e-14)
    assert grid.size == 7
    trimmed = grid.trim(np.array([(-1.5, -3.0), (-1.5, 3.0), (0.5, 3.0), (0.5, -3.0)]))
    np.testing.assert_allclose(trimmed(state), expected[:4], rtol=1e-14)
