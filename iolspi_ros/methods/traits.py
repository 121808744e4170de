"""What each learner is, in the words of T Table 4-1."""

from __future__ import annotations

from typing import NamedTuple


class Traits(NamedTuple):
    """What a learner does.

    Attributes
    ----------
    title : str
        What it is called among people.
    source : str
        Where its equations are from.
    online : str
        Whether its source learns online or offline.
    model : str
        Which model of the vehicle it makes, if any; nobody is given the simulator.
    demonstrations, adapts : bool
        Whether it can begin with those; whether it goes on when the vehicle changes.
    """

    title: str
    source: str
    online: str
    model: str
    demonstrations: bool
    adapts: bool


LWR = "local, linear"

TRAITS = {
    "iolspi": Traits(
        "IOLSPI, refreshed", "T Part I", "online", "none", True, True,
    ),
    "sarsa": Traits(
        "SARSA(λ)", "T Algorithm 1", "online", "none", False, True,
    ),
    "q_learning": Traits(
        "Q-learning(λ)", "T Algorithms 2, 10", "online", "none", True, True,
    ),
    "policy_search": Traits(
        "Policy search by noise", "T Algorithm 3", "offline", LWR, True, True,
    ),
    "value_iteration": Traits(
        "Approximate value iteration", "T Algorithm 5", "offline", LWR, True, True,
    ),
    "continuous_value_iteration": Traits(
        "Continuous-action value iteration", "T Algorithm 6", "offline", LWR, True, True,
    ),
    "automata": Traits(
        "Learning automata", "T 4-1-5", "offline", "none", False, True,
    ),
    "apprentice": Traits(
        "Apprenticeship", "T Algorithm 8", "offline", LWR, True, True,
    ),
    "fitted_q": Traits(
        "Fitted Q iteration, trees", "Ernst et al. 2005", "offline", "none", True, True,
    ),
    "dqn": Traits(
        "DQN", "Mnih et al. 2015", "online", "none", False, True,
    ),
}  # fmt: skip


def informed() -> list[str]:
    """Names of those that learn from demonstrations."""
    return [name for name, traits in TRAITS.items() if traits.demonstrations]
