"""Experiments of several steps: the reproduction of the paper, ablations.

They use every other room but `hlsd.cli`, and no other room imports them.
"""
