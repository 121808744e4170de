"""T chapter 10: further results for the pendulum, their settings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from iolspi_ros.experiments.pendulum import HANGING, LITERAL, PendulumRun
from iolspi_ros.experiments.pendulum_episodes import Episodes
from iolspi_ros.experiments.samplesets import MODES, NOTHING
from iolspi_ros.experiments.thesis import curves
from iolspi_ros.experiments.thesis.chapter10_claims import CLAIMS
from iolspi_ros.experiments.thesis.chapter10_informed import CLAIMS as INFORMED
from iolspi_ros.experiments.thesis.part1 import (
    CAREFUL,
    EPSILONS,
    JUMP,
    SETS,
    SPREAD_STARTS,
    WINDOWS,
    forgetting,
    histories,
    one,
    pair,
)  # fmt: skip
from iolspi_ros.experiments.thesis.study import Study
from sim_nodes.world import WorldSettings

INTERVALS = {f"K = {k}": k for k in (2, 10, 100, 1000, 5000)}
_FEWER = {"K = 2": 2, "K = 10": 5}  # realisations: 60,000 and 12,000 solves in each
DECAYS = {f"ε_d = {d:g}": d for d in (0.8913, 0.955, 0.9772, 0.9962, 0.9996, 1.0)}
"""Factors a second; T names 0.9996 and 1. The others bring ε to 0.1 in 20, 50, 100 and 600 s."""
DISCOUNTS = {f"γ = {g:g}": g for g in (0.8, 0.95, 0.98, 0.995, 0.999)}
ACTION_NOISE = {f"σ_a = {s:g} V": WorldSettings(action_noise=s) for s in (0.0, 0.3, 1.0, 10.0)}
SENSOR_NOISE = {
    f"σ_s = {angle:g}°, {rate:g}°/s": WorldSettings(
        sensor_noise=(float(np.radians(angle)), float(np.radians(rate)))
    )
    for angle, rate in ((0.0, 0.0), (1.0, 5.0), (2.0, 10.0), (25.0, 125.0))
}
GRAVITIES = {f"g = {g:g}": g for g in (3.81, 7.81, 9.81, 11.81, 19.81)}
GRADUAL = replace(JUMP, g_change_duration=300.0)
RATES = {f"ε = {e:g}": e for e in (0.0, 0.05, 0.1, 0.2, 0.6)}
LOW_RATES = {name: e for name, e in RATES.items() if e <= 0.2}
MORE_FORGETTING = {"η = 1": 1.0, "η = 0.99997": 0.99997, "η = 0.99991": 0.99991,
                   "η = 0.99977": 0.99977, "η = 0.9995": 0.9995}  # fmt: skip
MILD = 0.99991
_LAST = ((600.0, -4, 4),)


def _rates(
    task: object, rates: dict[str, float], samples: str, eta: float
) -> dict[str, PendulumRun]:
    """Constant exploration rates."""
    return {
        name: PendulumRun(
            replace(LITERAL, epsilon=e, forget_factor=eta), task, samples=samples
        )
        for name, e in rates.items()
    }  # fmt: skip


def studies() -> list[Study]:
    """Every study of this chapter, in T's order."""
    return [*_tuning(), *_noise(), *_gravity(), *_forgetting(), *_distributed(), *_informed()]


def _tuning() -> list[Study]:
    intervals = {
        name: PendulumRun(replace(LITERAL, update_interval=k)) for name, k in INTERVALS.items()
    }
    decays = {
        name: PendulumRun(replace(LITERAL, epsilon=1.0, epsilon_decay=d))
        for name, d in DECAYS.items()
    }
    discounts = {n: PendulumRun(gamma=g) for n, g in DISCOUNTS.items()}
    updates = tuple(
        replace(cell, seeds=_FEWER.get(cell.label, cell.seeds))
        for cell in curves.cells(intervals, ("K = 1000",))
    )
    return [
        *pair(("fig10-1", "fig10-2"), "Online LSPI, update intervals",
              "10-1-1, Figs. 10-1 and 10-2", updates, CLAIMS),
        *pair(("fig10-3", "fig10-4"), "Online LSPI, decaying exploration, ε_0 = 1",
              "10-1-1, Figs. 10-3 and 10-4", curves.cells(decays, ("ε_d = 0.9772",)), CLAIMS),
        *pair(("fig10-5", "fig10-6"), "Online LSPI, discount factors (returns with γ = 0.98)",
              "10-1-1, Figs. 10-5 and 10-6", curves.cells(discounts, ("γ = 0.98",)), CLAIMS),
        *(histories(f"fig10-{number}", f"Online LSPI, last episodes with {label}",
                    f"10-1-1, Fig. 10-{number}", {label: Episodes(discounts[label], _LAST)},
                    CLAIMS)
          for number, label in ((7, "γ = 0.8"), (8, "γ = 0.999"))),
    ]  # fmt: skip


