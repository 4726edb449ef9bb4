"""Planners that drive from a trained policy: HLSD and LfH, and what they share."""
