"""Environments for reinforcement learning: Gymnasium's interface to a session.

What a learner sees, does and is paid lives here, and the planner that drives its policy
in a bench. Only the modules that need Gymnasium import it; nothing here decides a row.
"""
