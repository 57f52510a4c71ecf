"""The program for the reference vectors: `selection` chooses the cases, `generate` computes,
proves and writes them.

python -m benchmarks.vectors [--check [--all]] [SCHEME …]
"""
