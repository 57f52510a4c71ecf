"""sdeint's solver under the best driver we know, for `sepv compare`. Needs the extra ``sdeint`` or ``peers``.

sdeint knows single paths only. It is given the one process Σ c_j W_j, whose field is f, and plain NumPy functions.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import sdeint

from sepv.problem import Array, Problem
from sepv.studies._compare.method import from_states


def _run(problem: Problem, y0: Array, h: float, dW: Array, _keep: bool) -> Callable[[], Array]:
    times = np.arange(len(dW) + 1) * h
    sums = np.einsum("j,njl->nl", problem.c, dW)

    def drift(y: Array, _time: float) -> Array:
        return np.asarray(problem.structure(y) @ problem.gradient(y))

    def noise(y: Array, time: float) -> Array:
        return drift(y, time)[:, None]

    lanes = range(dW.shape[2])
    return lambda: np.stack(
        [sdeint.stratHeun(drift, noise, y0, times, dW=sums[:, lane, None]) for lane in lanes], axis=2
    )


_SOURCE = f"sdeint {sdeint.__version__} stratHeun, path by path"
heun = from_states("sdeint-heun", _run, _SOURCE, batched=False, evaluations=4)
