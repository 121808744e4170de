"""What T's Part I says of the pendulum, and how data decide it."""

from __future__ import annotations

import numpy as np

from iolspi_ros.experiments.cells import Data
from iolspi_ros.experiments.samplesets import NOTHING
from iolspi_ros.experiments.statistics import difference, interval
from iolspi_ros.experiments.thesis import claims
from iolspi_ros.experiments.thesis.claims import Claim, Finding
from iolspi_ros.experiments.thesis.compare import (
    END,
    Decide,
    every,
    falls,
    higher,
    lower,
    near_best,
    rises,
    similar,
    sooner,
)  # fmt: skip
from iolspi_ros.experiments.thesis.curves import over

_WORSE = ("sequential", "nothing")
_SETS = ("set 1", "set 2", "set 3", "set 4")


def spread_apart(name: str, what: str, first: str, second: str) -> Decide:
    """The first set's measure of spread is larger than the second's."""

    def decide(data: Data) -> list[Finding]:
        gap = difference(data[first][name], data[second][name])
        return [claims.above(f"{first} minus {second}, {what}", gap)]

    return decide


def _less_benefit(data: Data) -> list[Finding]:
    """Gain of the demonstration in per cent of the cost without, hanging and distributed."""
    shares = []
    for prefix in ("hanging, ", ""):
        with_it, without = (
            over(data, f"{prefix}{name}", "discounted", 0.0, 600.0) for name in ("set 5", "nothing")
        )
        shares.append(100.0 * (with_it - without) / np.abs(without).mean())
    what = "gain of set 5 over nothing, hanging-down minus distributed starts [% of the return]"
    return [claims.above(what, difference(*shares))]


