"""What T's chapter 5 and appendix A say of Q-learning on the grid, and how data decide it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.experiments.cells import Data
from iolspi_ros.experiments.slung_grid import CUTOFFS
from iolspi_ros.experiments.statistics import Interval, difference, exactly, interval
from iolspi_ros.experiments.thesis import claims
from iolspi_ros.experiments.thesis.claims import OURS, Claim, Finding
from iolspi_ros.experiments.thesis.compare import Decide, every
from sim_nodes.tasks.slung_grid import SlungGrid

Array = NDArray[np.float64]

_GRID = SlungGrid()
_CUT = CUTOFFS.index(5)
_SCATTERED = "scattered starts"
_SETS = ("set 1", "set 2", "set 3")
_NAMES = {
    "average": "average return", "greedy": "final greedy return", "shown": "demonstrated return",
    "variety": "standard deviation of the demonstrated returns",
    "converged": "episodes until satisfactory", "angle": "θ at the end [deg]",
}  # fmt: skip


def higher(first: str, seconds: str | tuple[str, ...], what: str, by: float = 0.0) -> Decide:
    """The first is above each of the others."""

    def decide(data: Data) -> list[Finding]:
        return [
            claims.above(f"{first} minus {second}, {_NAMES[what]}",
                         difference(data[first][what], data[second][what]), by)
            for second in ((seconds,) if isinstance(seconds, str) else seconds)
        ]  # fmt: skip

    return decide


def near(first: str, second: str, what: str, margin: float) -> Decide:
    """Two differ by less than a margin."""

    def decide(data: Data) -> list[Finding]:
        gap = difference(data[first][what], data[second][what])
        return [claims.within(f"{first} minus {second}, {_NAMES[what]}", gap, -margin, margin)]

    return decide


def level(label: str, what: str, low: float, high: float) -> Decide:
    """A mean is between two limits."""
    return lambda data: [
        claims.within(f"{label}: {_NAMES[what]}", interval(data[label][what]), low, high)
    ]


def _largest(data: Data) -> list[Finding]:
    best = exactly(data["near-optimal"]["score"].item())
    return [claims.within("largest return", best, -1.965, -1.955)]


def _median(data: Data) -> list[Finding]:
    """Of the episodes until satisfactory, by the bootstrap's interval."""
    values, rng = data["Q-learning"]["converged"], np.random.default_rng(0)
    low, high = np.quantile(
        np.median(rng.choice(values, (2000, len(values))), axis=1), (0.025, 0.975)
    )
    median = Interval(float(np.median(values)), float(low), float(high))
    return [claims.within("Q-learning: episodes until satisfactory, median", median, 75.0, 300.0)]


def _better_than_shown(data: Data) -> list[Finding]:
    return [
        claims.above(f"{label}: greedy minus demonstrated return",
                     difference(data[label]["greedy"], data[label]["shown"]))
        for label in ("set 1", "set 2")
    ]  # fmt: skip


def _side(label: str, left: bool) -> Decide:
    """The share of realisations that end with the load on one side, above one half."""

    def decide(data: Data) -> list[Finding]:
        angle, reached = data[label]["angle"], data[label]["greedy"] > -25.0
        share = interval((angle[reached] < 0.0) == left)
        where = "left" if left else "right"
        return [claims.above(f"{label}: share that swings the load to the {where}", share, 0.5)]

    return decide


def _share(label: str, low: float, high: float) -> Decide:
    """Share of all pairs that were visited."""

    def decide(data: Data) -> list[Finding]:
        share = interval(data[label]["pairs"] / _GRID.size / 3)
        return [claims.within(f"{label}: share of pairs visited", share, low, high)]

    return decide


def values(name: str, where: tuple[float, float], against: tuple[float, float]) -> Decide:
    """The mean value over one range of |variable| is above that over another (C = 5)."""

    def decide(data: Data) -> list[Finding]:
        first, second = (_over(data, name, span) for span in (where, against))
        what = f"value by {name}, {_span(where)} minus {_span(against)}"
        return [claims.above(what, difference(first, second))]

    return decide


def _over(data: Data, name: str, span: tuple[float, float], what: str = "value") -> Array:
    d = ("position", "velocity", "angle", "rate").index(name)
    x = _GRID.low[d] + _GRID.spacing[d] * np.arange(_GRID.counts[d])
    inside = (x >= span[0]) & (x <= span[1])
    found = data[_SCATTERED][f"{what}_{name}"]
    part = found[:, _CUT, inside] if what == "value" else found[:, inside]
    return np.asarray(np.nanmean(part, axis=1))


