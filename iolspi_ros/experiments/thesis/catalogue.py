"""All figures and tables by name."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

from iolspi_ros.errors import InputError
from iolspi_ros.experiments.thesis.study import Study


@cache
def studies() -> dict[str, Study]:
    """Every study by its name, in the order of the thesis."""
    from iolspi_ros.experiments.thesis import (
        chapter5,
        chapter6,
        chapter8,
        chapter9,
        chapter10,
        finding,
        part1,
        slung_load,
    )

    found: dict[str, Study] = {}
    for chapter in (part1, slung_load, chapter5, chapter6, chapter8, chapter9, chapter10, finding):
        for study in chapter.studies():
            assert study.name not in found, f"two studies named {study.name}"
            found[study.name] = study
    return found


def chosen(names: Sequence[str]) -> list[Study]:
    """The studies of these names.

    Raises
    ------
    InputError
        Naming one that is unknown, and those that are known.
    """
    known = studies()
    for name in names:
        if name not in known:
            raise InputError(f"figure or table {name!r} is unknown; allowed: {', '.join(known)}")
    return [known[name] for name in dict.fromkeys(names)]
