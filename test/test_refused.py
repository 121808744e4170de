"""Policies that are not taken: of values that such rewards cannot add up to."""

import numpy as np
import pytest
from scipy.optimize import brentq

from iolspi_ros.core.learner import update as learn
from iolspi_ros.core.lspi_settings import LSPISettings
from iolspi_ros.core.online import OnlineLSPI
from iolspi_ros.core.samples import Transition
from iolspi_ros.task import Action, TaskDescription, Variable


@pytest.mark.parametrize("algorithm", ["refreshed", "literal"])
def test_values_that_such_rewards_cannot_add_up_to_are_refused(algorithm):
    """γ φ(s') = 1.01 φ(s): the fixed point is -100, of rewards that add up to 10 at most."""
    task = TaskDescription(
        "slide", (Variable("x", low=-1.0, high=1.0),), (Action("go"),), 0.1, gamma=0.9
    )
    settings = LSPISettings(algorithm=algorithm, centers=(3,), update_interval=5, delta=1e-4)
    one = settings.resolve(task).features()

    class Middle:
        """The function in the middle alone."""

        size, table = 1, one.table

        def __call__(self, states, terminated=None):
            return one(states, terminated)[:, 1:2]

        def along(self, batch):
            return self(batch.state), self(batch.next_state, batch.terminated)

    core = OnlineLSPI(task, settings, np.random.default_rng(0))
    core.features, core.weights = Middle(), np.zeros((1, 1))
    core.moments = type(core.moments).empty(1, 1, settings.delta)

    def place(height):
        where = brentq(lambda x: core.features(np.array([[x]]))[0, 0] - height, 0.0, 3.0)
        return np.array([where])

    top = core.features(np.zeros((1, 1)))[0, 0]
    state, after = place(0.6 * top), place(1.01 * 0.6 * top / task.gamma)
    before = core.weights
    for _ in range(5):
        core.observe(Transition(state, 0, 1.0, after))
    found = learn(core)
    assert found.solve.status == "diverging"
    assert (found.accepted, found.healthy) == (False, False)
    np.testing.assert_array_equal(core.weights, before)
