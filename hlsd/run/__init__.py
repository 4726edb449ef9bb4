"""Driving: protocol, session, episode, rows, the run's folder, and the bench.

It writes down what happened; `hlsd.analysis` says what follows from it.
"""
