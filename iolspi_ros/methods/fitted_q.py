"""Fitted Q iteration with trees: Ernst, Geurts and Wehenkel, JMLR 6, 2005 (the extra `trees`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.compiling import cached_njit
from iolspi_ros.core.learner import Proceed
from iolspi_ros.core.samples import Transitions
from iolspi_ros.errors import InputError
from iolspi_ros.methods.base import Sampled, SampledSettings
from iolspi_ros.methods.value_iteration import FEW
from iolspi_ros.settings import setting
from iolspi_ros.task import TaskDescription

Array = NDArray[np.float64]
COLUMNS = 6
"""Of a node: action (of a root, else -1), variable (-1: a leaf), threshold, left, right, value."""


@dataclass(frozen=True)
class TreeSettings(SampledSettings):
    """What it takes besides."""

    trees: int = setting(20, "trees of an action", low=1, high=1000)
    leaf: int = setting(1, "samples of a leaf, at least", low=1)
    rebuilds: int = setting(3, "times that trees are grown anew for the values reached", low=1)
    iterations: int = setting(400, "values are renewed so often with the same trees", low=1)
    tolerance: float = setting(1e-4, "until none changes more, relative to the largest", low=0.0)


class FittedQ(Sampled):
    """Q(s, a) ← r + γ max Q(s', ·), by extremely randomised trees for each action.

    Trees are grown for the values at hand, then kept while values are renewed until they stay,
    which they do as the mean over a leaf pulls nothing apart (Ernst et al., 2.5). A policy is the
    trees as numbers, so it is saved, sent and flown like any other.
    """

    name = "fitted_q"
    Settings: ClassVar[type[Any]] = TreeSettings

    def __init__(self, task: TaskDescription, settings: Any, rng: np.random.Generator) -> None:
        _grower()
        super().__init__(task, settings, rng)
        self.weights = np.array([[a, -1.0, 0.0, 0.0, 0.0, 0.0] for a in range(task.n_actions)])

    def fits(self, weights: Array) -> bool:
        """Whether these are trees; their number follows from the samples."""
        return weights.ndim == 2 and weights.shape[1] == COLUMNS and _sound(weights, self.task)

    def values(self, states: Array, snapshot: Array | None = None) -> Array:
        """Mean of the trees of each action."""
        q = np.zeros((len(states), self.task.n_actions))
        _predict(self.weights if snapshot is None else snapshot, np.ascontiguousarray(states), q)
        return q

    def improve(
        self, rows: Transitions, weights: Array, rng: np.random.Generator, proceed: Proceed
    ) -> tuple[Array | None, str]:
        """Iterate on all samples, from the values of the policy before."""
        s, task, grow = self.settings, self.task, _grower()
        own = [np.flatnonzero(rows.action == a) for a in range(task.n_actions)]
        if min(map(len, own)) < 2:
            return None, FEW
        going = np.flatnonzero(~rows.terminated)
        y = self._targets(rows, self.values(rows.next_state, weights))
        for number in range(s.rebuilds):
            forests = [
                grow(s.trees, s.leaf, rng).fit(rows.state[mine], y[mine]) for mine in own
            ]  # fmt: skip
            means = [
                _Means(forest, rows.state[mine], rows.next_state[going])
                for forest, mine in zip(forests, own, strict=True)
            ]
            y = self._settled(rows, y, means, own)
            if not proceed((number + 1) / s.rebuilds):
                break
        packed = [
            _packed(a, forest, mean.sums(y[mine]) / mean.counts)
            for a, (forest, mean, mine) in enumerate(zip(forests, means, own, strict=True))
        ]
        text = f"{s.trees} trees an action on {len(rows)} samples"
        return np.concatenate(packed), text

    def _settled(
        self, rows: Transitions, y: Array, means: list[_Means], own: list[NDArray[np.int64]]
    ) -> Array:
        """Values at the samples, renewed with the same trees until they stay."""
        going = np.flatnonzero(~rows.terminated)
        for _ in range(self.settings.iterations):
            q = np.zeros((len(rows), self.task.n_actions))
            for a, (mean, mine) in enumerate(zip(means, own, strict=True)):
                q[going, a] = mean(y[mine])
            new = self._targets(rows, q)
            change, y = float(np.abs(new - y).max()), new
            if change <= self.settings.tolerance * max(float(np.abs(y).max()), 1e-300):
                break
        return y

    def _targets(self, rows: Transitions, q: Array) -> Array:
        going = np.where(rows.terminated, 0.0, q.max(axis=1))
        found: Array = rows.reward + self.task.gamma * going
        return found


class _Means:
    """What a forest makes of values at its samples: at other states, the mean of their leaves."""

    def __init__(self, forest: Any, states: Array, others: Array) -> None:
        sizes = [tree.tree_.node_count for tree in forest.estimators_]
        begin = np.concatenate([[0], np.cumsum(sizes)[:-1]])
        self._leaves = forest.apply(states) + begin
        self._others = forest.apply(others) + begin if len(others) else np.zeros((0, 1), int)
        self._size = int(np.sum(sizes))
        counts = np.bincount(self._leaves.ravel(), minlength=self._size)
        self.counts: Array = np.maximum(counts, 1).astype(np.float64)

    def sums(self, y: Array) -> Array:
        """Sum of values over each node that is a leaf."""
        repeated = np.repeat(y, self._leaves.shape[1])
        found: Array = np.bincount(self._leaves.ravel(), repeated, self._size).astype(np.float64)
        return found

    def __call__(self, y: Array) -> Array:
        """Values at the others."""
        found: Array = (self.sums(y) / self.counts)[self._others].mean(axis=1)
        return found


def _grower() -> Any:
    """What makes a forest of so many trees with such leaves.

    Raises
    ------
    InputError
        When scikit-learn is not installed.
    """
    try:
        from sklearn.ensemble import ExtraTreesRegressor
    except ImportError:
        raise InputError(
            "learner fitted_q needs scikit-learn; allowed: install the package's extra 'trees', "
            "or a learner that needs none, such as iolspi or value_iteration"
        ) from None

    def grow(trees: int, leaf: int, rng: np.random.Generator) -> Any:
        seed = int(rng.integers(2**31))
        return ExtraTreesRegressor(trees, min_samples_leaf=leaf, random_state=seed)

    return grow


def _packed(action: int, forest: Any, values: Array) -> Array:
    """Nodes of a forest; children are counted from the root of their tree."""
    parts, begin = [], 0
    for tree in forest.estimators_:
        t, n = tree.tree_, tree.tree_.node_count
        nodes = np.column_stack([
            np.full(n, -1.0), np.where(t.children_left < 0, -1, t.feature), t.threshold,
            np.maximum(t.children_left, 0), np.maximum(t.children_right, 0),
            values[begin : begin + n],
        ])  # fmt: skip
        nodes[0, 0] = action
        parts.append(nodes)
        begin += n
    return np.concatenate(parts)


def _sound(nodes: Array, task: TaskDescription) -> bool:
    """Whether going down these nodes ends, at nodes that there are."""
    action, variable, _, left, right, _ = nodes.T
    roots = np.flatnonzero(action >= 0)
    if not len(roots) or roots[0] or set(action[roots]) != set(range(task.n_actions)):
        return False
    tree = np.cumsum(action >= 0) - 1
    place = np.arange(len(nodes)) - roots[tree]
    sizes = np.diff(np.append(roots, len(nodes)))[tree]
    inner = variable >= 0
    children = np.stack([left, right])[:, inner]
    onward = (children > place[inner]) & (children < sizes[inner]) & (children % 1 == 0)
    known = np.isin(variable, np.arange(-1, task.n_dims))
    return bool(onward.all() and known.all())


@cached_njit()
def _predict(nodes: Array, states: Array, q: Array) -> None:
    """Put the mean of each action's trees into `q`, which holds zeros."""
    counts = np.zeros(q.shape[1])
    for root in range(len(nodes)):
        if nodes[root, 0] < 0:
            continue
        action = int(nodes[root, 0])
        counts[action] += 1.0
        for n in range(len(states)):
            at = root
            while nodes[at, 1] >= 0:
                # The trees were grown on single precision.
                left = np.float32(states[n, int(nodes[at, 1])]) <= nodes[at, 2]
                at = root + int(nodes[at, 3] if left else nodes[at, 4])
            q[n, action] += nodes[at, 5]
    q /= counts
