"""MushroomRL's own LSPI, to compare with.

MushroomRL 1.10.2 pins an old numpy and brings torch, gym's friends and OpenCV, which its LSPI
never touches. `pip install --no-deps mushroom-rl==1.10.2` is enough: what else it imports is
stood in for by empty modules when it is not there.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
import types
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.features import RBFGrid
from iolspi_ros.core.samples import Transitions

Array = NDArray[np.float64]

UNUSED = ("torch", "cv2", "pygame", "tqdm", "sklearn")


def available() -> bool:
    """Whether MushroomRL is installed."""
    return importlib.util.find_spec("mushroom_rl") is not None


class _Nothing(type):
    """A class of which everything exists and does nothing."""

    def __getattr__(cls, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return _nothing(name)


def _nothing(name: str) -> _Nothing:
    parts = {
        "__init__": lambda self, *a, **k: None,
        "__getattr__": lambda self, attribute: _nothing(attribute),
        "__call__": lambda self, *a, **k: a[0] if a else None,
    }
    return _Nothing(name, (), parts)


class _Absent(types.ModuleType):
    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return _nothing(name)


class _StandIns(MetaPathFinder, Loader):
    def __init__(self, missing: tuple[str, ...]) -> None:
        self._missing = missing

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> ModuleSpec | None:
        if fullname.split(".")[0] in self._missing:
            return ModuleSpec(fullname, self, is_package=True)
        return None

    def create_module(self, spec: ModuleSpec) -> types.ModuleType:
        return _Absent(spec.name)

    def exec_module(self, module: types.ModuleType) -> None:
        """Nothing is in it."""


def lspi(
    transitions: Transitions,
    basis: RBFGrid,
    n_actions: int,
    gamma: float,
    weights: Array,
    own_features: bool,
) -> tuple[Any, Any]:
    """Its LSPI on our samples, ready to be fitted.

    Parameters
    ----------
    transitions, basis, n_actions, gamma, weights
        As of `lspi.offline_lspi`.
    own_features : bool
        Evaluate the functions by its GaussianRBF, as its examples do, or by ours.

    Returns
    -------
    fit : callable
        Runs it until ‖Δw‖ < 1e-2, from `weights`.
    result : callable
        Weights found, shape (n_actions, size).
    """
    missing = tuple(name for name in UNUSED if importlib.util.find_spec(name) is None)
    finder = _StandIns(missing)
    sys.meta_path.append(finder)
    try:
        batch = importlib.import_module("mushroom_rl.algorithms.value.batch_td")
        core = importlib.import_module("mushroom_rl.core")
        spaces = importlib.import_module("mushroom_rl.utils.spaces")
        policy = importlib.import_module("mushroom_rl.policy").EpsGreedy(epsilon=0.0)
        features = importlib.import_module("mushroom_rl.features")
        gaussian = importlib.import_module("mushroom_rl.features.basis").GaussianRBF
    finally:
        sys.meta_path.remove(finder)
        for name in [n for n in sys.modules if n.split(".")[0] in missing]:
            del sys.modules[name]
    observed = spaces.Box(np.array(basis.low), np.array(basis.high))
    info = core.MDPInfo(observed, spaces.Discrete(n_actions), gamma, 300)
    shape = {"input_shape": (basis.size,), "output_shape": (n_actions,), "n_actions": n_actions}
    phi = basis
    if own_features:
        scale = 2.0 / basis.table.gains**2
        phi = features.Features(basis_list=[gaussian(mean, scale) for mean in basis.points])
    agent = batch.LSPI(info, policy, approximator_params=shape, epsilon=1e-2, features=phi)
    agent.approximator.set_weights(weights.ravel())
    dataset = [
        (t.state, np.array([t.action]), t.reward, t.next_state, t.terminated, t.truncated)
        for t in transitions
    ]
    shaped = weights.shape
    return (
        lambda: agent.fit(dataset),
        lambda: np.array(agent.approximator.get_weights()).reshape(shaped),
    )
