"""What the exploration that networks learn from has in common with their driving."""

PERIOD_S = 0.04
"""Between two commands: 505 s / 12 625 ticks (section IV-A); the planners' rate."""
MAX_YAW_RATE = 1.57
"""Largest of the exploration (section IV-A); the planners keep to it [rad/s]."""
