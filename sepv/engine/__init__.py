"""Ensembles and long paths: the NumPy batch everywhere, and code compiled for a problem (extra `fast`).

`ensemble` and `long_path` are the calls; the rest writes scalar code for a scheme and a problem (`text`, `code`,
`polynomials`, `named`, `schemes`, `linear`, `kernel`), keeps it compiled (`store`, `compile`), and runs chunks of paths
(`chunk`, `task`, `workers`). `functions` and `lanes` are what generated code calls, and need numba.
"""
