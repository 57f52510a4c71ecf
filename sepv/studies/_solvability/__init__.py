"""The solutions of a step's implicit equation that a branch in Δ connects to y0,
and those that Newton finds.
"""
