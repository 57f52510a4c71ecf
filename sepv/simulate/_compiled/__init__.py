"""Chunks of paths by code compiled for a problem and a scheme (extra `fast`).

`block_run` runs a chunk by two ordinary functions that are compiled once, the loop over steps (`driver`) and the
increments (`lanes`), and by a kernel: functions of `kernels` in a generated module (`layout`, `store`), with the
straight-line code of a problem and a scheme (`writer`, `code_builder`, `recorded`, `llvm`) in place of their names.
Lanes that a kernel does not finish are solved by `sepv.solve`. `compile` decides which schemes and problems are
compiled. Modules that need numba are imported when they are used.
"""