def _span(span: tuple[float, float]) -> str:
    return f"{span[0]:g}" if span[0] == span[1] else f"{span[0]:g} to {span[1]:g}"


def most_visited(name: str, at: float, others: tuple[float, float]) -> Decide:
    """Visits at one place are above the mean of those in each of two neighbouring ranges."""

    def decide(data: Data) -> list[Finding]:
        here = _over(data, name, (at, at), "visits")
        spans = ((-others[1], -others[0]), others)
        return [
            claims.above(f"visits by {name}, {at:g} minus {_span(span)} [thousands]",
                         difference(here / 1e3, _over(data, name, span, "visits") / 1e3))
            for span in spans
        ]  # fmt: skip

    return decide


def _spread_evenly(data: Data) -> list[Finding]:
    visits = data[_SCATTERED]["visits_position"][:, 1:-1]
    ratio = interval(visits.max(axis=1) / visits.min(axis=1))
    return [claims.below("most over least visits of a position, the edges aside", ratio, 2.0)]


def swept(label: str, better: float, worse: tuple[float, ...], what: str = "average") -> Decide:
    """One value of the parameter has a higher average return than each of the others."""

    def decide(data: Data) -> list[Finding]:
        cell = data[label]
        x = cell["value"][0].tolist()
        first = cell[what][:, x.index(better)]
        sign = 1.0 if what == "average" else -1.0
        return [
            claims.above(f"{label}: {better:g} {'minus' if sign > 0 else 'before'} {value:g}, "
                         f"{_NAMES[what]}",
                         difference(sign * first, sign * cell[what][:, x.index(value)]))
            for value in worse
        ]  # fmt: skip

    return decide


def swept_near(label: str, at: tuple[float, ...], margin: float) -> Decide:
    """The average return differs from that of the first value by less than a margin."""

    def decide(data: Data) -> list[Finding]:
        cell = data[label]
        x = cell["value"][0].tolist()
        columns = [cell["average"][:, x.index(value)] for value in at]
        return [
            claims.within(f"{label}: {value:g} minus {at[0]:g}, {_NAMES['average']}",
                          difference(column, columns[0]), -margin, margin)
            for value, column in zip(at[1:], columns[1:], strict=True)
        ]  # fmt: skip

    return decide


def _constant(data: Data) -> list[Finding]:
    running = data["set 1"]["running"]
    change = difference(running[:, -1], running[:, 4])
    return [
        claims.within("set 1: average return of 2,000 minus that of 200 episodes", change, -1, 1),
        claims.above("set 1: average return of 2,000 episodes", interval(running[:, -1]), -10.0),
    ]


_TWO = "2,000 episodes, ε = 0.01, α = 0.01, Q_0 = -50, scripted pilot"
_FIVE = "5,000 episodes, ε = 0.01, α = 0.01; Q_0 = 0 for Q-learning alone, else -50"
_LONG = "100,000 episodes from any x and θ, Q_0 = 0; C = 5"
_ANY = "2,000 episodes, else the reference setting"

