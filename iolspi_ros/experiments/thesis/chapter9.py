"""T chapter 9: forget factors (table 9-1) and the number of realisations (figures 9-5 to 9-8)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from iolspi_ros.core.moments import forget_factor_for
from iolspi_ros.experiments.cells import Cell, Data
from iolspi_ros.experiments.pendulum import LITERAL, PendulumRun, learn
from iolspi_ros.experiments.samplesets import NOTHING
from iolspi_ros.experiments.statistics import Interval, exactly, interval, intervals
from iolspi_ros.experiments.thesis import claims, curves, drawing, part1
from iolspi_ros.experiments.thesis.claims import Claim, Finding
from iolspi_ros.experiments.thesis.compare import WHOLE, every, similar
from iolspi_ros.experiments.thesis.study import Rows, Study

TABLE = {
    1000: 0.997700, 5000: 0.999540, 10000: 0.999770, 20000: 0.999885, 50000: 0.999954,
    100000: 0.999977, 150000: 0.999985,
}  # fmt: skip
"""T Table 9-1 as printed: forget factor by number of samples; "All" is 1."""
LEFT = 0.1
"""Share of its weight that T's numbers leave a sample; T Eq. 9-13 says 0.01."""
MANY = PendulumRun(replace(LITERAL, update_interval=100, epsilon=0.6))
COUNTS = {"fig9-5": 10, "fig9-6": 30, "fig9-7": 50, "fig9-8": 100}


def studies() -> list[Study]:
    """Every study of this chapter."""
    mild = part1.forgetting(NOTHING)["η = 0.99991"]
    scalings = {
        "by n_s": mild,
        "by the sum of weights": replace(mild, learner=replace(mild.learner, scaling="weights")),
    }
    return [
        Study("table9-1", "Forget factors", "9-2, Table 9-1", (), _table, claims=_DIGITS),
        Study(
            "section9-2", "Scaling of a solve: learning score", "9-2, Eqs. 9-14 and 9-15",
            curves.cells(scalings), curves.scores,
            drawing.curves("Scaling of a solve", "learning score"), (_SCALING,),
        ),
        *(_realisations(name, count) for name, count in COUNTS.items()),
    ]  # fmt: skip


def _table(data: Data) -> Rows:
    """Side by side: T's number, what leaves 10 % and what Eq. 9-13 gives."""
    return [
        {
            "samples": n,
            "T": f"{printed:.6f}",
            "leaving_10_percent": f"{forget_factor_for(n, LEFT):.6f}",
            "equation_9_13_leaving_1_percent": f"{forget_factor_for(n):.6f}",
        }
        for n, printed in TABLE.items()
    ]


def _agreement(left: float) -> Finding:
    equal = [round(forget_factor_for(n, left), 6) == eta for n, eta in TABLE.items()]
    share = float(np.mean(equal))
    what = f"share of the table's entries that leave {left:.0%}"
    return claims.within(what, exactly(share), 1.0, 1.0)


_DIGITS = (
    Claim(
        "The forget factors of Table 9-1",
        "9-2, Table 9-1",
        "0.1^(1/N), six digits",
        lambda data: [_agreement(LEFT)],
    ),
    Claim(
        "η = 0.01^(1/N) gives them",
        "9-2, Eq. 9-13",
        "0.01^(1/N), six digits",
        lambda data: [_agreement(0.01)],
        "The table's numbers leave a sample 10 % of its weight after N samples, not 1 %; Part I's "
        "0.99991 and 0.9995 follow the equation",
    ),
)

_SCALING = Claim(
    "Scaling a solve by the sum of weights instead of n_s makes no significant difference",
    "9-2, Eq. 9-15",
    "online LSPI, η = 0.99991, ε = 0.05, g jumps; no difference: within 2 %",
    every(
        similar("by the sum of weights", "by n_s", "score", WHOLE),
        similar("by the sum of weights", "by n_s", "discounted", WHOLE),
    ),
)


def _realisations(name: str, count: int) -> Study:
    cell = Cell("online LSPI", learn, MANY, 100 if name == "fig9-8" else count, 3.0)
    title = f"{count} realisations, K_θ = 100, ε = 0.6"
    found = (_WIDTHS,) if count == 100 else ()
    return Study(
        name, f"{title}: learning score", f"9-3, Fig. {name[3:]}", (cell,), _bounds,
        drawing.curves(title, "learning score (sum of rewards per episode)"), found,
    )  # fmt: skip


def _bounds(data: Data) -> Rows:
    """Mean, 95 % bounds and extremes."""
    (cell,) = data.values()
    found = curves.scores(data)
    ends = (("least", np.min), ("most", np.max))
    for name, end in ends:
        extreme = dict(cell) | {"score": end(cell["score"], axis=0, keepdims=True)}
        found += curves.scores({f"{name} of {len(cell['score'])}": extreme})
    return found


def _width(score: np.ndarray) -> float:
    """Mean width of the 95 % bounds over the run."""
    _, low, high = intervals(score)
    return float(np.mean(high - low))


def _widths(data: Data) -> list[Finding]:
    """How the bounds shrink, from disjoint groups of realisations."""
    (cell,) = data.values()
    score = cell["score"]
    n = len(score)
    sizes = sorted({max(2, n // 10), max(2, n // 4), max(2, n // 2), n})
    groups = {
        k: np.array([_width(score[i : i + k]) for i in range(0, n - k + 1, k)]) for k in sizes
    }
    if len(groups) < 2:
        nothing = Interval(np.nan, np.nan, np.nan)
        return [claims.above("too few realisations to tell", nothing)]
    first, *_, last = groups
    found = [
        claims.below(
            f"width of the bounds of {k} over that of {first} realisations",
            _ratio(groups[k], groups[first]),
            1.0,
        )
        for k in list(groups)[1:]
    ]
    half = list(groups)[-2]
    gain = 1.0 - groups[last][0] / groups[half]
    what = f"narrower with {last} than with {half} realisations, share"
    return [*found, claims.above(what, interval(gain))]


def _ratio(widths: np.ndarray, base: np.ndarray) -> Interval:
    mean = float(widths.mean() / base.mean())
    relative = interval(base)
    half = mean * (relative.high - relative.mean) / relative.mean
    return Interval(mean, mean - half, mean + half)


_WIDTHS = Claim(
    "10 realisations are not enough: the bounds become smaller up to 25, a little up to 50, and "
    "some more with 100",
    "9-3, Figs. 9-5 to 9-8",
    "online LSPI, K_θ = 100, ε = 0.6; disjoint groups of the 100",
    _widths,
    "30 % is what √2 gives, but there are only two halves to take it from",
)
