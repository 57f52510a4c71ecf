"""The program for the reference vectors: `generate` computes, proves and writes their answers.

python -m benchmarks.vectors [--check [--all]] [SCHEME …]
"""
