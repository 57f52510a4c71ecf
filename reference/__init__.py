"""References in arbitrary precision; they import mpmath and the problem description, and no scheme code.

Three bodies of material beside them do import schemes, and nothing here imports them: `faults`, the schemes broken on
purpose by which laws are measured; `paper`, the paper's experiments measured again; and `peers`, solvers of other
libraries.
"""
