"""Messages about a failed step: its state y0, step size h and increments ΔW,
and the scheme's error.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sepv.core.newton import Status
from sepv.errors import SepvError
from sepv.problem import Array, Problem
from sepv.schemes import Scheme, ask


def first_failed(
    scheme: Scheme, problem: Problem, y: Array, h: float, dW: Array, status: NDArray[np.int64]
) -> str:
    """Describe the first failed step of a batch, with y (d, M), dW (m, M), status (M,).
    Return "" if none failed.
    """
    k = int(np.argmax(status != Status.CONVERGED))
    return "" if status[k] == Status.CONVERGED else failed_step(scheme, problem, y[:, k], h, dW[:, k])


def failed_step(scheme: Scheme, problem: Problem, y: Array, h: float, dW: Array) -> str:
    """Describe a failed step from y (d,) with dW (m,).
    The scheme is called again to obtain its error message.
    """
    place = f"from y0 = {row(y)} with h = {float(h)!r}, ΔW = {row(dW[: problem.noises])}"
    return f"{place}: {_error_message(scheme, problem, y, h, dW)}"


def _error_message(scheme: Scheme, problem: Problem, y: Array, h: float, dW: Array) -> str:
    try:
        answer = ask(scheme, problem, np.array(y), h, np.array(dW))
    except SepvError as error:
        return str(error)
    if problem.domain is not None and not np.all(problem.domain(answer)):
        return f"y1 = {row(answer)} came, which is out of the problem's domain"
    return f"y1 = {row(answer)} came when it was asked for alone, and no state beside others"


def row(values: ArrayLike | None) -> str:
    """Format numbers as (0.5, -1.25e-07), with twelve digits,
    so that differences near 1e-12 are visible.
    """
    return "(" + ", ".join(f"{float(v):.12g}" for v in np.atleast_1d(np.asarray(values))) + ")"
