"""Ensembles and long paths: the NumPy batch everywhere, and code compiled for a problem (extra `fast`).

`ensemble` and `long_path` are the calls. A chunk of paths is a `task`; `collectors` run it and keep its result.
"""
