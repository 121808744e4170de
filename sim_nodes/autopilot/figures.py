"""What was measured on the real autopilots, and how close their imitation has to come.

`firmware.py` and the commanders take from here what is a number of theirs; the rest comes out of
how they fly, and `test/test_autopilot_figures.py` flies it. `scripts/measure_autopilot.py` measures
any autopilot's simulator and says how far it is from this table.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Figure:
    """One figure of a real autopilot.

    Attributes
    ----------
    value : float
        Median of what was measured.
    unit : str
    tolerance : float
        Share of it by which another may differ.
    allowance : float
        By how much it may differ in any case, in its unit.
    """

    value: float
    unit: str
    tolerance: float = 0.15
    allowance: float = 0.0

    @property
    def margin(self) -> float:
        """By how much another may differ, in its unit."""
        return max(self.tolerance * abs(self.value), self.allowance)

    def holds(self, value: float) -> bool:
        """Whether a value is the same within the tolerance."""
        return abs(value - self.value) <= self.margin


FIGURES: dict[str, dict[str, Figure]] = {"ardupilot": {}, "px4": {}}
"""By autopilot and row; `iolspi_ros/bench/measuring.py` says how each row is flown."""
