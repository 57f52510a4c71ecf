"""The equation z = R(z) of a step solved from its record: Newton's iteration over straight-line code.

For problems that go by a name, whose formulas are fixed: recording takes as long as a few steps, too long for a random
system. The correction (1 − K)⁻¹(z − R) is recorded with R, so that an iteration is one function of arrays, or of
numbers for a single state, whose bits are the same. The iteration stops as that of `sepv.solve._newton` does, with
corrections beside |y0| alone. What does not arrive in MOST iterations, leaves the domain or overflows is left to that
one, from the start: what becomes of a lane never depends on the others.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np

from sepv.problem import Array, NamedProblem, Problem
from sepv.problem._fields import cramer
from sepv.record import CannotRecord, NoClosedForm
from sepv.record._arrays import Source, source
from sepv.record._binary64 import EPS
from sepv.solve._formula import Formula
from sepv.solve._recorded import Recorded
from sepv.solve._solution import Counts, Solution
from sepv.solve._stop_rule import STAGNATION, is_rounding, is_small, is_stuck, share

# Steps that make sense take three to five. Longer ones may have several solutions, or none: the general solver knows.
MOST = 7
# Cramer's rule is written out up to here.
LARGEST = 3
# Lanes at a time: enough that calls of NumPy cost little beside their work, and all numbers stay in the cache.
BLOCK = 8192
# Records that are kept.
MOST_KEPT = 128
_KEPT: dict[Any, Iteration | None] = {}
# Where functions of problems by name are from: written there, or derived.
_OWN = ("sepv.problems.", "sepv.record.", "sepv.problem._derived")


@dataclass(frozen=True)
class Iteration:
    """z − R, the correction and, where there is a domain, whether y + z is in it, as a function (y, z, step)."""

    source: Source
    dimension: int
    bounded: bool
    gradients: int
    structures: int

    def solve(
        self, y0: Array, step: Array, start: Array | None, otherwise: Callable[[Any], Solution]
    ) -> Solution:
        """Every lane of y0 (d, M); those that do not arrive are solved by `otherwise`, given their numbers."""
        z = np.zeros(y0.shape) if start is None else start
        with np.errstate(all="ignore"):
            found = self._one(y0, step, z) if y0.shape[1] == 1 else None
            change, residual, iterations = self._many(y0, step, z) if found is None else found
        counts = (iterations, iterations * self.gradients, iterations * self.structures)
        solution = Solution(y0 + change, residual, *counts, np.zeros_like(iterations), change)
        if not iterations.all():
            left = np.flatnonzero(iterations == 0)
            part = otherwise(left)
            for key, values in vars(solution).items():
                if values is not None:
                    values[..., left] = getattr(part, key)
        return solution

    def _many(self, y0: Array, step: Array, start: Array) -> tuple[Array, Array, Counts]:
        """z, the residual and the iterations of each lane, 0 where it did not arrive; BLOCK lanes at a time."""
        change, residual = start.copy(), np.zeros(y0.shape[1])
        iterations = np.zeros(y0.shape[1], dtype=np.int64)
        for first in range(0, y0.shape[1], BLOCK):
            part = slice(first, first + BLOCK)
            self._block(y0[:, part], step[:, part], change[:, part], residual[part], iterations[part])
        return change, residual, iterations

    def _block(self, y: Array, step: Array, change: Array, residual: Array, iterations: Counts) -> None:
        """The lanes of a block, into the last three."""
        d, z, lanes = self.dimension, list(change), np.arange(y.shape[1])
        sizes = [np.abs(v) for v in y]
        limit = reduce(np.maximum, sizes)
        last_size = last_move = np.full(lanes.size, np.inf)
        for number in range(1, MOST + 1):
            out = self.source.function(y, z, step, self.source.parameters)
            corrections = out[d : 2 * d]
            moves = [np.abs(v) for v in corrections]
            move, size = reduce(np.maximum, moves), np.full(lanes.size, np.inf)
            near = move <= STAGNATION * limit
            go_on = np.broadcast_to(out[2 * d], near.shape) if self.bounded else ~np.zeros_like(near)
            if near.any():
                reach = [a + np.abs(b) for a, b in zip(sizes, z, strict=True)]
                scale = reduce(np.maximum, reach)
                sharing = [share(a, b, scale) for a, b in zip(moves, reach, strict=True)]
                np.copyto(size, reduce(np.maximum, sharing), where=near)
                rest = reduce(np.maximum, map(np.abs, out[:d]))
                still = is_small(size) | is_stuck(size, move, limit, last_size, last_move)
                ended = go_on & near & still & is_rounding(rest, scale)
                there = np.flatnonzero(ended & (EPS * scale <= limit))
                if there.size:
                    where = lanes[there]
                    for into, value in zip(change, z, strict=True):
                        into[where] = value[there]
                    residual[where], iterations[where] = rest[there], number
                    go_on = go_on & ~ended
            z = [a - b for a, b in zip(z, corrections, strict=True)]
            kept = np.flatnonzero(go_on)
            if not kept.size:
                break
            if kept.size < lanes.size:
                y, step, lanes, limit = y[:, kept], step[:, kept], lanes[kept], limit[kept]
                z, sizes = [v[kept] for v in z], [v[kept] for v in sizes]
                size, move = size[kept], move[kept]
            last_size, last_move = size, move

    def _one(self, y0: Array, step: Array, start: Array) -> tuple[Array, Array, Counts] | None:
        """The same for one lane, over numbers; None where one of them is divided by zero."""
        d, function, parameters = self.dimension, self.source.function, self.source.parameters
        y, known, z = y0[:, 0].tolist(), step[:, 0].tolist(), start[:, 0].tolist()
        sizes = [abs(v) for v in y]
        limit = max(sizes)
        last_size = last_move = math.inf
        try:
            for number in range(1, MOST + 1):
                out = function(y, z, known, parameters)
                corrections = out[d : 2 * d]
                moves = [abs(v) for v in corrections]
                move, size = max(moves), math.inf
                if not sum(moves) < math.inf or (self.bounded and not out[2 * d]):
                    break
                if move <= STAGNATION * limit:
                    reach = [a + abs(b) for a, b in zip(sizes, z, strict=True)]
                    scale = max(reach)
                    size = max([share(a, b, scale) for a, b in zip(moves, reach, strict=True)])
                    rest = max([abs(v) for v in out[:d]])
                    still = is_small(size) or is_stuck(size, move, limit, last_size, last_move)
                    if still and is_rounding(rest, scale) and EPS * scale <= limit:
                        return np.array(z)[:, None], np.array([rest]), np.array([number])
                z = [a - b for a, b in zip(z, corrections, strict=True)]
                last_size, last_move = size, move
        except ZeroDivisionError:
            return None
        return start, np.zeros(1), np.zeros(1, dtype=np.int64)


def iteration(problem: Problem, formula: Formula, count: int) -> Iteration | None:
    """The record of a scheme's equation for a problem by name, None for others and where there is no such record.

    `count` is how many numbers the formula sees of a step. What is kept is known by the problem's data and holds no
    record of a problem: one that the caller drops is gone.
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


def _recorded(problem: Problem, formula: Formula, count: int) -> Iteration | None:
    try:
        recorded = Recorded(problem)
        found = recorded.equation_of(formula, count)
        d, tape = problem.dimension, recorded.tape
        F, A = recorded.system(formula, count)
        numerators, determinant = cramer(A, F)
        outputs = [*F, *(v / tape.symbol(determinant) for v in map(tape.symbol, numerators))]
        inside = None if problem.domain is None else problem.domain(recorded.y + recorded.z)
    except (CannotRecord, NoClosedForm):
        return None
    outputs += [] if inside is None else [inside]
    code = source([recorded.y, recorded.z, found.step], outputs)
    return Iteration(code, d, inside is not None, found.gradients, found.structures)


def _fixed(problem: Problem) -> bool:
    """Whether all functions are those that the problem has by its name: nobody counts, breaks or leaves out one."""
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
