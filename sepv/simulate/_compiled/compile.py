"""The choice of schemes and problems that the compiled engine can run,
with a reason for each that it cannot run.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.util import find_spec
from types import ModuleType
from typing import TypeVar

import numpy as np

from sepv.errors import Skipped
from sepv.problem import (
    Array,
    Problem,
    damping_of,
    each_noise,
    one_field,
    one_hamiltonian,
)
from sepv.record import CannotRecord, NoClosedForm
from sepv.schemes import Scheme, Systems
from sepv.simulate._compiled.layout import BLOCK_LANES
from sepv.simulate._compiled.newton import NewtonWriter
from sepv.simulate._compiled.projected import ProjectedWriter
from sepv.simulate._compiled.recorded import RecordedProblem
from sepv.simulate._compiled.schemes import Collocation, Formula, formula_of
from sepv.simulate._compiled.stages import StagesWriter
from sepv.simulate._compiled.writer import ExplicitWriter, Writer
from sepv.simulate.targets._target import CannotCompile

T = TypeVar("T")
# Up to this number, paths run one by one, because a block of lanes would be mostly empty. The bits
# are the same.
SINGLE_MAX_PATHS = 8
# The largest d and the most unknowns of a step: code is written out for each component, and
# compiles slowly if long.
LARGEST_DIMENSION = 16
LARGEST_SYSTEM = 32


@dataclass(frozen=True)
class Kernel:
    """A compiled module, the parameters that it reads,
    and the numbers of evaluations of ∇H and B in an iteration.
    """

    module: ModuleType
    parameters: Array
    gradients: int
    structures: int


def kernel(
    scheme: Scheme, problem: Problem, *, lanes: int = BLOCK_LANES, compensated: bool = False
) -> Kernel:
    """Return the compiled kernel of a scheme and a problem; raise CannotCompile if there is
    none.
    """
    if not _installed():
        raise CannotCompile("numba is not installed (pip install numba)")
    return printed(scheme, problem, lambda code, formula: _loaded(code, formula, lanes, compensated))


def printed(scheme: Scheme, problem: Problem, make: Callable[[RecordedProblem, Formula], T]) -> T:
    """Return what a target makes of the problem's code and the scheme's formula;
    raise CannotCompile, with the reason, if they cannot be printed.
    """
    formula, code = taken(scheme, problem), code_of(problem)
    if formula.implicit and formula.stages * problem.dimension > LARGEST_SYSTEM:
        raise CannotCompile(
            f"{scheme.name} has {formula.stages * problem.dimension} unknowns, the engine takes {LARGEST_SYSTEM}"
        )
    try:
        return make(code, formula)
    except NoClosedForm as error:
        raise CannotCompile(f"{problem.name} has no exact mean gradient: H contains {error}") from error
    except CannotRecord as error:
        raise CannotCompile(f"{scheme.name} cannot be recorded for {problem.name}: {error}") from error


@cache
def _installed() -> bool:
    return find_spec("numba") is not None


@lru_cache(maxsize=256)
def _loaded(code: RecordedProblem, formula: Formula, lanes: int, compensated: bool) -> Kernel:
    noises = code.problem.noises
    text, parameters = _written(code, formula, noises, lanes, compensated)
    gradients, structures = code.cost(formula.recorded, formula.names(noises))
    # `code.cost` is the cost of the method of one stage. With several stages, B is evaluated in
    # each.
    read = np.array([*code.problem.c, *parameters], dtype=np.float64)
    collects = gc.isenabled()
    gc.disable()  # numba makes a million objects that stay; searching them would take a tenth of the time
    try:
        from sepv.simulate._compiled.store import load, ordinary

        ordinary("lanes"), ordinary("driver")
        return Kernel(load(text), read, gradients, structures * formula.stages)
    finally:
        if collects:
            gc.enable()


def _written(
    problem: RecordedProblem, formula: Formula, noises: int, lanes: int, compensated: bool
) -> tuple[str, list[float]]:
    """The source of a module, and the parameters that its kernel reads after the noise coefficients
    c_j.
    """
    kind: type[Writer] = NewtonWriter if formula.implicit else ExplicitWriter
    if isinstance(formula, Collocation):
        kind = StagesWriter
    elif formula.projected:
        kind = ProjectedWriter
    writer = kind(problem, formula, noises, lanes, compensated)
    return writer.text(), writer.parameters


def taken(scheme: Scheme, problem: Problem) -> Formula:
    """Return the scheme's formula if the engine can compile it for the problem;
    else raise CannotCompile.
    """
    formula = formula_of(scheme)
    if formula is None:
        raise CannotCompile(f"the compiled engine has no code for the scheme {scheme.name!r}")
    requires = getattr(scheme.step, "requires", None)
    if requires is not None:
        try:
            requires(problem)
        except Skipped as why:
            raise CannotCompile(str(why)) from why
    if damping_of(problem):
        raise CannotCompile(f"{problem.name} has damping, which the compiled engine does not take")
    if one_field(problem):
        return formula
    own, several = formula.parts is each_noise, scheme.systems == Systems.HAMILTONIANS
    if not one_hamiltonian(problem):
        wrong = "" if own and several else f"several Hamiltonians, the scheme {scheme.name!r} takes one"
    elif several:
        wrong = "several structures, and not several Hamiltonians"
    elif any(F.keeping is not F.structure for F in problem.channels):
        wrong = "structures that are undefined at critical points of H"
    else:
        wrong = "" if own else f"several structures, the scheme {scheme.name!r} takes one"
    if wrong:
        raise CannotCompile(f"{problem.name} has {wrong}")
    return formula


def code_of(problem: Problem) -> RecordedProblem:
    """Return the problem's functions as code; raise CannotCompile if d is too large or one cannot
    be recorded.
    """
    if problem.dimension > LARGEST_DIMENSION:
        raise CannotCompile(
            f"{problem.name} has {problem.dimension} components, the compiled engine takes {LARGEST_DIMENSION}"
        )
    try:
        return _recorded(problem)
    except CannotRecord as error:
        raise CannotCompile(f"{problem.name} cannot be recorded: {error}") from error


@lru_cache(maxsize=256)
def _recorded(problem: Problem) -> RecordedProblem:
    return RecordedProblem(problem)
