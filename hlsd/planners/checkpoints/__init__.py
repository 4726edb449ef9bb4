"""Planners that drive from checkpoints of others: what stands around each network.

A planner here takes a converted checkpoint as its option ``checkpoint``; none comes
with the package. docs/checkpoints.md says how to get and convert one.
"""
