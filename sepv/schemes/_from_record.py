"""Newton's iteration as straight-line code: z − R(z) and (1 − K)⁻¹(z − R), K = ∂R/∂z,
for a formula of R.

The formula is called with symbols that record its operations (`sepv.record`), and the code is made
from this record. An iteration is then one function, of arrays or of the numbers of a single state;
both give the same bits. Recording takes as long as a few steps. So only problems given by name are
recorded, and not problems drawn at random.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from sepv.core.arrays import Lanes
from sepv.core.formula import Formula
from sepv.core.newton import Flagged
from sepv.core.step import Code
from sepv.problem import Array, NamedProblem, Problem, cramer, one_field
from sepv.record import CannotRecord, NoClosedForm, Source, source
from sepv.schemes._recorded import Recorded

# The largest d for which Cramer's rule is written out.
CRAMER_MAX_DIMENSION = 3
# The most records in the cache, and the cache. A key has the problem's data, the formula, and its
# number of inputs.
MOST_RECORDS = 128
_RECORDS: dict[Any, NewtonRecord | None] = {}
# Prefixes of modules that define or derive the functions of problems given by name.
_RECORDED_MODULES = ("sepv.problems.", "sepv.record.", "sepv.problem._derived")


class NewtonRecord(NamedTuple):
    """The code of a Newton iteration as a function of (y, z, step),
    and the evaluations of ∇H and of B in R.

    The function returns z − R(z), Newton's correction, and a test, True where z minus the
    correction is in the domain.
    """

    source: Source
    gradients: int
    structures: int


def code(problem: Problem, formula: Formula, y0: Array, step: Array) -> Code | None:
    """Newton's corrections by recorded code, for steps from y0 (d, M)
    with the numbers `step` (k, M), such as Δ.

    The result is None if `record` returns None. For z in Python's numbers the code is of numbers
    too, with the same bits.
    """
    recorded = record(problem, formula, len(step))
    if recorded is None:
        return None
    source, d = recorded.source, len(y0)
    one = (y0.ravel().tolist(), step.ravel().tolist()) if y0.shape[1] == 1 else None

    def advance(z: Any, lanes: Lanes) -> tuple[Any, Any, Flagged]:
        if one is not None and isinstance(z, list):
            try:
                out = source.function(one[0], z, one[1], source.parameters)
                return list(out[:d]), list(out[d : 2 * d]), Flagged(False, True, not out[2 * d])
            except ZeroDivisionError:  # Python's numbers raise, where arrays become infinite
                z = np.array(z)[:, None]
        y, s = (y0, step) if lanes.size == y0.shape[1] else (y0.take(lanes, axis=1), step.take(lanes, axis=1))
        values = np.empty((2, *z.shape))
        *rows, stays = source.function(y, z, s, source.parameters)
        for into, row in zip(values.reshape(2 * d, -1), rows, strict=True):
            into[...] = row
        return *values, Flagged(False, True, np.broadcast_to(np.logical_not(stays), lanes.shape))

    return Code(advance, recorded.gradients, recorded.structures)


def record(problem: Problem, formula: Formula, count: int) -> NewtonRecord | None:
    """The recorded Newton iteration of a formula for a problem given by name, from a cache.

    The result is None for other problems, for d > CRAMER_MAX_DIMENSION, and if the formula cannot
    be recorded. `count` is how many numbers of a step the formula uses. The keys of the cache hold
    the data of problems, so that problems can be freed.
    """
    if not _is_fixed(problem) or problem.dimension > CRAMER_MAX_DIMENSION:
        return None
    names = tuple(getattr(f, "__qualname__", "") for f in _functions(problem))
    key = problem.data, names, formula, count
    if key not in _RECORDS:
        if len(_RECORDS) >= MOST_RECORDS:
            _RECORDS.clear()
        _RECORDS[key] = _recorded(problem, formula, count)
    return _RECORDS[key]


def _recorded(problem: Problem, formula: Formula, count: int) -> NewtonRecord | None:
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
    return NewtonRecord(code, equation.gradients, equation.structures)


def _is_fixed(problem: Problem) -> bool:
    """True for a problem given by name with all its own functions: none is replaced,
    wrapped or left out by a user.
    """
    return (
        one_field(problem)
        and isinstance(problem.data, NamedProblem)
        and all(str(getattr(f, "__module__", "")).startswith(_RECORDED_MODULES) for f in _functions(problem))
    )


def _functions(problem: Problem) -> list[Any]:
    """All functions that a problem consists of; `mean_gradient` and `domain` are left out if they
    are None.
    """
    p, nambu = problem, problem.nambu
    functions: list[Any] = [p.structure, p.hamiltonian, p.gradient, p.hessian, p.structure_derivative]
    functions += [f for f in (p.mean_gradient, p.domain) if f is not None]
    return functions + ([] if nambu is None else [nambu.factor, nambu.casimir])
