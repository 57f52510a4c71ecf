"""What a problem need not give: ∇H, H″, B′ and the averaged gradient, derived from records of H and B."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sepv.errors import ProblemError
from sepv.record import CannotRecord, NoClosedForm, Tape, evaluator, gradient, jacobian
from sepv.record.arrays import Evaluator
from sepv.record.derivative import hessian
from sepv.record.means import degree, mean

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MeanGradient:
    """(y0, y1) -> ∫₀¹∇H(y0 + τ(y1 − y0))dτ."""

    of_segment: Evaluator

    def __call__(self, y0: Array, y1: Array) -> Array:
        """Of shape (d, ...)."""
        return self.of_segment(y0, y1 - y0)


@dataclass(frozen=True)
class Derived:
    """Functions of arrays with the shapes of `sepv.Problem`, and the degree of a polynomial H.

    `mean_gradient` is None where H is a polynomial, whose degree is enough, and where there is no closed form.
    """

    gradient: Evaluator
    hessian: Evaluator
    structure_derivative: Evaluator
    mean_gradient: MeanGradient | None
    degree: int | None


def derive(dimension: int, structure: Callable[[Any], Any], hamiltonian: Callable[[Any], Any]) -> Derived:
    """What follows from B and H.

    Raises
    ------
    ProblemError
        Where one of them cannot be recorded; it says why.
    """
    tape = Tape()
    y, z = tape.vector(dimension), tape.vector(dimension)
    H = _recorded(tape, "hamiltonian", hamiltonian, y)
    B = _recorded(tape, "structure", structure, y)
    if np.shape(H) != () or np.shape(B) != (dimension, dimension):
        raise ProblemError(
            expected=f"hamiltonian(y) of shape () and structure(y) of shape {(dimension, dimension)} for y of shape "
            f"({dimension},)",
            received=f"shapes {np.shape(H)} and {np.shape(B)}",
            remedy="component first: index y[0], y[1], … and build arrays with np.stack or np.array",
        )
    power = degree(H, y)
    slope = gradient(H, y)
    try:
        closed = None if power is not None else MeanGradient(evaluator([y, z], mean(H, y, z).value))
    except NoClosedForm:
        closed = None
    return Derived(
        gradient=evaluator([y], slope),
        hessian=evaluator([y], hessian(slope, y)),
        structure_derivative=evaluator([y], jacobian(B.ravel(), y).reshape(*B.shape, dimension)),
        mean_gradient=closed,
        degree=None if power is None else max(power, 1),
    )


def _recorded(tape: Tape, key: str, function: Callable[[Any], Any], y: Any) -> Any:
    """The function's result; whatever it makes of symbols is its author's."""
    try:
        return tape.symbols(function(y))
    except Exception as error:
        why = str(error) if isinstance(error, CannotRecord) else f"{type(error).__name__}: {error}"
        raise ProblemError(
            expected=f"gradient=, or {key} of operations from which it can be derived",
            received=f"{key}: {why}",
            remedy="give gradient=, and hessian= and structure_derivative= where you have them",
        ) from error
