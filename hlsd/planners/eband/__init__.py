"""Elastic bands: a path as a chain of bubbles of free space, pushed and pulled."""
