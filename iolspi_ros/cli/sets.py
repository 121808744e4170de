"""The demonstration sets that are shipped, and how each was flown."""

from __future__ import annotations

from iolspi_ros.errors import InputError

SETS = {
    "pendulum": {
        1: ("perform", 0.0), 2: ("explore", 0.0), 3: ("perform", 0.5), 4: ("perform", 0.33),
        5: ("explore", 0.33),
    },
    "slung_load": {1: ("perform", 0.0), 2: ("explore", 0.0), 3: ("perform", 0.2)},
}  # fmt: skip
"""Mode and corruption of each. The pendulum's are T Table 1; T tells nothing of the others."""


def mode_and_corruption(task: str, number: int) -> tuple[str, float]:
    """How a shipped set was flown.

    Raises
    ------
    InputError
        When there is no such set.
    """
    sets = SETS.get(task, {})
    if number not in sets:
        raise InputError(f"--set is {number}; allowed: 1 to {len(sets)}")
    return sets[number]
