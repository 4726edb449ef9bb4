"""What people read of runs: tables, curves, figures, and the page with its replays.

Values come from `hlsd.analysis`; nothing here decides what a number is.
"""
