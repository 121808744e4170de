"""Simulated vehicles: pure tasks, scripted pilots, and the node that runs them."""
