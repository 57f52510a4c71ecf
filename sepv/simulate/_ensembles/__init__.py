"""Ensembles and long paths, in NumPy or with code compiled for a problem and a scheme (extra
`fast`).

Users call `ensemble` and `long_path`. `task` describes a chunk of paths; `collectors` run tasks and
keep the results.
"""
