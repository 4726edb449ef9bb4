"""What is stored, and its formats: worlds, suites, BARN files, motion logs.

It imports `hlsd.core` only: nothing here drives, plans or learns.
"""
