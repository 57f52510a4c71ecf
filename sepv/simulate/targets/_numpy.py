"""The target that every installation has: batches of paths in NumPy (`sepv.simulate._batch`)."""

from __future__ import annotations

from sepv.simulate._batch import CHUNK
from sepv.simulate._ensembles.task import NumpyChunk
from sepv.simulate.targets._target import Target

NUMPY = Target(
    "numpy", prepare=lambda *_: None, chunk=NumpyChunk, size=lambda *_: CHUNK, piece=2**21, threads=False,
    recorded=False, packages=("numpy",),
)  # fmt: skip
