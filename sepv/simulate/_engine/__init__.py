"""Ensembles and long paths: the NumPy batch everywhere, and code compiled for a problem (extra `fast`).

`ensemble` and `long_path` are the calls. `chunk` runs a chunk of paths by two ordinary functions that are compiled
once, the loop over steps (`driver`) and the increments (`lanes`), and by a kernel: functions of `kernels` in a
generated module (`module`, `store`), with the straight-line code of a problem and a scheme (`writer`, `code_builder`,
`recorded`, `pieces`) in place of their names. Lanes that a kernel leaves over are solved by `sepv.solve`. `compile`
says what is taken; `task`, `workers` and `total` spread chunks. What numba compiles is imported when it is used.
"""
