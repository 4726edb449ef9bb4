"""The method of the paper: collect, hallucinate, train; and the policies.

Only `hlsd.learning.training` imports torch, and only when it trains.
"""
