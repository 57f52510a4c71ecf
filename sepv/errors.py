"""Every error that sepv raises on purpose: each states what was expected, what came,
and the remedy.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np


def said(value: Any, most: int | None = None) -> str:
    """The text of an exception, or, with `most`, the start of any value's repr; both may raise,
    as code of others.
    """
    try:
        return str(value) if most is None else f"{value!r:.{most}}"
    except Exception as error:
        return f"(its text cannot be made: {type(error).__name__})"


class SepvError(Exception):
    """Base of all errors of this package."""


class UsageError(SepvError, ValueError):
    """An argument, a name or a file is not what the call needs (exit code 2 on the command
    line).
    """

    def __init__(self, *, expected: str, received: str, remedy: str) -> None:
        self.expected, self.received, self.remedy = map(_shortened, (expected, received, remedy))
        super().__init__(f"Expected {self.expected}.\nReceived {self.received}.\nRemedy: {self.remedy}")


# The most characters of each part of a message: a name from a file may have millions.
PART_MAX_CHARACTERS = 4000


def _shortened(text: str) -> str:
    """The text, or its beginning and end with the number of characters between them."""
    left = len(text) - PART_MAX_CHARACTERS
    return (
        text
        if left <= 0
        else f"{text[: PART_MAX_CHARACTERS // 2]} … ({left} more characters) … {text[-PART_MAX_CHARACTERS // 2 :]}"
    )


# With more names than this, a message lists them at its end.
MANY_NAMES = 8


def require_one_of(
    what: str, given: Any, known: Collection[Any], remedy: str = "correct the name", received: str = ""
) -> None:
    """Raise a UsageError if `given` is not among the values `known`; the message calls it
    `what`.
    """
    if given not in known:
        raise unknown_name(what, received or repr(given), known, remedy)


def unknown_name(what: str, received: str, known: Collection[Any], remedy: str) -> UsageError:
    """The error for a value that is not among the values `known`;
    its message calls the value `what`.

    A long list of names comes last, so that what was received and the closest name are read first.
    """
    names = ", ".join(map(str, known))
    if len(known) > MANY_NAMES:
        return UsageError(expected=what, received=received, remedy=f"{remedy}. There are {names}")
    return UsageError(expected=f"{what}, one of {names}", received=received, remedy=remedy)


class ProblemError(UsageError):
    """A problem whose parts contradict each other, such as a gradient that is not ∇H."""


class SystemsError(UsageError):
    """The scheme is for another class of systems than the problem's,
    such as systems with several Hamiltonians.
    """


class TargetError(UsageError):
    """A scheme that cannot be loaded (exit code 3 on the command line)."""


class UnknownTarget(TargetError):
    """A name that names nothing: no built-in scheme, no module, or no attribute of a module."""


class SchemeFault(UsageError):
    """A scheme broke the contract of ``step``: a wrong shape or type, a NaN, or a changed
    argument.
    """


class NotFinite(SchemeFault):
    """A scheme returned NaN or infinity."""


class Skipped(SepvError):
    """The error of a scheme that does not support the problem. It is no fault,
    and gives no law a verdict.
    """

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(f"skipped: {reason}")


class Unasked(Skipped):
    """A law says nothing about a case. The scheme does not refuse the case,
    so that nothing is lacking.
    """


class ClusterFailure(SepvError, RuntimeError):
    """A cluster of workers is lost, or cannot do this work."""

    def __init__(self, what: str, remedy: str) -> None:
        self.what, self.remedy = what, remedy
        super().__init__(f"{what}\nRemedy: {remedy}.")


class ChunkFailure(SepvError, RuntimeError):
    """An ensemble is incomplete: a path raised an error in a worker and again in this process,
    or a cluster is lost.

    Attributes
    ----------
    paths : (P,) array, or a range
        The numbers of the paths that are finished.
    ensemble : Ensemble
        The end states of the finished paths; if `reduce=` was given, their summaries.
    """

    def __init__(self, cause: Exception, finished: tuple[Any, Any]) -> None:
        self.paths, self.ensemble = finished
        what = f"A chunk of paths raised {type(cause).__name__}: {cause}"
        remedy = "correct the cause above; the same seed gives the same paths again"
        if isinstance(cause, ClusterFailure):
            what, remedy = cause.what, cause.remedy
        super().__init__(
            f"{what}\n"
            f"{len(self.paths)} paths are finished and kept in this error's `ensemble`, their numbers in `paths`.\n"
            f"Remedy: {remedy}."
        )


class Interrupted(KeyboardInterrupt):
    """Ctrl-C interrupted `sepv.ensemble`; this error holds the P paths that are finished.

    Attributes
    ----------
    paths : (P,) array, or a range
        The numbers of the paths that are finished.
    ensemble : Ensemble
        The end states of the finished paths; if `reduce=` was given, their summaries.
    """

    def __init__(self, finished: tuple[Any, Any]) -> None:
        self.paths, self.ensemble = finished
        super().__init__(
            f"interrupted: {len(self.paths)} paths are finished and kept in `ensemble`, their numbers in `paths`"
        )


# The remedy for each status of a solve, by the first words of the status.
_REMEDIES = {
    "no convergence": "a smaller h, or a truncation of the increments (Remark 2.1); for large |Δ| the equation may "
    "have no solution near y at all, and `sepv solvability` shows how far the solutions from y reach",
    "left": "a smaller h: y is next to the boundary of the domain, and this step leads across it",
    "overflow": "a smaller h, or other units for y: B or ∇H is beyond the largest binary64 number on the way",
    "singular": "another h: at this Δ two solutions meet or none is isolated; two steps of half the size avoid it",
    "a structure is undefined": "a smaller h next to a critical point of H_0; on one the drift vanishes and S_j with "
    "S_j∇H_0 = B∇H_j does not exist: solve dy = Σ c_j B∇H_j ∘dW_j there, whose energy is another",
    "the adaptive quadrature": "give the problem mean_gradient in closed form, or the degree of a polynomial H",
}


class TruncationWarning(UserWarning):
    """Increments are truncated at so small a bound that the scheme loses its order."""


class SlowDerivation(UserWarning):
    """The derivatives of a problem's functions, which sepv derives by symbols,
    take millions of operations.
    """


class ProtocolWarning(UserWarning):
    """A program did not end as docs/protocol.md demands, after all its answers were right."""


class StepFailure(SepvError, ArithmeticError):
    """The implicit equation of a step was not solved. An unconverged result is never returned
    unmarked.

    A user's scheme raises this error with a text,
    ``StepFailure("no convergence after 50 iterations")``. The schemes of sepv pass the attributes
    below by name, and the message is made from them.

    Attributes
    ----------
    problem : str
        The problem's name.
    y : ndarray, shape (d,), or (d, M) of a batch
        The state the step started from.
    delta : float
        The random step Δ = h + Σ c_j ΔW_j.
    residual : float
        Largest component of the residual of the implicit equation at the state where the iteration
        stopped.
    status : str
        The kind of failure (see `sepv.core.newton.Status`).
    """

    def __init__(
        self, status: str = "the step was not made", *, problem: str = "", y: np.ndarray | None = None,
        delta: float = math.nan, residual: float = math.nan, iterations: int = 0,
    ) -> None:  # fmt: skip
        self.problem, self.y, self.delta = problem, y, delta
        self.residual, self.status, self.iterations = residual, status, iterations
        if y is None:
            super().__init__(status)
            return
        remedy = next((r for s, r in _REMEDIES.items() if status.startswith(s)), _REMEDIES["no convergence"])
        values = y.tolist() if hasattr(y, "tolist") else list(y)
        batch = bool(values) and isinstance(values[0], list)
        of_one = f"y = {values}, Δ = {delta!r}"
        where = f"a batch of {len(values[0])} states" if batch else f"{of_one}, residual {residual:.3e}"
        super().__init__(
            f"The implicit equation of the step was not solved: {status} after {iterations} iterations.\n"
            f"problem {problem}, {where}.\n"
            f"Remedy: {remedy}."
        )
