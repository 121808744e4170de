"""What T does not say: how an uncorrupted demonstration fails, and what refreshing is worth."""

from __future__ import annotations

from dataclasses import replace

from iolspi_ros.experiments.cart_pole import Balancing
from iolspi_ros.experiments.pendulum import LITERAL, PendulumRun
from iolspi_ros.experiments.thesis import chapter8, curves, drawing
from iolspi_ros.experiments.thesis.chapter8_claims import balanced, more
from iolspi_ros.experiments.thesis.claims import OURS, Claim
from iolspi_ros.experiments.thesis.compare import (
    END,
    at_least,
    at_most,
    every,
    higher,
    near_best,
)  # fmt: skip
from iolspi_ros.experiments.thesis.study import Study

DELTAS = (0.01, 0.1, 1.0, 10.0, 100.0)
SETTINGS = {
    f"set 1, δ = {delta:g}": PendulumRun(replace(LITERAL, delta=delta), samples="set 1")
    for delta in DELTAS
} | {
    "set 1, ε = 0.6": PendulumRun(replace(LITERAL, epsilon=0.6), samples="set 1"),
    "set 5, δ = 1": PendulumRun(samples="set 5"),
    "set 5, δ = 10": PendulumRun(replace(LITERAL, delta=10.0), samples="set 5"),
}
_PLAIN, _CURED = "set 1, δ = 1", "set 1, δ = 10"
_EPISODES = (10, 20, 50, 100, 200, 500, 1000)
_LSPI, _WIDE, _OURS = "LSPI", "LSPI, 7 by 7", "refreshed, 7 by 7"
BALANCING = {
    f"{name}, {n} episodes": Balancing(episodes=n, wide=name != _LSPI, refreshed=name == _OURS)
    for name in (_LSPI, _WIDE, _OURS)
    for n in _EPISODES
}


def studies() -> list[Study]:
    """The findings: the first as share of balancing and as T's measure, and the cart-pole."""
    cells = curves.cells(SETTINGS, (_PLAIN,))
    title = "Learning to balance from an uncorrupted demonstration"
    return [
        Study(
            "finding1", f"{title}: share of the last 0.5 s upright", "says nothing of it", cells,
            curves.uprights, drawing.curves(title, "share of the last 0.5 s upright"), CLAIMS,
        ),
        Study(
            "finding2", f"{title}: discounted return, T's measure", "says nothing of it", cells,
            curves.returns, drawing.curves(title, "discounted return", -1500.0),
        ),
        Study(
            "finding3", "The cart-pole from random episodes: LSPI and the refreshed learner",
            "chapter 8 has LSPI only", chapter8.cells(BALANCING), chapter8.by_episodes,
            drawing.curves("The cart-pole from random episodes", "balancing steps, of 3,000",
                           x_label="random episodes", near_zero=10.0),
            CART_POLE,
        ),
    ]  # fmt: skip


CLAIMS = (
    Claim("From the uncorrupted set 1 IOLSPI (δ = 1) does not learn to balance in 600 s, though "
          "its discounted return is within 10 % of the best: γ^200 is 0.02, so T's measure hardly "
          "sees the end of an episode", OURS, "IOLSPI, K_θ = 1000, ε = 0.2",
          every(at_most(_PLAIN, "upright", 0.2), near_best(_PLAIN, "discounted", END, 1.1))),
    Claim("Exploring three times as much does not cure it", OURS, "ε = 0.6 instead of 0.2",
          at_most("set 1, ε = 0.6", "upright", 0.2)),
    Claim("A larger δ, of which T says only that it is small, cures it: the same samples teach to "
          "balance with Γ₀ = 10 I", OURS, "δ = 10 instead of 1",
          every(higher(_CURED, _PLAIN, "upright", END), at_least(_CURED, "upright", 0.9))),
    Claim("A smaller δ lowers T's measure, though more realisations balance", OURS,
          "δ = 0.01 and 0.1 instead of 1",
          every(*(higher(_PLAIN, f"set 1, δ = {d:g}", "discounted", END) for d in (0.01, 0.1)),
                *(higher(f"set 1, δ = {d:g}", _PLAIN, "upright", END) for d in (0.01, 0.1)))),
    Claim("The refreshed learner balances from the same samples", OURS,
          "no δ to choose; three realisations",
          at_least(f"{_PLAIN}, refreshed", "upright", 0.95)),
    Claim("The corrupted, exploring set 5 needs no cure, and loses nothing by it", OURS,
          "δ = 1 and 10",
          every(at_least("set 5, δ = 1", "upright", 0.9),
                at_least("set 5, δ = 10", "upright", 0.9))),
)  # fmt: skip

_NEAR = "random episodes from near the equilibrium (deviation 0.01)"
CART_POLE = (
    Claim("From the same random episodes the refreshed learner balances the cart-pole longer than "
          "LSPI does", OURS, f"{_NEAR}, LSPI with Lagoudakis and Parr's functions",
          every(*(more(f"{_OURS}, {n} episodes", f"{_LSPI}, {n} episodes") for n in (100, 200)))),
    Claim("Its functions are not what does it", OURS, f"{_NEAR}, the same 7 by 7 functions",
          every(*(more(f"{_OURS}, {n} episodes", f"{_WIDE}, {n} episodes") for n in (100, 200)))),
    Claim("From 1,000 episodes its policies balance for 2,950 of 3,000 steps", OURS, _NEAR,
          balanced(f"{_OURS}, 1000 episodes", 2950.0)),
)  # fmt: skip
