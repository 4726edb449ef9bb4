"""Timed Elastic Band: the band, what it costs, its optimiser, and the planner."""
