"""Runs without a graph: training, evaluation, and what both leave for plots."""
