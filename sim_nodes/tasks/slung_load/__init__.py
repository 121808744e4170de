"""A quadrotor that drops its slung load into a basket (T IV-B)."""

from sim_nodes.tasks.slung_load.dynamics import (
    CABLE,
    DUNK,
    MISS,
    RELEASE,
    WALL,
    Outcome,
    outcome,
)
from sim_nodes.tasks.slung_load.task import SlungLoad

__all__ = ["CABLE", "DUNK", "MISS", "RELEASE", "WALL", "Outcome", "SlungLoad", "outcome"]