def _noise() -> list[Study]:
    action = {name: PendulumRun(world=noise) for name, noise in ACTION_NOISE.items()}
    sensor = {name: PendulumRun(world=noise) for name, noise in SENSOR_NOISE.items()}
    strongest = "σ_a = 10 V"
    return [
        *pair(("fig10-9", "fig10-10"), "Online LSPI, noise on the action",
              "10-1-2, Figs. 10-9 and 10-10", curves.cells(action, ("σ_a = 1 V",)), CLAIMS),
        histories("fig10-11", f"Online LSPI, last episodes with {strongest}",
                  "10-1-2, Fig. 10-11", {strongest: Episodes(action[strongest], _LAST)}, CLAIMS),
        *pair(("fig10-12", "fig10-13"), "Online LSPI, noise of the sensors",
              "10-1-2, Figs. 10-12 and 10-13",
              curves.cells(sensor, (list(sensor)[2],)), CLAIMS),
    ]  # fmt: skip


def _gravity() -> list[Study]:
    constant = {name: PendulumRun(task=replace(HANGING, g=g)) for name, g in GRAVITIES.items()}
    sudden = {
        f"to {g:g}": PendulumRun(task=replace(HANGING, g_after=g, g_change_start=300.0))
        for g in GRAVITIES.values()
        if g != 9.81
    }
    jump = _rates(JUMP, RATES, NOTHING, 1.0)
    gradual = _rates(GRADUAL, RATES, NOTHING, 1.0)
    steady = curves.cells(constant, ("g = 19.81",), baselines=tuple(constant))
    finals = _beside("sudden, ", jump)
    forgetful = replace(gradual["ε = 0.05"], learner=replace(CAREFUL, forget_factor=MILD))
    return [
        *pair(("fig10-14", "fig10-15"), "Online LSPI, constant g",
              "10-1-3, Figs. 10-14 and 10-15", steady, CLAIMS, -2500.0),
        *pair(("fig10-16", "fig10-17"), "Online LSPI, g jumps from 9.81 m/s² at 300 s",
              "10-1-3, Figs. 10-16 and 10-17",
              curves.cells(sudden | constant, ("to 19.81",), baselines=tuple(sudden)), CLAIMS,
              -2500.0, tuple(constant)),
        *(histories(f"fig10-{number}", f"Online LSPI, g jumps {label} m/s²",
                    f"10-1-3, Fig. 10-{number}", runs, CLAIMS)
          for number, label, runs in (
              (18, "to 3.81", {"ε = 0.2": Episodes(sudden["to 3.81"], WINDOWS)}),
              (19, "to 19.81", {"ε = 0.2": Episodes(sudden["to 19.81"], WINDOWS),
                                "ε = 0.05": Episodes(jump["ε = 0.05"], WINDOWS)}))),
        *pair(("fig10-20", "fig10-21"), "Online LSPI, g jumps to 19.81 m/s², exploration rates",
              "10-1-3, Figs. 10-20 and 10-21", curves.cells(jump, ("ε = 0.05",)), CLAIMS, -2500.0),
        *pair(("fig10-22", "fig10-23"), "Online LSPI, g grows to 19.81 m/s², exploration rates",
              "10-1-3, Figs. 10-22 and 10-23",
              curves.cells(gradual | finals, ("ε = 0.05",)), CLAIMS, -2500.0, tuple(finals)),
        histories("fig10-24", "Online LSPI, last episodes of growing g, η = 0.99991, ε = 0.05",
                  "10-1-3, Fig. 10-24",
                  {"ε = 0.05": Episodes(forgetful, ((600.0, -10, 10),))}, CLAIMS),
    ]  # fmt: skip


