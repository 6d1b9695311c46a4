"""Ratios of rates, each measured in one run: `python -m benchmarks`."""
