"""References in arbitrary precision; they import mpmath and the problem description, and no scheme code.

Four bodies of material beside them import schemes and problems, and nothing here imports them: `faults`, the schemes
broken on purpose by which laws are measured; `hard`, the catalogue of hard cases; `paper`, the paper's experiments
measured again; and `peers`, solvers of other libraries.
"""
