"""Mutation testing of the core: ``python -m benchmarks.mutation`` (extra ``mutation``); see docs/mutation.md."""
