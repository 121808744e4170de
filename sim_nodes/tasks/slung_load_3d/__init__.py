"""A quadrotor that drops its slung load into a basket, in three dimensions (T 6-2)."""

from sim_nodes.tasks.slung_load_3d.scene import CABLE, DUNK, MISS, WALL
from sim_nodes.tasks.slung_load_3d.task import SlungLoad3D

__all__ = ["CABLE", "DUNK", "MISS", "WALL", "SlungLoad3D"]
