"""Chunks of paths computed by code that is compiled for a problem and a scheme (extra `fast`).

`block_run` runs a chunk in blocks of paths, the lanes of SIMD code. Two ordinary modules are
compiled once: the loop over steps (`driver`) and the drawing of increments (`lanes`). A kernel is a
generated module (`layout`, `store`), where the functions of `kernels` run straight-line code of a
problem and a scheme (`writer`, `code_builder`, `recorded`, `llvm`). `sepv.core` solves the steps of
lanes that a kernel does not solve. `compile` decides which schemes and problems are compiled.
Modules that need numba are imported when they are used.
"""
