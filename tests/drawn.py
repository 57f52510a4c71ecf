"""Systems and steps for tests: random systems as the laws draw them, one by hand, a changed step,
both engines.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from hypothesis import strategies as st

import sepv
from sepv import problems, schemes
from sepv.law.cases.classes import CLASSES
from sepv.problem import Array, PolynomialSystem, Problem, Systems, vector_field
from sepv.schemes import energy_preserving
from sepv.simulate._batch import AXES
from sepv.verification import Case


def steps(systems: Systems, **where: tuple[str, ...]) -> st.SearchStrategy[Case]:
    """Steps of a class in these strata; axes by name with _ for spaces."""
    named = {axis.replace("_", " "): strata for axis, strata in where.items()}
    space = CLASSES[systems].space
    known = {axis.name: {stratum.name for stratum in axis.strata} for axis in space.axes}
    assert all(set(strata) <= known[axis] for axis, strata in named.items()), known
    return space.part(named).strategy()


def drawn_systems(systems: Systems, **where: tuple[str, ...]) -> st.SearchStrategy[PolynomialSystem]:
    """Systems of a class made for states of size one."""
    return steps(systems, **{**where, "|y|": ("1",), "|Δ|": ("½–1e12",)}).map(_system)


def _system(case: Case) -> PolynomialSystem:
    assert isinstance(case.problem, PolynomialSystem)
    return case.problem


def J(y: Array) -> Array:
    """The structure [[0, −1], [1, 0]] of the plane, component first."""
    return np.array([[0 * y[0], -1 + 0 * y[0]], [1 + 0 * y[0], 0 * y[0]]])


def by_hand(**changes: Any) -> Problem:
    """H = ¼y₁⁴ + ½y₂² in the plane, given by functions, with these changes."""
    parts: dict[str, Any] = {
        "dimension": 2,
        "structure": J,
        "hamiltonian": lambda y: y[0] ** 4 / 4 + y[1] ** 2 / 2,
        "gradient": lambda y: np.array([y[0] ** 3, y[1]]),
    }
    return Problem(**{**parts, **changes})


Step = Callable[[Problem, Array, float, Array], Array]
right: Step = energy_preserving.step


def refusing(error: Exception, where: Callable[..., Any] = lambda *_: True, step: Step = right) -> Step:
    """The step, which raises the error where this function of (problem, y, h, dW) says so."""

    def changed(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        if where(problem, y, h, dW):
            raise error
        return step(problem, y, h, dW)

    return changed


def stretched(excess: float, step: Step = right) -> Step:
    """The step, whose answer is too large by a share."""
    return lambda problem, y, h, dW: step(problem, y, h, dW) * (1 + excess)


def louder(factor: float, step: Step = right) -> Step:
    """The step with the noise multiplied."""
    return lambda problem, y, h, dW: step(problem, y, h, factor * dW)


def clipping(k: float) -> Step:
    """(2.1), which clips its increments at A_h(k) inside the step, with h in seconds."""

    def changed(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        bound = np.sqrt(2 * k * abs(np.log(h)) * h)
        return right(problem, y, h, np.clip(dW, -bound, bound))

    return changed


def euler(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Euler's method with Stratonovich's coefficients as they are: it converges to Itô's
    solution.
    """
    return np.asarray(y + problem.random_step(h, dW) * vector_field(problem, y))


EP, PENDULUM = schemes.energy_preserving, problems.pendulum()


def both(scheme, problem, engine="compiled", **arguments):
    """The same ensemble by an engine and by NumPy's."""
    return (sepv.ensemble(scheme, problem, engine=name, **arguments) for name in (engine, "numpy"))


def same(a: Any, b: Any) -> bool:
    """The bits of all paths, in memory or on disk, and the work."""
    alike = (np.array_equal(getattr(a, key)[...], getattr(b, key)[...]) for key in AXES)
    return all(alike) and a.iterations == b.iterations


def backwards(function: Any, tasks: Any) -> Any:
    """A map that begins with the last task."""
    return [function(task) for task in reversed(tasks)]


def position(ends: Any) -> Any:
    return ends.y[0]


def quartic(values=(0.7, 0.4, 0.3, 0.1, -0.05, 1.0, 0.25, -0.125), noise=(0.5, 0.25)) -> sepv.Problem:
    """A random-looking quartic H in the plane with B(y) of degree one: nodes,
    derivatives and parameters all matter.
    """
    a, b, c, e, f, *B = values
    from sepv.problem import PolynomialSystem
    from sepv.record import polynomial

    H = polynomial(2, {(2, 0): a, (0, 2): b, (1, 2): c, (4, 0): e, (2, 2): f})
    entry = polynomial(2, {(0, 0): B[0], (1, 0): B[1], (0, 1): B[2]})
    return problems.polynomial_problem(PolynomialSystem(2, H, ((0, 1, entry),), noise))
