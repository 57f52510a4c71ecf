"""Parts of a problem that are derived from the recorded operations of H and B: ∇H, H″, B′,
the mean of ∇H, flows.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from sepv.core.arrays import Array
from sepv.core.problem import Function
from sepv.errors import ProblemError
from sepv.record import (
    CannotRecord,
    Evaluator,
    NoClosedForm,
    Tape,
    degree,
    evaluator,
    flow,
    gradient,
    hessian,
    jacobian,
    mean,
)


def to_be_derived(y: Array) -> Array:
    """The default of `Problem.gradient`: it marks that the gradient is to be derived,
    and is never called.
    """
    raise NotImplementedError("a mark for what was not given")


@dataclass(frozen=True)
class MeanGradient:
    """The function (y0, y1) -> ∫₀¹∇H(y0 + τ(y1 − y0))dτ in a closed form,
    derived from the recorded operations of H.
    """

    of_segment: Evaluator

    def __call__(self, y0: Array, y1: Array) -> Array:
        return self.of_segment(y0, y1 - y0)


@dataclass(frozen=True)
class Derivatives:
    """The derivatives of H, as functions like those of `sepv.Problem`,
    and the degree of H if H is a polynomial.

    `mean_gradient` is None if H is a polynomial, because `degree` is then enough, or if the average
    has no closed form.
    """

    gradient: Evaluator
    hessian: Evaluator
    mean_gradient: MeanGradient | None
    degree: int | None


@dataclass(frozen=True)
class Derived(Derivatives):
    """The derivatives of H and of B: `structure_derivative` is B′, of shape (d, d, d, ...)."""

    structure_derivative: Evaluator


def derive(dimension: int, structure: Function, hamiltonian: Function) -> Derived:
    """Derive all parts of a problem from B and H. Raises ProblemError, with the reason,
    if one cannot be recorded.
    """
    tape = Tape()
    y = tape.vector(dimension)
    B = recorded_as(tape, "structure", structure, y, (dimension, dimension))
    return Derived(
        **vars(derivatives(dimension, hamiltonian)),
        structure_derivative=evaluator([y], jacobian(B.ravel(), y).reshape(*B.shape, dimension)),
    )


def derivatives(dimension: int, hamiltonian: Function, name: str = "hamiltonian") -> Derivatives:
    """Derive ∇H, H″ and the average of ∇H along a segment from H.
    Raises ProblemError if H cannot be recorded.
    """
    tape = Tape()
    y, z = tape.vector(dimension), tape.vector(dimension)
    H = recorded_as(tape, name, hamiltonian, y, ())
    power, slope = degree(H, y), gradient(H, y)
    try:
        closed = None if power is not None else MeanGradient(evaluator([y, z], mean(H, y, z).value))
    except NoClosedForm:
        closed = None
    return Derivatives(
        gradient=evaluator([y], slope),
        hessian=evaluator([y], hessian(slope, y)),
        mean_gradient=closed,
        degree=None if power is None else max(power, 1),
    )


@dataclass(frozen=True)
class PartFlow:
    """The exact flow of B∇H_k for a part H_k of H: a function (y, t) -> (d, ...)
    of states y and times t (...).

    A call raises NoClosedForm if the flow has no closed form (`sepv.record._flows`), and
    ProblemError if B∇H_k cannot be recorded.
    """

    dimension: int
    structure: Function
    part: Function

    def __call__(self, y: Array, t: Array) -> Array:
        return self._evaluator(y, np.asarray(t)[None])

    @cached_property
    def _evaluator(self) -> Evaluator:
        tape = Tape()
        y, t = tape.vector(self.dimension), tape.vector(1)
        H = recorded_as(tape, "a part", self.part, y, ())
        B = recorded_as(tape, "structure", self.structure, y, (self.dimension, self.dimension))
        return evaluator([y, t], flow(B @ gradient(H, y), y, t[0]))


def recorded_as(tape: Tape, key: str, function: Function, y: Any, shape: tuple[int, ...]) -> Any:
    """The result, in symbols, of calling `function` with the symbols y;
    messages call the function `key`.

    Raises ProblemError, with the reason, if the function cannot be recorded or its result does not
    have this shape.
    """
    try:
        symbols = tape.symbols(function(y))
    except Exception as error:
        why = str(error) if isinstance(error, CannotRecord) else f"{type(error).__name__}: {error}"
        raise ProblemError(
            expected=f"gradient=, or {key} of operations from which it can be derived",
            received=f"{key}: {why}",
            remedy=f"write {key} with NumPy alone (np.array or np.stack for a matrix, np.where for a branch), or give "
            "gradient=, and hessian= and structure_derivative= where you have them",
        ) from error
    if np.shape(symbols) != shape:
        raise ProblemError(
            expected=f"{key}(y) of shape {shape} for y of shape ({len(y)},)",
            received=f"shape {np.shape(symbols)}",
            remedy="component first: index y[0], y[1], … and build arrays with np.stack or np.array",
        )
    return symbols
