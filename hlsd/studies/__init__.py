"""Experiments of several steps: the paper's reproduction, ablations, sweeps.

They use every other room but `hlsd.cli`, and no other room imports them.
"""
