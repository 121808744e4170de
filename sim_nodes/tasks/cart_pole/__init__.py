"""A pole on a cart (T ch. 8)."""

from sim_nodes.tasks.cart_pole.dynamics import FALLEN, FORCE_NOISE
from sim_nodes.tasks.cart_pole.task import CartPole

__all__ = ["FALLEN", "FORCE_NOISE", "CartPole"]
