"""Benchmarks: pytest-benchmark suites, and the tables of errors and defects that belong beside them."""
