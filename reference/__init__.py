"""Reference values in arbitrary precision, computed by mpmath from the problem description without
any scheme's code.

No module imports a scheme or a built-in problem. `vectors` are test vectors for any program, and
`witnesses` are known counterexamples, as data.
"""