def _forgetting() -> list[Study]:
    jump = {
        name: PendulumRun(replace(CAREFUL, forget_factor=eta), JUMP)
        for name, eta in MORE_FORGETTING.items()
    }
    still = {name: replace(setting, task=HANGING) for name, setting in forgetting(NOTHING).items()}
    return [
        *pair(("fig10-25", "fig10-26"), "Online LSPI, forget factors, g jumps, ε = 0.05",
              "10-1-4, Figs. 10-25 and 10-26", curves.cells(jump, ("η = 0.99991",)), CLAIMS,
              -2500.0),
        one("fig10-27", "Online LSPI, forget factors, g jumps, ε = 0.05", "learning score",
            "10-1-4, Fig. 10-27", curves.cells(forgetting(NOTHING), ("η = 0.99991",)), CLAIMS),
        one("fig10-28", "Online LSPI, forget factors, constant g, ε = 0.05", "learning score",
            "10-1-4, Fig. 10-28", curves.cells(still, ("η = 0.99991",)), CLAIMS),
    ]  # fmt: skip


def _distributed() -> list[Study]:
    rates = {
        name: PendulumRun(replace(LITERAL, epsilon=e), SPREAD_STARTS)
        for name, e in EPSILONS.items()
    }
    decays = {
        name: PendulumRun(replace(LITERAL, epsilon=1.0, epsilon_decay=d), SPREAD_STARTS)
        for name, d in DECAYS.items()
    }
    hanging = {f"hanging, {name}": replace(decays[name], task=HANGING) for name in list(DECAYS)[:4]}
    return [
        *pair(("fig10-29", "fig10-30"), "Online LSPI, constant exploration, distributed starts",
              "10-1-5, Figs. 10-29 and 10-30", curves.cells(rates, ("ε = 0.2",)), CLAIMS, -1000.0),
        *pair(("fig10-31", "fig10-32"), "Online LSPI, decaying exploration, distributed starts",
              "10-1-5, Figs. 10-31 and 10-32", curves.cells(decays | hanging, ("ε_d = 0.9772",)),
              CLAIMS, -1000.0, tuple(hanging)),
    ]  # fmt: skip


def _informed() -> list[Study]:
    repeats = {f"set {n}{a}": PendulumRun(samples=f"set {n}{a}") for n in MODES for a in ("", "a")}
    best = SETS["set 5"]
    action = {name: replace(best, world=noise) for name, noise in ACTION_NOISE.items()}
    sensor = {name: replace(best, world=noise) for name, noise in SENSOR_NOISE.items()}
    jump, mild = (_rates(JUMP, LOW_RATES, "set 5", eta) for eta in (1.0, MILD))
    gradual, both = (_rates(GRADUAL, LOW_RATES, "set 5", eta) for eta in (1.0, MILD))
    return [
        *pair(("fig10-33", "fig10-34"), "IOLSPI, demonstration sets and their repeats",
              "10-2-1, Figs. 10-33 and 10-34", curves.cells(repeats, ("set 5",)), INFORMED),
        *pair(("fig10-35", "fig10-36"), "IOLSPI from set 5, noise on the action",
              "10-2-2, Figs. 10-35 and 10-36", curves.cells(action, ("σ_a = 1 V",)), INFORMED),
        *pair(("fig10-37", "fig10-38"), "IOLSPI from set 5, noise of the sensors",
              "10-2-2, Figs. 10-37 and 10-38", curves.cells(sensor, (list(sensor)[2],)), INFORMED),
        *(one(f"fig10-{number}", f"IOLSPI from set 5, g {how} to 19.81 m/s², η = {eta:g}",
              "learning score", f"10-2-3, Fig. 10-{number}",
              curves.cells(settings | others, ("ε = 0.05",)), INFORMED, beside=tuple(others))
          for number, how, eta, settings, others in (
              (39, "jumps", 1.0, jump, {}),
              (40, "jumps", MILD, mild, _beside("without forgetting, ", jump)),
              (41, "grows", 1.0, gradual, _beside("sudden, ", jump)),
              (42, "grows", MILD, both, _beside("without forgetting, ", gradual)))),
    ]  # fmt: skip


def _beside(prefix: str, settings: dict[str, PendulumRun]) -> dict[str, PendulumRun]:
    return {prefix + name: setting for name, setting in settings.items()}
