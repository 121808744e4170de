"""What T does not say: why an uncorrupted demonstration fails at balancing, and what cures it."""

from __future__ import annotations

from dataclasses import replace

from iolspi_ros.experiments.learning import LITERAL, Learning
from iolspi_ros.experiments.thesis import curves, drawing
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
    f"set 1, δ = {delta:g}": Learning(replace(LITERAL, delta=delta), samples="set 1")
    for delta in DELTAS
} | {
    "set 1, ε = 0.6": Learning(replace(LITERAL, epsilon=0.6), samples="set 1"),
    "set 5, δ = 1": Learning(samples="set 5"),
    "set 5, δ = 10": Learning(replace(LITERAL, delta=10.0), samples="set 5"),
}
_PLAIN, _CURED = "set 1, δ = 1", "set 1, δ = 10"


def studies() -> list[Study]:
    """The finding, as share of balancing and as T's measure."""
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
    Claim("A smaller δ makes it worse, in T's measure too", OURS, "δ = 0.01 instead of 1",
          every(higher(_PLAIN, "set 1, δ = 0.01", "discounted", END))),
    Claim("The refreshed learner balances from the same samples", OURS, "no δ to choose",
          at_least(f"{_PLAIN}, refreshed", "upright", 0.95)),
    Claim("The corrupted, exploring set 5 needs no cure, and loses nothing by it", OURS,
          "δ = 1 and 10",
          every(at_least("set 5, δ = 1", "upright", 0.9),
                at_least("set 5, δ = 10", "upright", 0.9))),
)  # fmt: skip
