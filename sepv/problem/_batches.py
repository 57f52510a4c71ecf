"""Functions of one state become functions of a batch (d, M); a constant matrix becomes a
structure.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sepv.core.arrays import Array
from sepv.core.problem import Function
from sepv.errors import ProblemError
from sepv.record import Tape, evaluator

# The largest relative difference between a function of a batch and the same function of each state.
# Sums in another order differ by a few roundings; a function that mixes the states of a batch is
# wrong by its whole size.
BATCH_TOLERANCE = 1e-9
# Three states: a batch of two would let a function pass that fits d = 2 by chance.
CHECKED_BATCH = 3


@dataclass(frozen=True, eq=False)
class ConstantStructure:
    """The function y -> B of a structure matrix `matrix` (d, d) that does not depend on the
    state.
    """

    matrix: Array

    def __call__(self, y: Any) -> Array:
        """B as (d, d, ...) for y of shape (d, ...)."""
        trailing = np.shape(y)[1:]
        B = self.matrix.reshape(self.matrix.shape + (1,) * len(trailing))
        return np.broadcast_to(B, self.matrix.shape + trailing).copy()


def taking_batches(key: str, function: Function, y: Array, shape: tuple[int, ...]) -> Function:
    """`function` itself if it takes batches (d, M), else the same operations,
    recorded at one state, as a function.

    `np.sum(y**2)`, `y @ A @ y` or a constant matrix are right for a state (d,) and wrong for a
    batch. The operations of a call with symbols are right for both. A function that cannot be
    recorded is returned as it is.

    Parameters
    ----------
    key : str
        The name of the function in messages.
    y : (d,)
        A state at which the function is compared with itself.
    shape : tuple of int
        The shape of the value for one state, () for H.

    Raises
    ------
    ProblemError
        If the function has other values for a batch than for its states, and cannot be recorded.
    """
    states = np.stack([y * (1 + n / 8) + n / 32 for n in range(CHECKED_BATCH)], axis=1)
    with np.errstate(all="ignore"):
        try:
            single = np.stack(
                [np.asarray(function(states[:, n].copy())) for n in range(CHECKED_BATCH)], axis=-1
            )
        except (Exception, SystemExit):
            return function  # `check_problem` says what is wrong for one state
        if single.shape != (*shape, CHECKED_BATCH) or single.dtype.kind not in "fiub":
            return function
        try:
            together = np.asarray(function(states.copy()))
        except (Exception, SystemExit):
            together = np.empty(0)
    fits = together.shape == single.shape
    size = np.abs(single[np.isfinite(single)]).max(initial=0.0)
    if fits and (same := np.isclose(together, single, BATCH_TOLERANCE, BATCH_TOLERANCE * size, True)).all():
        return function
    tape = Tape()
    symbols = tape.vector(len(y))
    try:
        recorded = evaluator([symbols], tape.symbols(function(symbols)))
    except Exception as error:
        if not fits:
            return function
        place = tuple(int(i) for i in np.argwhere(~same)[0])
        raise ProblemError(
            expected=f"{key} of a batch (d, M) to have for each state the value that it has for this state alone",
            received=f"{float(together[place])!r} in a batch and {float(single[place])!r} alone, for the state "
            f"{states[:, place[-1]].tolist()}",
            remedy="component first: let sums and products run over axis 0 alone, as in np.sum(y**2, axis=0)",
        ) from error
    return recorded if recorded.shape == shape else function
