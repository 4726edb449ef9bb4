"""Driving: protocol, session, episode, rows, the run's folder, and the bench.

It writes down what happened; what follows from it is `hlsd.analysis`'s.
"""
