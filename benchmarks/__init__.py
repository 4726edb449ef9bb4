"""How fast hlsd is: `python -m benchmarks`."""
