"""What T's chapter 8 says of the cart-pole, and how data decide it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.experiments.cells import Data
from iolspi_ros.experiments.statistics import Interval, difference, interval
from iolspi_ros.experiments.thesis import claims
from iolspi_ros.experiments.thesis.claims import OURS, Claim, Finding
from iolspi_ros.experiments.thesis.compare import Decide, every

Array = NDArray[np.float64]


def more(first: str, second: str, what: str = "steps", by: float = 0.0) -> Decide:
    """The first has more than the second."""
    names = {"steps": "balancing steps", "converged": "share that converged"}

    def decide(data: Data) -> list[Finding]:
        gain = difference(data[first][what], data[second][what])
        return [claims.above(f"{first} minus {second}, {names[what]}", gain, by)]

    return decide


def as_many(first: str, second: str, margin: float) -> Decide:
    """The balancing steps of two differ by less than so many."""

    def decide(data: Data) -> list[Finding]:
        gap = difference(data[first]["steps"], data[second]["steps"])
        return [claims.within(f"{first} minus {second}, balancing steps", gap, -margin, margin)]

    return decide


def balanced(label: str, steps: float) -> Decide:
    """The mean is above so many steps."""
    return lambda data: [
        claims.above(f"{label}: balancing steps", interval(data[label]["steps"]), steps)
    ]


def includes(label: str, what: str, quantity: str, value: float, share: float) -> Decide:
    """The mean is within a share of a number that is printed."""

    def decide(data: Data) -> list[Finding]:
        low, high = value * (1.0 - share), value * (1.0 + share)
        return [claims.within(f"{label}: {quantity}", interval(data[label][what]), low, high)]

    return decide


def _deviation(what: str, values: Array, beyond: float) -> Finding:
    """The standard deviation is beyond a limit, by the bootstrap's interval."""
    rng = np.random.default_rng(0)
    drawn = rng.choice(values, (2000, len(values))).std(axis=1, ddof=1)
    low, high = np.quantile(drawn, (0.025, 0.975))
    return claims.above(what, Interval(float(values.std(ddof=1)), float(low), float(high)), beyond)


def _between_sets(data: Data) -> list[Finding]:
    what = "standard deviation of the steps over sample sets"
    return [_deviation(what, data["random"]["steps"], 100.0)]


def _between_weights(data: Data) -> list[Finding]:
    """Two draws of w₀ for each set of samples differ by √2 times the deviation over draws."""
    gap = (data["random"]["steps"] - data["random, other w₀"]["steps"]) / np.sqrt(2.0)
    what = "standard deviation of the steps over w₀, the samples the same"
    return [_deviation(what, gap, 100.0)]


def _singular(data: Data) -> list[Finding]:
    return [
        claims.above(f"{label}: share of singular solves", interval(data[label]["singular"]), 0.5)
        for label in ("γ = 1", f"{NO_ENDS}, γ = 1")
    ]


def _no_help(data: Data) -> list[Finding]:
    gain = difference(data["the two merged"]["steps"], data["demonstration, 1000"]["steps"])
    return [claims.below("the two merged minus demonstration, 1000, balancing steps", gain, 30.0)]


def _narrower(data: Data) -> list[Finding]:
    """Standard deviations of angle and rate, demonstrations less random samples."""
    return [
        claims.below(
            f"demonstration minus random, standard deviation of the {name}",
            difference(data["demonstration, 1000"]["spread"][:, d], data["random"]["spread"][:, d]),
        )
        for d, name in enumerate(("angle [rad]", "rate [rad/s]"))
    ]


NO_ENDS = "falls go on"
"""Where the state after a fall is not known to be the last."""
ENDLESS = f"1000 episodes, {NO_ENDS}"
_USUAL = "1,000 random samples, of 600 steps, starts as in T's reference (deviation 0.01)"
_SETS = "of 600 steps; demonstrations of the scripted pilot"

