"""From rows to numbers: metrics, statistics, comparisons, agreement.

It reads what a run has left, and drives nothing.
"""