def _fluctuation(data: Data) -> list[Finding]:
    """Range of the scores of the 27 episodes after g jumped."""
    ranges = {}
    for label in ("set 5", "nothing"):
        score, n = data[label]["score"], data[label]["score"].shape[1]
        after = score[:, n // 2 : n // 2 + max(2, round(27 * n / 400))]
        ranges[label] = after.max(axis=1) - after.min(axis=1)
    return [
        claims.above("set 5: range of scores 300 to 340 s", interval(ranges["set 5"]), 800.0),
        claims.above("set 5 minus nothing, range of scores 300 to 340 s",
                     difference(ranges["set 5"], ranges["nothing"])),
    ]  # fmt: skip


def reached(label: str, episodes: slice, **limits: float) -> Decide:
    """Share of some recorded episodes that come upright at all: `above` or `below` a limit."""
    ((side, limit),) = limits.items()
    judge = {"above": claims.above, "below": claims.below}[side]

    def decide(data: Data) -> list[Finding]:
        share = np.isfinite(data[label]["reached"][:, episodes]).mean(axis=1)
        numbers = f"{episodes.start + 1} to {episodes.stop}"
        what = f"{label}: share of the recorded episodes {numbers} that come upright"
        return [judge(what, interval(share), limit)]

    return decide


def _one_swing_less(data: Data) -> list[Finding]:
    found = []
    for name, what in (("swings", "turns before upright"), ("reached", "seconds to upright")):
        last = {label: cell[name][:, 4:6] for label, cell in data.items()}
        mean = {k: np.nanmean(np.where(np.isnan(v), np.nan, v), axis=1) for k, v in last.items()}
        gap = mean["nothing"] - mean["set 5"]
        gap = gap[np.isfinite(gap)]
        found.append(claims.above(f"nothing minus set 5, {what}, last two episodes", interval(gap)))
    return found


CLAIMS: dict[str, tuple[Claim, ...]] = {
    "fig2": (
        Claim("To reach the optimal policy, at least some exploration is needed",
              "IV-A-1, Fig. 2", "online LSPI, K_θ = 1000",
              lower("ε = 0", ("ε = 0.05", "ε = 0.2"), "discounted", END)),
        Claim("Greediness also pays off: it brings samples from the swung-up part",
              "IV-A-1, Fig. 2", "online LSPI, K_θ = 1000",
              higher("ε = 0.2", "ε = 1", "discounted", END)),
        Claim("With ε = 1 the performance first decreases, after which it increases",
              "IV-A-1, Fig. 2", "online LSPI, K_θ = 1000",
              every(falls("ε = 1", "discounted", (20.0, 60.0), (140.0, 240.0)),
                    rises("ε = 1", "discounted", (140.0, 240.0), END)),
              "It depends on δ, which T does not give: with δ = 100 it falls until 360 s and then "
              "rises, with 0.01 it hardly moves after 120 s, with our δ = 1 it goes on falling "
              "(six realisations each)"),
    ),
    "fig3": (
        Claim("A high exploration rate yields low learning scores", "IV-A-1, Fig. 3",
              "online LSPI, K_θ = 1000",
              every(lower("ε = 0.6", "ε = 0.2", "score", END),
                    lower("ε = 1", "ε = 0.6", "score", END))),
        Claim("Some exploration is beneficial for the learning score", "IV-A-1, Fig. 3",
              "online LSPI, K_θ = 1000", higher("ε = 0.05", "ε = 0", "score", END),
              "Nearly decided; the policies are better (Fig. 2), but their random actions cost "
              "most of what that gains"),
    ),
    "table1": (
        Claim("Sets 1 and 5: corruption and exploration show as a wider distribution, in action "
              "and in state", "IV-A-2, Figs. 6 and 7", "sets of the scripted pilot",
              every(spread_apart("visited", "boxes visited", "set 5", "set 1"),
                    spread_apart("streak", "mean streak of one action", "set 1", "set 5"))),
        Claim("Corruption increases the variety of a set", "IV-A-2", "sets of the scripted pilot",
              every(spread_apart("visited", "boxes visited", "set 4", "set 1"),
                    spread_apart("visited", "boxes visited", "set 5", "set 2")),
              "An exploring scripted pilot visits even more boxes without corruption"),
        Claim("Random sequential samples spread little: the swung-up region is hardly reached",
              "IV-A-2, Fig. 8", "21 episodes of random actions",
              every(spread_apart("above", "share in the upper half", "set 5", "sequential"),
                    spread_apart("visited", "boxes visited", "set 5", "sequential"),
                    spread_apart("visited", "boxes visited", "independent", "sequential"))),
    ),
    "fig4": (
        Claim("Set 5 (33 % corrupted, exploratory) performs best", "IV-A-2, Fig. 4",
              "IOLSPI, K_θ = 1000, ε = 0.2, scripted pilot",
              higher("set 5", _SETS, "discounted"),
              "Set 2 is as good: exploring alone spreads the scripted pilot's samples as far as "
              "corruption does (table1: boxes visited)"),
        Claim("Set 3 (50 % corrupted) also performs well: it converges to a good policy",
              "IV-A-2, Fig. 4", "IOLSPI, K_θ = 1000, ε = 0.2, scripted pilot",
              near_best("set 3", "discounted", END, 1.05)),
        Claim("Sets 3 and 5 perform well from the start, where online LSPI needs some time",
              "IV-A-2, Fig. 4", "IOLSPI, K_θ = 1000, ε = 0.2, scripted pilot",
              every(higher("set 3", NOTHING, "discounted", (0.0, 20.0)),
                    higher("set 5", NOTHING, "discounted", (0.0, 20.0)))),
        Claim("The uncorrupted sets perform significantly worse", "IV-A-2, Fig. 4",
              "IOLSPI, K_θ = 1000, ε = 0.2, scripted pilot",
              every(lower("set 1", ("set 3", "set 5"), "discounted"),
                    lower("set 2", ("set 3", "set 5"), "discounted")),
              "Set 1 does. Set 2, explored without corruption, is as good as any: the scripted "
              "pilot explores more states than T's person may have"),
    ),
    "fig5": (
        Claim("So does the learning score: set 5 best, the uncorrupted sets worse",
              "IV-A-2, Fig. 5", "IOLSPI, K_θ = 1000, ε = 0.2, scripted pilot",
              every(higher("set 5", _SETS, "score"), lower("set 1", "set 3", "score"),
                    lower("set 2", "set 3", "score")),
              "As for the discounted return: set 2 is as good as set 5"),
    ),
    "fig10": (
        Claim("Independent random samples and the demonstration perform best",
              "IV-A-2, Fig. 10", "hanging-down starts, ε = 0.2",
              every(higher("set 5", _WORSE, "discounted"),
                    higher("independent", _WORSE, "discounted"))),
        Claim("With them a good policy is followed from the start on", "IV-A-2, Fig. 10",
              "hanging-down starts, ε = 0.2; good: cost at most 1.1 near-optimal ones",
              every(near_best("set 5", "discounted", (0.0, 20.0), 1.1),
                    near_best("independent", "discounted", (0.0, 20.0), 1.1))),
        Claim("Their converged policy is also better than the others'", "IV-A-2, Fig. 10",
              "hanging-down starts, ε = 0.2",
              every(higher("set 5", _WORSE, "discounted", END),
                    higher("independent", _WORSE, "discounted", END)),
              "After 500 s all four are within 0.5 % of each other"),
    ),
    "fig11": (
        Claim("The human scores better than a random policy", "IV-A-2, Fig. 11",
              "hanging-down starts, ε = 0.2", higher("set 5", "sequential", "score")),
        Claim("The demonstration gives a good policy straight away; without it takes 200 s",
              "chapter 12", "hanging-down starts, ε = 0.2",
              every(higher("set 5", "nothing", "score", (0.0, 200.0)),
                    similar("nothing", "set 5", "score", (200.0, 300.0), 0.05))),
    ),
    "fig12": (
        Claim("Random policy and online LSPI reach the demonstration's performance in 100 s",
              "IV-A-3, Fig. 12", "distributed starts, ε = 0.2; reached: within 2 %",
              every(*(similar(name, "set 5", "discounted", (100.0, 120.0)) for name in _WORSE)),
              "On average they do, within 1 %"),
        Claim("Their final policy performs a little less; the difference is small (1 %)",
              "IV-A-3, Fig. 12; V", "distributed starts, ε = 0.2; small: within 1.5 %",
              every(*(lower(name, "set 5", "discounted", END) for name in _WORSE),
                    *(similar(name, "set 5", "discounted", END, 0.015) for name in _WORSE)),
              "In the end all are within half a per cent"),
        Claim("The benefit of the demonstration is a lot less than with hanging-down starts",
              "IV-A-3, Fig. 12", "ε = 0.2, whole run", _less_benefit,
              "From nothing, distributed starts are not learned faster here: in the first 20 s "
              "the demonstration gains 17 % of the return with hanging-down starts and 19 % with "
              "distributed ones, in 600 s 2 % with both"),
    ),
    "fig13": (
        Claim("Within 100 s the score is similar for all sample sets", "IV-A-3, Fig. 13",
              "distributed starts, ε = 0.2; similar: within 3 %",
              every(*(similar(name, "set 5", "score", (100.0, 200.0), 0.03)
                      for name in (*_WORSE, "independent"))),
              "The demonstration, random episodes and nothing agree; the independent samples, "
              "which are everywhere, do better than a demonstration from hanging-down starts"),
    ),
    "fig14": (
        Claim("When g jumps, the return drops drastically", "IV-A-4, Fig. 14",
              "ε = 0.05; return under the new g of the policy in use",
              every(falls("nothing", "discounted", (200.0, 280.0), (300.0, 300.0)),
                    falls("set 5", "discounted", (200.0, 280.0), (300.0, 300.0)))),
        Claim("It goes up again: the agent adapts to the new conditions", "IV-A-4, Fig. 14",
              "ε = 0.05", rises(("nothing", "set 5"), "discounted", (300.0, 320.0), END)),
        Claim("Before the change IOLSPI is at a good policy, online LSPI not yet",
              "IV-A-4, Figs. 14 to 17", "ε = 0.05; good: cost at most 1.05 near-optimal ones",
              every(near_best("set 5", "discounted", (200.0, 280.0), 1.05),
                    higher("set 5", "nothing", "discounted", (200.0, 280.0)))),
    ),
    "fig15": (
        Claim("From 300 to 340 s IOLSPI's scores go up and down by up to 1000; online LSPI's do "
              "not", "IV-A-4, Fig. 15", "ε = 0.05; range of the scores of 27 episodes",
              _fluctuation,
              "Those of both range as far, over 3,000: whether one episode comes upright under g "
              "= 19.81 m/s² makes that difference"),
        Claim("Scores drop with the jump and go up again", "IV-A-4, Fig. 15", "ε = 0.05",
              every(falls("nothing", "score", (200.0, 300.0), (300.0, 320.0)),
                    falls("set 5", "score", (200.0, 300.0), (300.0, 320.0)),
                    rises(("nothing", "set 5"), "score", (300.0, 340.0), END))),
    ),
    "fig16": (
        Claim("Online LSPI succeeds in only some episodes before the change (one of two)",
              "IV-A-4, Fig. 16", "ε = 0.05", reached("nothing", slice(0, 2), below=0.9),
              "Ten realisations of two episodes leave it open; three of four succeed"),
        Claim("Just after the change it does not swing up; at the end it does",
              "IV-A-4, Fig. 16", "ε = 0.05",
              every(reached("nothing", slice(2, 4), below=0.5),
                    reached("nothing", slice(4, 6), above=0.5))),
    ),
    "fig17": (
        Claim("IOLSPI does not swing up just after the change either; at the end it does",
              "IV-A-4, Fig. 17", "ε = 0.05",
              every(reached("set 5", slice(2, 4), below=0.5),
                    reached("set 5", slice(4, 6), above=0.5))),
        Claim("In the end IOLSPI needs one swing less than online LSPI and is upright sooner",
              "IV-A-4, Figs. 16 and 17", "ε = 0.05; runs in which both come upright",
              _one_swing_less,
              "In the end both need as many swings"),
    ),
    "fig18": (
        Claim("Online: much forgetting (η = 0.9995) yields poor results", "IV-A-5, Fig. 18",
              "ε = 0.05, g jumps", lower("η = 0.9995", ("η = 1", "η = 0.99991"), "score")),
        Claim("Online: η = 0.99991 is better than η = 1 before the change", "IV-A-5, Fig. 18",
              "ε = 0.05", higher("η = 0.99991", "η = 1", "score", (100.0, 300.0))),
        Claim("Online: η = 0.99991 is clearly better than η = 1 after the change",
              "IV-A-5, Fig. 18", "ε = 0.05, g jumps",
              higher("η = 0.99991", "η = 1", "score", (300.0, 600.0))),
    ),
    "fig19": (
        Claim("IOLSPI: much forgetting (η = 0.9995) yields poor results", "IV-A-5, Fig. 19",
              "ε = 0.05, g jumps", lower("η = 0.9995", ("η = 1", "η = 0.99991"), "score")),
        Claim("IOLSPI: with η = 0.99991 the score decreases in the first 300 s, as the "
              "demonstration is forgotten", "IV-A-5, Fig. 19", "ε = 0.05",
              every(lower("η = 0.99991", "η = 1", "score", (100.0, 300.0)),
                    falls("η = 0.99991", "score", (0.0, 100.0), (200.0, 300.0))),
              "Forgetting costs what T says, but in the first 300 s learning on gains more than "
              "that"),
        Claim("IOLSPI: after the change η = 0.99991 is better than η = 1", "IV-A-5, Fig. 19",
              "ε = 0.05, g jumps", higher("η = 0.99991", "η = 1", "score", (300.0, 600.0))),
        Claim("With mild forgetting IOLSPI needs over 40,000 steps (200 s) less for a similar "
              "performance after the change", "V", "ε = 0.05, g jumps",
              sooner("η = 0.99991", "η = 1", 320.0, 200.0)),
    ),
}  # fmt: skip
