"""Steps solved from records are those of the general solver, to a few ulp and lane by lane."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sepv import problems, schemes
from sepv.problem import Problem
from sepv.schemes import Scheme
from sepv.schemes._one_step import Implicit
from sepv.solve import Status
from sepv.solve._differences import difference_jacobian
from sepv.solve._from_record import record
from sepv.solve._solution import Solution

NAMED = [make() for make in problems.PAPER.values()]
RECORDED = "energy-preserving midpoint discrete-gradient gonzalez several-structures both-invariants"
SCHEMES = [schemes.by_name(name) for name in RECORDED.split()]
CASES = [(s, p) for s in SCHEMES for p in NAMED if s is not schemes.both_invariants or p.nambu is not None]


def directly(scheme: Scheme, problem: Problem, y: np.ndarray, h: float, dW: np.ndarray) -> Solution:
    """By the general solver: a function around B is no longer the one that the problem has by its name."""
    plain = replace(problem, structure=partial(problem.structure), check=False)
    return scheme.solve(plain, y, h, dW)


def states(problem: Problem, lanes: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    y = np.asarray(problem.initial)[:, None] * (1 + 0.1 * rng.standard_normal((problem.dimension, lanes)))
    return y, rng.standard_normal((problem.noises, lanes))


@pytest.mark.parametrize(("scheme", "problem"), CASES, ids=lambda value: value.name)
@given(seed=st.integers(0, 2**32 - 1), size=st.sampled_from([1e-6, 1e-2, 0.2]))
def test_solutions_agree_with_the_general_solver(
    scheme: Scheme, problem: Problem, seed: int, size: float
) -> None:
    assert isinstance(scheme.step, Implicit)
    assert scheme.step.formula is not None
    count = len(scheme.step.parts(problem, 0.0, np.zeros((problem.noises, 1))))
    assert record(problem, scheme.step.formula, count) is not None
    y, dW = states(problem, 9, seed)
    found, plain = scheme.solve(problem, y, size, size * dW), directly(scheme, problem, y, size, size * dW)
    both = (found.status == 0) & (plain.status == 0)
    assert np.array_equal(found.status, plain.status)
    # Both leave a residual of 256 roundings of y at most, which moves y1 by (1 − K)⁻¹ of it.
    step = scheme.step.parts(problem, size, size * dW)
    increment = scheme.step.increment
    base = increment(problem, y, plain.value, step).value
    K = difference_jacobian(problem, y, plain.value, step, increment, base)
    through = np.linalg.norm(np.linalg.inv(np.eye(len(y)) - np.moveaxis(K, 2, 0)), axis=(1, 2), ord=np.inf)
    allowed = 512 * 2.0**-52 * through * (np.abs(y) + np.abs(found.change)).max(axis=0)
    assert np.all(np.abs(found.value - plain.value).max(axis=0)[both] <= allowed[both])
    assert np.all(
        found.residual[both] <= 256 * 2.0**-52 * (np.abs(y) + np.abs(found.change)).max(axis=0)[both]
    )
    # The general solver averages the Hessian of a logarithm by three nodes, and takes more.
    assert np.all((found.iterations - plain.iterations)[both] <= 3)


@pytest.mark.parametrize("problem", NAMED, ids=lambda problem: problem.name)
def test_bits_depend_on_no_other_lane(problem: Problem) -> None:
    """Nor on whether a lane is solved over numbers or over arrays; some lanes have no solution."""
    scheme, lanes = schemes.energy_preserving, 1200
    y, dW = states(problem, lanes, 3)
    dW[:, ::97] *= 40.0
    whole = scheme.solve(problem, y, 0.05, dW)
    assert np.all(whole.value[:, whole.status == 0] != 0)
    for n in [*range(0, lanes, 97), 1, 2, 3, lanes - 1]:
        alone = scheme.solve(problem, y[:, n], 0.05, dW[:, n])
        for key in ("value", "change", "residual", "iterations", "status", "gradient_evaluations"):
            assert np.array_equal(getattr(alone, key)[..., 0], getattr(whole, key)[..., n]), (key, n)


def test_a_step_without_a_solution_ends_as_without_a_record() -> None:
    """Lotka-Volterra at a step without a solution, one over the domain's boundary, and a state at rest."""
    problem, scheme = problems.lotka_volterra(), schemes.energy_preserving
    y = np.repeat(np.asarray(problem.initial)[:, None], 3, axis=1)
    dW = np.array([[4.0, 2.0, 0.01]]) * np.ones((problem.noises, 1))
    found, plain = scheme.solve(problem, y, 0.0, dW), directly(scheme, problem, y, 0.0, dW)
    assert np.array_equal(found.status, plain.status)
    assert found.status[0] != Status.CONVERGED
    assert found.iterations[0] == plain.iterations[0]
    assert np.array_equal(found.value[:, 0], plain.value[:, 0])
    rest = scheme.solve(problems.rigid_body(), np.array([0.0, 0.0, 2.0]), 0.5, np.array([0.1]))
    assert rest.value[:, 0].tolist() == [0.0, 0.0, 2.0]
    # |y0| = 0 says nothing about what is small.
    origin = scheme.solve(problems.pendulum(), np.zeros(2), 0.5, np.array([0.1, 0.0]))
    assert origin.status[0] == Status.CONVERGED
    assert origin.iterations[0] <= 7


def test_functions_of_another_author_are_called_and_not_recorded() -> None:
    problem, calls = problems.rigid_body(), []

    def counting(y: np.ndarray) -> np.ndarray:
        calls.append(y.shape)
        return problem.structure(y)

    own = replace(problem, structure=counting, check=False)
    formula = schemes.midpoint.step.formula
    assert record(own, formula, 1) is None
    assert record(replace(problem, hessian=None, check=False), formula, 1) is None
    assert record(problems.kepler(), formula, 1) is None, "four unknowns"
    y1 = schemes.midpoint.step(own, np.array([0.8, 0.6, 0.0]), 0.1, np.array([0.2]))
    assert calls
    assert (
        np.max(np.abs(y1 - schemes.midpoint.step(problem, np.array([0.8, 0.6, 0.0]), 0.1, np.array([0.2]))))
        < 1e-15
    )
