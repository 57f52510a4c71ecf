"""What makes the reference vectors: `selection` says which cases and why, `generate` computes, proves and writes them.

python -m benchmarks.vectors [--check [--all]] [SCHEME …]
"""
