"""The demonstration sets that are shipped, and how each was flown."""

from __future__ import annotations

from iolspi_ros.errors import InputError

SETS = {1: ("perform", 0.0), 2: ("explore", 0.0), 3: ("perform", 0.5), 4: ("perform", 0.33),
        5: ("explore", 0.33)}  # fmt: skip
"""Mode and corruption of each, of every task: T Table 1, which is about the pendulum."""


def mode_and_corruption(number: int) -> tuple[str, float]:
    """How a shipped set was flown.

    Raises
    ------
    InputError
        When there is no such set.
    """
    if number not in SETS:
        raise InputError(f"--set is {number}; allowed: 1 to {len(SETS)}")
    return SETS[number]
