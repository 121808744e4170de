"""What each learner is, in the words of T Table 4-1, and when it is the right choice."""

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
    choose : str
        When it is the right choice, in a sentence.
    """

    title: str
    source: str
    online: str
    model: str
    demonstrations: bool
    adapts: bool
    choose: str


LWR = "local, linear"

TRAITS = {
    "iolspi": Traits(
        "IOLSPI, refreshed", "T Part I", "online", "none", True, True,
        "When vehicle time is dear and somebody can show the task; the default.",
    ),
    "sarsa": Traits(
        "SARSA(λ)", "T Algorithm 1", "online", "none", False, True,
        "When a microcontroller must learn, and what exploring costs shall count.",
    ),
    "q_learning": Traits(
        "Q-learning(λ)", "T Algorithms 2, 10", "online", "none", True, True,
        "When each step may cost microseconds alone, and vehicle time is cheap.",
    ),
    "policy_search": Traits(
        "Policy search by noise", "T Algorithm 3", "offline", LWR, True, True,
        "When the policy must be a few numbers that a person can read.",
    ),
    "value_iteration": Traits(
        "Approximate value iteration", "T Algorithm 5", "offline", LWR, True, True,
        "When the dynamics are smooth and a model of them is wanted besides.",
    ),
    "continuous_value_iteration": Traits(
        "Continuous-action value iteration", "T Algorithm 6", "offline", LWR, True, True,
        "When the value is nearly quadratic: holding a setpoint, the actions along one axis.",
    ),
    "automata": Traits(
        "Learning automata", "T 4-1-5", "offline", "none", False, True,
        "When a few settings are chosen once, and each choice is rewarded soon.",
    ),
    "apprentice": Traits(
        "Apprenticeship", "T Algorithm 8", "offline", LWR, True, True,
        "When an expert has flown enough, and nobody may explore before it flies well.",
    ),
    "fitted_q": Traits(
        "Fitted Q iteration, trees", "Ernst et al. 2005", "offline", "none", True, True,
        "When nothing is known of scales and limits, and rewards jump.",
    ),
    "dqn": Traits(
        "DQN", "Mnih et al. 2015", "online", "none", False, True,
        "When the state is an image or very large, and a simulator gives millions of steps.",
    ),
}  # fmt: skip


def informed() -> list[str]:
    """Names of those that learn from demonstrations."""
    return [name for name, traits in TRAITS.items() if traits.demonstrations]
