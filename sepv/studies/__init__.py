"""Schemes side by side: cost and accuracy, regressions, the paper's experiments, hard cases, roundings, solvability.

Each study is by itself, and has a command of its name: `_compare` (error with its price), `_bench` (counters and paired
times), `_reproduce` (section 4 of the paper), `_hard_cases`, `_ulps`, `_solvability`. `_evaluation_count` counts what a
scheme evaluates, `_palette` is the look of every picture.
"""
