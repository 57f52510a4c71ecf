"""z − R(z) and Newton's correction (1 − K)⁻¹(z − R) of a step as straight-line code, from the record of its formula.

It serves problems given by name, whose formulas are fixed: recording takes as long as a few steps, too long for a
random system. An iteration is then one function of arrays, or of numbers for a single state, with the same bits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sepv.problem import Array, NamedProblem, Problem, cramer
from sepv.record import CannotRecord, NoClosedForm, Source, source
from sepv.solve._formula import Formula
from sepv.solve._recorded import Recorded
from sepv.solve._solution import Flags, Lanes

# The largest d for which Cramer's rule is written out.
LARGEST = 3
# The number of records kept.
MOST_KEPT = 128
_KEPT: dict[Any, Record | None] = {}
# The places of functions of named problems: written there, or derived.
_OWN = ("sepv.problems.", "sepv.record.", "sepv.problem._derived")


@dataclass(frozen=True)
class Record:
    """The `Corrections` as a function of (y, z, step), and evaluations of ∇H and of B in R."""

    source: Source
    gradients: int
    structures: int


class FromRecord(NamedTuple):
    """`sepv.solve._solution.Corrections` of steps from y0 (d, M) with the numbers `step` (k, M)."""

    record: Record
    y0: Array
    step: Array

    @property
    def gradients(self) -> int:
        return self.record.gradients

    @property
    def structures(self) -> int:
        return self.record.structures

    def of_lanes(self, z: Array, lanes: Lanes) -> tuple[Array, Array, Flags]:
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
        y, step = self.y0[:, lane].ravel().tolist(), self.step[:, lane].ravel().tolist()
        evaluate, parameters, d = self.record.source.function, self.record.source.parameters, len(y)

        def all_three(z: list[float]) -> tuple[list[float], list[float], bool]:
            try:
                out = evaluate(y, z, step, parameters)
            except ZeroDivisionError:  # of numbers; arrays become infinite
                F, corrections, stays = self.of_lanes(np.array(z)[:, None], lane)
                return F.ravel().tolist(), corrections.ravel().tolist(), bool(stays[0])
            return list(out[:d]), list(out[d : 2 * d]), bool(out[2 * d])

        return all_three


def corrections(problem: Problem, formula: Formula, y0: Array, step: Array) -> FromRecord | None:
    """The `Corrections` of steps from y0 (d, M) for a formula with the data `step` (k, M); None without a record."""
    known = record(problem, formula, len(step))
    return None if known is None else FromRecord(known, y0, step)


def record(problem: Problem, formula: Formula, count: int) -> Record | None:
    """The record of a scheme's equation for a named problem; None for other problems and where it cannot be recorded.

    `count` is the number of data of a step that the formula takes. The cache is keyed by the problem's data and holds
    no problem: one that the caller drops is freed.
    """
    if not _fixed(problem) or problem.dimension > LARGEST:
        return None
    names = tuple(getattr(f, "__qualname__", "") for f in _functions(problem))
    key = problem.data, names, formula, count
    if key not in _KEPT:
        if len(_KEPT) >= MOST_KEPT:
            _KEPT.clear()
        _KEPT[key] = _recorded(problem, formula, count)
    return _KEPT[key]


def _recorded(problem: Problem, formula: Formula, count: int) -> Record | None:
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


def _fixed(problem: Problem) -> bool:
    """True if all functions are those of the named problem: none is replaced, wrapped or left out."""
    return (
        type(problem) is Problem
        and isinstance(problem.data, NamedProblem)
        and all(str(getattr(f, "__module__", "")).startswith(_OWN) for f in _functions(problem))
    )


def _functions(problem: Problem) -> list[Any]:
    p, nambu = problem, problem.nambu
    functions: list[Any] = [p.structure, p.hamiltonian, p.gradient, p.hessian, p.structure_derivative]
    functions += [f for f in (p.mean_gradient, p.domain) if f is not None]
    return functions + ([] if nambu is None else [nambu.factor, nambu.casimir])
