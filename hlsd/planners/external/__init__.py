"""Planners that are programs: started, asked over a pipe, ended (docs/external.md).

`serving` is for authors of such programs and imports nothing of hlsd.
"""
