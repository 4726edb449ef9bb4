"""The method of the paper: collect, hallucinate, train; and what comes of it.

Only `hlsd.learning.training` imports torch, and only when it trains.
"""
