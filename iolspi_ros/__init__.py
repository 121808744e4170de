"""Informed online least-squares policy iteration on a ROS 2 graph."""

__version__ = "0.2.0"
