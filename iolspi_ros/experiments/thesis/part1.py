"""T Part I, the conference paper: the pendulum's figures 2 to 19 and table 1, their settings."""

from __future__ import annotations

from dataclasses import replace

from iolspi_ros.experiments.cells import Cell, Data
from iolspi_ros.experiments.pendulum import HANGING, LITERAL, PendulumRun
from iolspi_ros.experiments.pendulum_episodes import Episodes, record
from iolspi_ros.experiments.pendulum_samples import Spread, spread
from iolspi_ros.experiments.samplesets import INDEPENDENT, MODES, NOTHING, SEQUENTIAL
from iolspi_ros.experiments.statistics import interval
from iolspi_ros.experiments.thesis import curves, drawing
from iolspi_ros.experiments.thesis.claims import Claim
from iolspi_ros.experiments.thesis.part1_claims import CLAIMS
from iolspi_ros.experiments.thesis.study import Rows, Study

EPSILONS = {f"ε = {e:g}": e for e in (0.0, 0.05, 0.2, 0.6, 1.0)}
CAREFUL = replace(LITERAL, epsilon=0.05)
JUMP = replace(HANGING, g_after=19.81, g_change_start=300.0)
SPREAD_STARTS = replace(HANGING, initial="distributed")
FORGETTING = {"η = 1": 1.0, "η = 0.99991": 0.99991, "η = 0.9995": 0.9995}

SETS = {f"set {number}": PendulumRun(samples=f"set {number}") for number in MODES}
KINDS = {
    "nothing": PendulumRun(),
    "set 5": SETS["set 5"],
    "sequential": PendulumRun(samples=SEQUENTIAL),
    "independent": PendulumRun(samples=INDEPENDENT),
}
DISTRIBUTED = {name: replace(s, task=SPREAD_STARTS) for name, s in KINDS.items()}
JUMPING = {
    "nothing": PendulumRun(CAREFUL, JUMP),
    "set 5": PendulumRun(CAREFUL, JUMP, samples="set 5"),
}


def forgetting(source: str) -> dict[str, PendulumRun]:
    """T Figs. 18 and 19: three forget factors, g that jumps."""
    return {
        name: PendulumRun(replace(CAREFUL, forget_factor=eta), JUMP, samples=source)
        for name, eta in FORGETTING.items()
    }


WINDOWS = ((300.0, -2, 2), (300.0, 0, 2), (600.0, -2, 2))
"""Before, after, and long after g jumps: time [s], episodes after it, how many."""
SPREADS = {f"set {n}": Spread(f"set {n}") for n in MODES} | {
    "sequential": Spread(SEQUENTIAL),
    "independent": Spread(INDEPENDENT),
}
_RETURN, _SCORE = "discounted return", "learning score (sum of rewards per episode)"


def pair(
    names: tuple[str, str],
    title: str,
    where: str,
    cells: tuple[Cell, ...],
    claims: dict[str, tuple[Claim, ...]],
    low: float | None = -2000.0,
    beside: tuple[str, ...] = (),
) -> list[Study]:
    """T's two figures of one sweep: discounted return of the policies, and learning score.

    Parameters
    ----------
    claims : dict
        By figure.
    low : float, optional
        Lower end of the first one's y axis.
    beside : tuple of str
        Labels of cells that are there for claims, and not drawn.
    """
    return [
        one(names[0], title, _RETURN, where, cells, claims, low, beside),
        one(names[1], title, _SCORE, where, cells, claims, None, beside),
    ]


def one(
    name: str,
    title: str,
    y: str,
    where: str,
    cells: tuple[Cell, ...],
    claims: dict[str, tuple[Claim, ...]],
    low: float | None = None,
    beside: tuple[str, ...] = (),
) -> Study:
    """One of T's figures over vehicle time; the other parameters are those of `pair`."""
    labels = [cell.label for cell in cells if cell.label not in beside]
    tabulate = curves.returns if y == _RETURN else curves.scores
    return Study(
        name, f"{title}: {y}", where, cells, curves.only(labels, tabulate),
        drawing.curves(title, y, low), claims.get(name, ()),
    )  # fmt: skip


def histories(
    name: str,
    title: str,
    where: str,
    settings: dict[str, Episodes],
    claims: dict[str, tuple[Claim, ...]],
    seeds: int = 10,
) -> Study:
    """T's time histories of angle and reward; the first realisation is drawn."""
    cells = tuple(Cell(label, record, s, seeds, 2.5) for label, s in settings.items())
    return Study(
        name, title, where, cells, _history_rows, drawing.histories(title), claims.get(name, ())
    )