CLAIMS: dict[str, tuple[Claim, ...]] = {
    "fig8-1": (
        Claim("A random episode takes about 6 steps (L&P, quoted)", "8-1",
              "steps before the one that falls; starts with a deviation of 0.33, and near zero",
              every(includes("1000 episodes", "length", "steps of an episode", 6.0, 0.1),
                    includes("near", "length", "steps of an episode, deviation 0.01", 6.0, 0.1)),
              "From close to the equilibrium, as both papers have it, Eq. 8-1 takes 7.9 steps: an "
              "adaptive integration by scipy says the same. 6.3 come with starts that deviate by "
              "0.33 rad and rad/s"),
        Claim("From 1,000 random episodes LSPI balances for about 2,850 steps of 3,000 (L&P)",
              "8-2, Fig. 8-1", "100 repetitions, 20 evaluations each; within 10 %",
              includes("1000 episodes", "steps", "balancing steps", 2850.0, 0.1)),
    ),
    "table8-1": (
        Claim("The higher the number of samples, the longer the pendulum is balanced",
              "8-2, Table 8-1", "deviation 0.01, 20 evaluations",
              every(more("100 episodes", "10 episodes"), more("1000 episodes", "100 episodes"),
                    more("1000 samples", "100 samples"))),
        Claim("1,000 give 2,339.5 balancing steps", "8-2, Table 8-1",
              "read as episodes, and as samples; within 20 %",
              every(includes("1000 episodes", "steps", "balancing steps", 2339.5, 0.2),
                    includes("1000 samples", "steps", "balancing steps", 2339.5, 0.2)),
              "So many episodes are nearer than so many samples: T's column is Lagoudakis and "
              "Parr's Fig. 8-1. T had 10 realisations, evaluated twice"),
        Claim("Where falls are not known to end the task, the policy is worse", OURS,
              "1,000 random episodes, deviation 0.01", more("1000 episodes", ENDLESS)),
    ),
    "table8-2": (
        Claim("A larger perturbation of the starts gives a better policy", "8-2, Table 8-2",
              "1,000 random samples, of 600 steps",
              every(more("0.01", "0.001"), more("0.1", "0.001"), more("0.1", "0.01")),
              "0.001 and 0.01 make no difference: one push changes the rate by 0.8 rad/s"),
        Claim("Too big a perturbation makes it worse again", "8-2, Table 8-2",
              "1,000 random samples, of 600 steps",
              every(more("0.1", "0.5"), more("0.1", "1.5"), more("0.5", "1.5"))),
    ),
    "section8-2": (
        Claim("γ = 1 yields a deficiency in solving for Γ and Λ", "8-2", _USUAL, _singular,
              "The equations are regular, because episodes end. They become singular when the "
              "state after a fall counts as any other: then a constant drops out of Γ - Λ"),
        Claim("γ between 0.95 and 1 has problems converging, with poor results", "8-2", _USUAL,
              every(more("γ = 0.95", "γ = 0.99", "converged"), more("γ = 0.95", "γ = 0.99"),
                    more("γ = 0.95", "γ = 0.98"))),
        Claim("γ between 0.85 and 0.95 converges more easily, but to a worse policy", "8-2", _USUAL,
              every(more("γ = 0.85", "γ = 0.95", "converged"), more("γ = 0.95", "γ = 0.85"),
                    more("γ = 0.9", "γ = 0.95", "converged"), more("γ = 0.95", "γ = 0.9")),
              "γ = 0.9 converges more easily and balances longer than 0.95; 0.85 is as T says"),
        Claim("The termination criterion does not matter while it is below 0.1", "8-2",
              f"{_USUAL}; χ = 0.05 and 1e-5; within 30 steps",
              as_many("χ = 0.05", "γ = 0.95", 30.0)),
        Claim("More iterations are better, but beyond 20 there is not much difference", "8-2",
              f"{_USUAL}; not much: within 60 steps",
              every(more("γ = 0.95", "l_max = 5"), as_many("l_max = 50", "γ = 0.95", 60.0)),
              "Five do nearly as well"),
        Claim("4 functions in each direction are better than 3", "8-2", _USUAL,
              more("4 by 4", "γ = 0.95")),
    ),
    "table8-3": (
        Claim("Demonstrations are inferior to random samples", "8-3, Table 8-3", _SETS,
              every(*(more("random", label) for label in (
                  "demonstration, 1000", "demonstration, 976", "late demonstration, 464")))),
        Claim("Merging two demonstrations does not help", "8-3, Table 8-3",
              f"{_SETS}; a help: more than 30 steps", _no_help),
        Claim("There is a high variance between random sample sets", "8-3, Table 8-3",
              "1,000 random samples, of 600 steps", _between_sets),
        Claim("Different initial weights already yield highly different results", "8-3 and 8-4",
              "1,000 random samples, of 600 steps; two draws of a standard normal w₀",
              _between_weights,
              "They do, by 150 of 600 steps; with 50 sets the interval just reaches below the 100 "
              "that are taken for highly"),
        Claim("Demonstrations have less variance in angle and rate than random samples",
              "8-3, Figs. 8-2 to 8-4", _SETS, _narrower),
        Claim("More functions help a demonstration", "8-4", _SETS,
              more("demonstration, 976, 4 by 4", "demonstration, 976"),
              "By 16 of 600 steps, which is left open"),
    ),
}  # fmt: skip
