"""Chunks of paths by code compiled for a problem and a scheme (extra `fast`).

`block_run` runs a chunk by two ordinary functions that are compiled once, the loop over steps (`driver`) and the
increments (`lanes`), and by a kernel: functions of `kernels` in a generated module (`layout`, `store`), with the
straight-line code of a problem and a scheme (`writer`, `code_builder`, `recorded`, `llvm`) in place of their names.
Lanes that a kernel leaves over are solved by `sepv.solve`. `compile` says what is taken. What numba compiles is
imported when it is used.
"""