def studies() -> list[Study]:
    """Every study of this part, in T's order."""
    rates = {name: PendulumRun(replace(LITERAL, epsilon=value)) for name, value in EPSILONS.items()}
    hanging = {f"hanging, {name}": KINDS[name] for name in ("nothing", "set 5")}
    sets = curves.cells(SETS | {NOTHING: PendulumRun()}, ("set 1", "set 5"))
    return [
        *pair(("fig2", "fig3"), "Online LSPI, constant exploration rates",
              "Part I, IV-A-1, Figs. 2 and 3", curves.cells(rates, ("ε = 0.2",)), CLAIMS),
        Study("table1", "Demonstration sets, as the scripted pilot flies them",
              "Part I, Table 1 (10-1)", _spread_cells(tuple(SPREADS)), _spread_rows,
              claims=CLAIMS["table1"]),
        *pair(("fig4", "fig5"), "IOLSPI from demonstration sets",
              "Part I, IV-A-2, Figs. 4 and 5", sets, CLAIMS, beside=(NOTHING,)),
        *(_samples(f"fig{number}", label) for number, label in
          ((6, "set 1"), (7, "set 5"), (8, "sequential"), (9, "independent"))),
        *pair(("fig10", "fig11"), "Sample sets of different types, hanging-down starts",
              "Part I, IV-A-2, Figs. 10 and 11", curves.cells(KINDS, ("nothing", "set 5")),
              CLAIMS),
        *pair(("fig12", "fig13"), "Sample sets of different types, distributed starts",
              "Part I, IV-A-3, Figs. 12 and 13",
              curves.cells(DISTRIBUTED | hanging, ("set 5",)), CLAIMS, -1000.0, tuple(hanging)),
        *pair(("fig14", "fig15"), "g jumps from 9.81 to 19.81 m/s² at 300 s, ε = 0.05",
              "Part I, IV-A-4, Figs. 14 and 15", curves.cells(JUMPING, ("nothing", "set 5")),
              CLAIMS, -2500.0),
        *(histories(f"fig{number}", f"Episodes before and after g jumps, from {label}",
                    f"Part I, IV-A-4, Fig. {number}",
                    {name: Episodes(s, WINDOWS) for name, s in JUMPING.items()
                     if name == label or number == 17}, CLAIMS)
          for number, label in ((16, "nothing"), (17, "set 5"))),
        one("fig18", "Online LSPI, forget factors, g jumps at 300 s", _SCORE,
            "Part I, IV-A-5, Fig. 18", curves.cells(forgetting(NOTHING), ("η = 0.99991",)), CLAIMS),
        one("fig19", "IOLSPI from set 5, forget factors, g jumps at 300 s", _SCORE,
            "Part I, IV-A-5, Fig. 19", curves.cells(forgetting("set 5"), ("η = 0.99991",)),
            CLAIMS),
    ]  # fmt: skip


def _spread_cells(labels: tuple[str, ...], seeds: int = 20) -> tuple[Cell, ...]:
    return tuple(Cell(label, spread, SPREADS[label], seeds, 0.15) for label in labels)


def _samples(name: str, label: str) -> Study:
    title = f"Samples of {label}"
    return Study(
        name, title, f"Part I, IV-A-2, Fig. {name[3:]}", _spread_cells((label,), 1),
        sample_rows, drawing.samples(title), CLAIMS.get(name, ()),
    )  # fmt: skip


def _spread_rows(data: Data) -> Rows:
    """T Table 1, and what the sets are like."""
    found: Rows = []
    for label, cell in data.items():
        mode, corruption = MODES[int(label[4:])] if label.startswith("set") else ("random", 1.0)
        row = {"set": label, "mode": mode, "corruption": corruption, "samples": cell["n"][0]}
        for name in ("visited", "above", "streak"):
            mean, low, high = interval(cell[name])
            row |= {name: mean, f"{name}_low": low, f"{name}_high": high}
        found.append(row)
    return found


def sample_rows(data: Data) -> Rows:
    """Every third sample of the first realisation of each set."""
    return [
        {"set": label, "angle": state[0], "rate": state[1], "action": int(action)}
        for label, cell in data.items()
        for state, action in zip(cell["state"][0][::3], cell["action"][0][::3], strict=True)
    ]


def _history_rows(data: Data) -> Rows:
    """Every third step of the first realisation."""
    found: Rows = []
    for label, cell in data.items():
        dt = HANGING.description.sampling_time
        for episode, angle, reward in zip(
            cell["episode"][0], cell["angle"][0], cell["reward"][0], strict=True
        ):
            begin = episode * HANGING.description.episode_steps * dt
            found += [
                {"run": label, "episode": int(episode), "x": begin + k * dt,
                 "angle": angle[k], "reward": reward[k]}
                for k in range(0, len(angle), 3)
            ]  # fmt: skip
    return found
