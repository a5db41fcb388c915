"""Benchmarks: each script prints a table; see README.md."""
