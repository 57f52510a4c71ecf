"""Reference values in arbitrary precision, computed by mpmath from the problem description without any scheme's code.

Four subpackages do import schemes and problems: `faults` (schemes broken on purpose, by which laws are measured),
`hard` (the catalogue of hard cases), `paper` (the paper's experiments measured again) and `peers` (solvers of other
libraries). No module outside these four imports a scheme, a problem or one of the four.
"""
