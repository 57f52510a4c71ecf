"""The kernels of the compiled engine: loops over steps, lanes and iterations, as ordinary functions.

A generated module (`sepv.simulate._engine.module`) compiles them with names of its own in place of those of
`names`: the sizes of a problem and the pieces of straight-line code (`sepv.simulate._engine.pieces`) that
are printed from its records. All state of a block lies in one scratch buffer S at fixed offsets, its
integers in I. What a lane does never depends on the others.
"""
