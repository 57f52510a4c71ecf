"""Steps solved from records are those of the general solver;
equations of the midpoint alone are multiplied out.
"""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from differences import difference_jacobian
from hypothesis import given
from hypothesis import strategies as st

import sepv
from sepv import Problem, problems, schemes
from sepv.core.newton import Status
from sepv.core.step import Solution
from sepv.schemes import Implicit, Recorded, Scheme, _energy_preserving, _midpoint, implicit
from sepv.schemes._from_record import record

NAMED = [make() for make in problems.PAPER.values()]
RECORDED = "energy-preserving midpoint discrete-gradient gonzalez several-structures both-invariants"
SCHEMES = [schemes.by_name(name) for name in RECORDED.split()]
CASES = [(s, p) for s in SCHEMES for p in NAMED if s is not schemes.both_invariants or p.nambu is not None]


def directly(scheme: Scheme, problem: Problem, y: np.ndarray, h: float, dW: np.ndarray) -> Solution:
    """By the general solver: a function around B is no longer the one that the problem has by its
    name.
    """
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
    reach = (np.abs(y) + np.abs(found.change)).max(axis=0)
    allowed = 512 * 2.0**-52 * through * reach
    assert np.all(np.abs(found.value - plain.value).max(axis=0)[both] <= allowed[both])
    assert np.all(found.residual[both] <= 256 * 2.0**-52 * reach[both])
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
    """Lotka-Volterra at a step without a solution, one over the domain's boundary,
    and a state at rest.
    """
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


def longer(fields: Any, y: Any, z: Any, step: Any) -> Any:
    """Δ B(ȳ)∇̄H, three halves of it."""
    return 1.5 * _energy_preserving.formula(fields, y, z, step)


def off_the_middle(fields: Any, y: Any, z: Any, step: Any) -> Any:
    """Δ f(y + z/4): its z is not seen through ȳ."""
    return step[0] * fields.field(y + 0.25 * z)


def with_a_square(fields: Any, y: Any, z: Any, step: Any) -> Any:
    """Δ f(ȳ) + Δ² f(ȳ)."""
    return (step[0] + step[0] * step[0]) * fields.field(y + 0.5 * z)


@pytest.mark.parametrize(
    ("name", "formula", "multiplied"),
    [
        ("rigid-body", _energy_preserving.formula, True), ("rigid-body", longer, True),
        ("harmonic-oscillator", _midpoint.formula, True), ("rigid-body", off_the_middle, False),
        ("rigid-body", with_a_square, False), ("pendulum", _energy_preserving.formula, False),
        ("lotka-volterra", _energy_preserving.formula, False), ("kepler", _energy_preserving.formula, False),
    ],
)  # fmt: skip
def test_right_sides_of_the_midpoint_alone_are_multiplied_out(name, formula, multiplied) -> None:
    assert (Recorded(problems.by_name(name)).of_middle(formula) is not None) == multiplied


@pytest.mark.parametrize("formula", [longer, off_the_middle, with_a_square])
@pytest.mark.parametrize("h", [2.0**-7, 2.0**-2])
def test_the_engines_agree_on_formulas_of_each_kind(formula: Any, h: float) -> None:
    pytest.importorskip("numba")
    scheme = sepv.Scheme("probe", implicit(formula))
    ends = [
        sepv.ensemble(scheme, problems.rigid_body(), h=h, steps=8, paths=150, engine=engine)
        for engine in ("numpy", "compiled")
    ]
    assert (ends[0].status == 0).all()
    assert (ends[1].status == 0).all()
    assert np.abs(ends[0].y - ends[1].y).max() <= 1e-14


@pytest.mark.parametrize(
    "scheme", [schemes.energy_preserving, schemes.stochastic_midpoint], ids=lambda s: s.name
)
def test_given_increments_are_read_where_they_are_whatever_their_number(scheme: sepv.Scheme) -> None:
    pytest.importorskip("numba")
    problem = problems.rigid_body()
    dW = 0.1 * np.random.default_rng(3).standard_normal((20, problem.noises, 300))
    whole = sepv.ensemble(scheme, problem, h=0.01, steps=20, dW=dW, engine="compiled")
    assert np.array_equal(whole.W, np.add.accumulate(dW)[-1])
    for part in (slice(0, 128), slice(0, 131), slice(5, 9), slice(40, 300)):
        alone = sepv.ensemble(scheme, problem, h=0.01, steps=20, dW=dW[:, :, part], engine="compiled")
        assert np.array_equal(alone.y, whole.y[:, part])