CLAIMS: dict[str, tuple[Claim, ...]] = {
    "table5-3": (
        Claim("The fourth set stands out: its scores are bad and vary most", "5-3-1, Fig. 5-3",
              "scripted pilot",
              every(higher("set 4", _SETS, "variety"), higher("set 1", "set 4", "shown"))),
    ),
    "fig5-4": (
        Claim("Q-learning needs around 150 episodes to a satisfactory policy", "5-3-3, Fig. 5-4",
              f"{_TWO}; around: 75 to 300",
              every(level("Q-learning", "converged", 75.0, 300.0), _median),
              "It depends on the draws: half of the runs find a way into the basket within some 60 "
              "episodes, and one in ten not within 2,000"),
        Claim("From set 1 it converges straight away", "5-3-3, Fig. 5-4", _TWO,
              level("set 1", "converged", 0.0, 15.0)),
        Claim("A bad set (4) does not improve anything", "5-3-3, Fig. 5-4", _TWO,
              higher("Q-learning", "set 4", "average")),
        Claim("From a proper set the average return is higher than Q-learning's", "5-3-3, Fig. 5-4",
              _TWO, every(*(higher(label, "Q-learning", "average") for label in _SETS))),
        Claim("Sets 1 and 2 are similar, set 3 is a little worse but comparable", "5-3-3, Fig. 5-4",
              f"{_TWO}; similar: within 1.5, comparable: within 5",
              every(near("set 1", "set 2", "average", 1.5), higher("set 1", "set 3", "average"),
                    near("set 1", "set 3", "average", 5.0))),
        Claim("From sets 1 and 2 the greedy policy ends better than the demonstrations",
              "5-3-3, Fig. 5-4", _TWO, _better_than_shown),
    ),
    "table5-4": (
        Claim("Q-learning has by far the worst average return", "5-3-3, Table 5-4", _FIVE,
              every(*(higher(label, "Q-learning", "average", 5.0) for label in
                      (*_SETS, "set 4")))),
        Claim("Q-learning has the best final greedy return, -1.96", "5-3-3, Table 5-4",
              f"{_FIVE}; and after 20,000 episodes",
              every(level("Q-learning", "greedy", -2.0, -1.9),
                    level("Q-learning, 20,000 episodes", "greedy", -2.0, -1.9),
                    higher("Q-learning, 20,000 episodes", (*_SETS, "set 4"), "greedy")),
              "-1.96 is the optimum, by dynamic programming, and Q-learning from zeros finds it; "
              "but equal values being drawn from, only after more episodes than T's 5,000. Where "
              "the arg max takes them in an order instead (\"ties in order\"), it takes fewer"),
        Claim("Set 4 gives the worst average and final return of the four", "5-3-3, Table 5-4",
              _FIVE, every(*(higher(label, "set 4", what) for what in ("average", "greedy")
                             for label in _SETS)),
              "Its average is the worst; its final return is not told from set 3's"),
        Claim("Set 1 averages -5.15 and ends at -4", "5-3-3, Table 5-4", f"{_FIVE}; within 2",
              every(level("set 1", "average", -7.15, -3.15), level("set 1", "greedy", -6.0, -2.0)),
              "The demonstrations of the scripted pilot score -5.5 on average; T does not say what "
              "the person's did"),
        Claim("T's -1.96 is the largest return that there is", OURS, "dynamic programming",
              _largest),
    ),
    "fig5-5": (
        Claim("The best solution swings the load to the left, not to the right",
              "5-3-3, Figs. 5-5 and 5-6", "Q-learning from zeros, 20,000 episodes",
              _side("Q-learning, 20,000 episodes", True)),
    ),
    "table5-5": (
        Claim("From scattered starts 33 % of the pairs are visited, from one start 8 %", "5-4-1",
              "100,000 episodes, Q_0 = 0; within a quarter",
              every(_share(_SCATTERED, 0.25, 0.41), _share("one start", 0.06, 0.10)),
              "From one start the optimum is found within 10,000 episodes and hardly left"),
    ),
    "fig5-7": (
        Claim("The value is highest between x = 4 and x = 6", "5-4-2, Fig. 5-7", _LONG,
              every(values("position", (4.0, 6.0), (-2.0, 3.5)),
                    values("position", (4.0, 6.0), (6.5, 8.0)))),
        Claim("The value falls gradually with the distance to the goal", "5-4-2, Fig. 5-7", _LONG,
              every(values("position", (2.0, 3.5), (0.0, 1.5)),
                    values("position", (0.0, 1.5), (-2.0, -0.5)))),
        Claim("Visits are spread equally over x, but for the edges", "5-4-2, Fig. 5-7",
              f"{_LONG}; equally: within a factor of 2", _spread_evenly),
    ),
    "fig5-8": (
        Claim("Visits are most at zero velocity", "5-4-2, Fig. 5-8", _LONG,
              most_visited("velocity", 0.0, (1.0, 5.0))),
        Claim("The value increases with positive velocity", "5-4-2, Fig. 5-8", _LONG,
              every(values("velocity", (3.0, 5.0), (1.0, 2.0)),
                    values("velocity", (4.0, 4.0), (2.0, 2.0)),
                    values("velocity", (2.0, 2.0), (0.0, 0.0))),
              "It does for the speeds that whole accelerations lead to from rest (0, 2, 4 m/s). "
              "The others are only met after the cap at ±5 m/s or coming back from it"),
        Claim("Zero velocity has a low value, moderately negative ones a high one",
              "5-4-2, Fig. 5-8", _LONG,
              every(values("velocity", (1.0, 2.0), (0.0, 0.0)),
                    values("velocity", (-2.0, -1.0), (0.0, 0.0))),
              "Moderately negative velocities are worth what none is, within 0.1"),
    ),
    "fig5-9": (
        Claim("Angles within 20° have a low value: the load is too low", "5-4-2, Fig. 5-9", _LONG,
              every(values("angle", (30.0, 70.0), (-20.0, 20.0)),
                    values("angle", (-70.0, -30.0), (-20.0, 20.0))),
              "The differences are small. By dynamic programming the mean of the largest returns "
              "is even best for a load that hangs"),
        Claim("Angles beyond 80° have a low value: the penalty", "5-4-2, Fig. 5-9", _LONG,
              every(values("angle", (30.0, 70.0), (90.0, 110.0)),
                    values("angle", (-70.0, -30.0), (-110.0, -90.0)))),
    ),
    "fig5-10": (
        Claim("Low rates are visited most, zero above all", "5-4-2, Fig. 5-10", _LONG,
              most_visited("rate", 0.0, (20.0, 100.0))),
        Claim("Higher rates seem to be valued higher", "5-4-2, Fig. 5-10", _LONG,
              every(values("rate", (300.0, 400.0), (0.0, 100.0)),
                    values("rate", (-400.0, -300.0), (-100.0, 0.0))),
              "T itself puts it down to values that have not converged"),
    ),
    "figA-1": (
        Claim("With demonstrations it converges faster and has a higher average return",
              "Appendix A, Fig. A-1", _TWO,
              every(higher("Q-learning", "set 1", "converged"),
                    higher("set 1", "Q-learning", "average"))),
    ),
    "figA-2": (
        Claim("A negative Q_0 is a benefit to both", "Appendix A, Fig. A-2", _ANY,
              every(swept("Q-learning", -50.0, (0.0,)), swept("set 1", -50.0, (0.0,)))),
        Claim("From Q_0 = 0, 2,000 episodes are not enough for Q-learning", "Appendix A, Fig. A-2",
              _ANY, swept("Q-learning", -10.0, (0.0, -1.0))),
        Claim("Q_0 = -50 is good for both", "Appendix A, Fig. A-2",
              f"{_ANY}; not worse than -20 and -100",
              every(swept("Q-learning", -50.0, (-20.0, -100.0)),
                    swept("set 1", -50.0, (-20.0, -100.0))),
              "It is between the others: Q-learning does better with -20, and from set 1 -100 is "
              "as good"),
    ),
    "figA-3": (
        Claim("With ε = 0.001 the average from a demonstration is high and constant",
              "Appendix A, Fig. A-3", "2,000 episodes; constant: within 1", _constant),
    ),
    "figA-4": (
        Claim("From demonstrations, the lower the exploration rate the higher the average",
              "Appendix A, Fig. A-4", _ANY,
              every(swept("set 1", 0.001, (0.01,)), swept("set 1", 0.01, (0.1,)),
                    swept("set 1", 0.1, (0.5,)))),
        Claim("Q-learning alone does best with ε between 0.001 and 0.05", "Appendix A, Fig. A-4",
              _ANY, swept("Q-learning", 0.01, (0.0, 0.1, 0.2, 0.5))),
        Claim("Higher exploration rates converge faster", "5-3-2", "Q-learning, 2,000 episodes",
              every(swept("Q-learning", 0.05, (0.01,), "converged"),
                    swept("Q-learning", 0.01, (0.001,), "converged")),
              "0.05 against 0.01 is left open: some runs need ten times as many episodes as "
              "others"),
    ),
    "figA-5": (
        Claim("With α = 0.001 the demonstration still helps", "Appendix A, Fig. A-5",
              "2,000 episodes", higher("set 1", "Q-learning", "average")),
    ),
    "figA-6": (
        Claim("A low learning rate that is not zero makes no big difference",
              "Appendix A, Fig. A-6", f"{_ANY}; 0.001 to 0.05, within 2",
              every(swept_near("Q-learning", (0.01, 0.001, 0.005, 0.05), 2.0),
                    swept_near("set 1", (0.01, 0.001, 0.005, 0.05), 2.0)),
              "No difference is found, but the intervals are as wide as the margin of 2"),
        Claim("Too high learning rates are not desirable", "Appendix A, Fig. A-6", _ANY,
              every(swept("Q-learning", 0.01, (0.5, 1.0)), swept("set 1", 0.01, (0.5, 1.0)))),
    ),
}  # fmt: skip
