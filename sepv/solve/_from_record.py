"""Newton's iteration as straight-line code: z − R(z) and (1 − K)⁻¹(z − R), K = ∂R/∂z, for a formula of R.

The formula is called with symbols that record its operations (`sepv.record`), and the code is made from this record. An
iteration is then one function, of arrays or of the numbers of a single state; both give the same bits. Recording takes
as long as a few steps. So only problems given by name are recorded, and not problems drawn at random.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from sepv.problem import Array, NamedProblem, Problem, cramer
from sepv.record import CannotRecord, NoClosedForm, Source, source
from sepv.solve._formula import Formula
from sepv.solve._recorded import Recorded
from sepv.solve._solution import Flags, Lanes

# The largest d for which Cramer's rule is written out.
LARGEST = 3
# The most records in the cache, and the cache. A key has the problem's data, the formula, and its number of inputs.
MOST_RECORDS = 128
_RECORDS: dict[Any, Record | None] = {}
# Prefixes of modules that define or derive the functions of problems given by name.
_MODULES = ("sepv.problems.", "sepv.record.", "sepv.problem._derived")


class Record(NamedTuple):
    """The code of a Newton iteration as a function of (y, z, step), and the evaluations of ∇H and of B in R.

    The function returns z − R(z), Newton's correction, and a test, True where z minus the correction is in the domain.
    """

    source: Source
    gradients: int
    structures: int


class Corrections(NamedTuple):
    """Newton's corrections by straight-line code, for steps from y0 (d, M) with the data `step` (k, M), such as Δ."""

    record: Record
    y0: Array
    step: Array

    def of_lanes(self, z: Array, lanes: Lanes) -> tuple[Array, Array, Flags]:
        """The residual z − R(z) (d, n), Newton's correction (d, n), and a test (n,), for n of the M paths.

        The test is True for each path for which z minus the correction is in the domain.
        """
        y, step = self.y0, self.step
        if lanes.size < y.shape[1]:
            y, step = y.take(lanes, axis=1), step.take(lanes, axis=1)
        source = self.record.source
        F, corrections = np.empty_like(z), np.empty_like(z)
        *values, stays = source.function(y, z, step, source.parameters)
        for into, value in zip((*F, *corrections), values, strict=True):
            into[...] = value
        return F, corrections, np.full(lanes.shape, stays, dtype=bool)

    def of_one(self, lane: Lanes) -> Callable[[list[float]], tuple[list[float], list[float], bool]]:
        """A function of z (d,) for one path that returns residual, correction and test, with the bits of `of_lanes`."""
        y, step = self.y0[:, lane].ravel().tolist(), self.step[:, lane].ravel().tolist()
        evaluate, parameters, d = self.record.source.function, self.record.source.parameters, len(y)

        def corrected(z: list[float]) -> tuple[list[float], list[float], bool]:
            try:
                out = evaluate(y, z, step, parameters)
            except ZeroDivisionError:  # Python numbers raise, where arrays become infinite
                F, corrections, stays = self.of_lanes(np.array(z)[:, None], lane)
                return F.ravel().tolist(), corrections.ravel().tolist(), bool(stays[0])
            return list(out[:d]), list(out[d : 2 * d]), bool(out[2 * d])

        return corrected


def corrections(problem: Problem, formula: Formula, y0: Array, step: Array) -> Corrections | None:
    """Newton's `Corrections` for steps from y0 (d, M) with the numbers `step` (k, M); None if `record` returns None."""
    recorded = record(problem, formula, len(step))
    return None if recorded is None else Corrections(recorded, y0, step)


def record(problem: Problem, formula: Formula, count: int) -> Record | None:
    """The recorded Newton iteration of a formula for a problem given by name, from a cache.

    The result is None for other problems, for d > LARGEST, and if the formula cannot be recorded. `count` is how many
    numbers of a step the formula uses. The keys of the cache hold the data of problems, so that problems can be freed.
    """
    if not _is_fixed(problem) or problem.dimension > LARGEST:
        return None
    names = tuple(getattr(f, "__qualname__", "") for f in _functions(problem))
    key = problem.data, names, formula, count
    if key not in _RECORDS:
        if len(_RECORDS) >= MOST_RECORDS:
            _RECORDS.clear()
        _RECORDS[key] = _recorded(problem, formula, count)
    return _RECORDS[key]


def _recorded(problem: Problem, formula: Formula, count: int) -> Record | None:
    """Record a formula's equation, and write out Cramer's rule for Newton's correction."""
    try:
        recorded = Recorded(problem)
        equation = recorded.equation_of(formula, count)
        tape = recorded.tape
        F, A = recorded.system(formula, count)
        numerators, determinant = cramer(A, F)
        correction = [v / tape.symbol(determinant) for v in map(tape.symbol, numerators)]
        moved = recorded.y + (recorded.z - tape.symbols(correction))
        stays = tape.constant(1.0) if problem.domain is None else problem.domain(moved)
    except (CannotRecord, NoClosedForm):
        return None
    code = source([recorded.y, recorded.z, equation.step], [*F, *correction, stays])
    return Record(code, equation.gradients, equation.structures)


def _is_fixed(problem: Problem) -> bool:
    """True for a problem given by name with all its own functions: none is replaced, wrapped or left out by a user."""
    return (
        type(problem) is Problem
        and isinstance(problem.data, NamedProblem)
        and all(str(getattr(f, "__module__", "")).startswith(_MODULES) for f in _functions(problem))
    )


def _functions(problem: Problem) -> list[Any]:
    """All functions that a problem consists of; `mean_gradient` and `domain` are left out if they are None."""
    p, nambu = problem, problem.nambu
    functions: list[Any] = [p.structure, p.hamiltonian, p.gradient, p.hessian, p.structure_derivative]
    functions += [f for f in (p.mean_gradient, p.domain) if f is not None]
    return functions + ([] if nambu is None else [nambu.factor, nambu.casimir])
