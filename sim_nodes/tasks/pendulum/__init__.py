"""The rotational pendulum (T IV-A)."""

from sim_nodes.tasks.pendulum.dynamics import RATE_LIMIT
from sim_nodes.tasks.pendulum.task import UPRIGHT_ANGLE, UPRIGHT_TIME, Pendulum

__all__ = ["RATE_LIMIT", "UPRIGHT_ANGLE", "UPRIGHT_TIME", "Pendulum"]
