"""The implicit solve: what it reports; and Newton's Jacobians, which are derivatives,
as no law about steps sees.
"""

from dataclasses import replace
from importlib import import_module
from itertools import product

import numpy as np
import pytest
from differences import difference_jacobian
from drawn import J
from hypothesis import given

import sepv
from sepv import problems, schemes
from sepv.core.arrays import EPS
from sepv.core.newton import Status
from sepv.core.problem import hessian
from sepv.law import strategies
from sepv.problem import (
    PolynomialSystem,
    Problem,
    derivative_along,
    field_jacobian,
    structure_slope,
    vector_field,
)
from sepv.record import _polynomial as poly
from sepv.schemes._collocation import _Stages
from sepv.schemes._energy_preserving import step as preserving
from sepv.schemes._tableaux import exact_nodes
from sepv.verification import Case

increment = preserving.increment

IMPLICIT = [s for s in schemes.PAPER.values() if s.solve is not None]


def stripped(problem: Problem, *keys: str) -> Problem:
    """The problem without what a user may leave out."""
    return replace(problem, **dict.fromkeys(keys, None), check=False)


@given(strategies.any_steps())
def test_residual_is_that_of_the_value_returned_and_at_rounding(case: Case) -> None:
    problem, y, h, dW = case.build()
    solution = schemes.energy_preserving.solve(problem, y, h, dW)
    assert solution.status[0] == Status.CONVERGED
    from sepv.verification import step_residual

    delta = problem.random_step(h, dW[:, None])[None]
    y1 = solution.value
    residual = y1 - y[:, None] - increment(problem, y[:, None], y1, delta).value
    allowed = step_residual(problem, y, y1[:, 0], h, dW)
    assert np.all(np.abs(residual[:, 0]) <= allowed)
    assert solution.residual[0] <= allowed.max()
    assert 1 <= solution.iterations[0] <= 12
    assert solution.gradient_evaluations[0] >= solution.iterations[0] == solution.structure_evaluations[0]


@pytest.mark.parametrize("scheme", IMPLICIT, ids=lambda s: s.name)
@given(case=strategies.steps())
def test_problems_without_derivatives_or_degree_give_the_same_step(scheme: sepv.Scheme, case: Case) -> None:
    problem, y, h, dW = case.build()
    plain = stripped(problem, "hessian", "structure_derivative", "degree", "data")
    full, bare = (scheme.solve(p, y, h, dW) for p in (problem, plain))
    assert full.status[0] == bare.status[0] == Status.CONVERGED
    from sepv.verification import step_residual

    # Two solutions of one equation, each with a residual at rounding; the contraction factor is
    # ≤ 1/4.
    allowed = 2 * 4 / 3 * step_residual(problem, y, full.value[:, 0], h, dW).max()
    assert np.max(np.abs(full.value - bare.value)) <= allowed


@given(case=strategies.any_steps())
def test_bits_do_not_depend_on_the_batch(case: Case) -> None:
    """Of the scheme of which the law *reproducibility* asks this in deep runs alone."""
    (problem, y, h, dW), scheme = case.build(), schemes.discrete_gradient
    lanes = 5
    factors = 1 - np.arange(lanes) / 16
    batch = scheme.solve(problem, y[:, None] * factors, h, np.repeat(dW[:, None], lanes, axis=1))
    for k, factor in enumerate(factors):
        alone = scheme.solve(problem, y * factor, h, dW)
        assert np.array_equal(alone.value[:, 0], batch.value[:, k])
        assert alone.iterations[0] == batch.iterations[k]


def test_a_gradient_too_rough_for_quadrature_is_reported() -> None:
    def kink(y: np.ndarray) -> np.ndarray:
        return np.stack([np.sign(y[0] - 0.123) + y[0], y[1]])

    keys = ("mean_gradient", "degree", "hessian", "structure_derivative")
    problem = replace(stripped(problems.harmonic_oscillator(), *keys), gradient=kink, check=False)
    with pytest.raises(sepv.StepFailure, match="quadrature"):
        schemes.energy_preserving.step(problem, np.array([0.1, -1.0]), 0.5, np.array([0.1]))


def test_a_step_without_solution_says_so() -> None:
    problem = problems.lotka_volterra()
    y = np.asarray(problem.initial)
    for delta in (2.0, -1.0):  # no solution was ever found there
        with pytest.raises(sepv.StepFailure, match="Remedy") as caught:
            schemes.energy_preserving.step(problem, y, 0.5, np.array([(delta - 0.5) / 0.5]))
        failure = caught.value
        assert failure.problem == "lotka-volterra"
        assert failure.delta == pytest.approx(delta)
        assert failure.y.tolist() == [1.0, 1.9, 0.5]
        assert failure.iterations >= 1
        assert failure.residual > 1e-9


def test_a_state_at_rest_stays_where_the_jacobian_is_singular() -> None:
    """H = y1 y2 has a saddle at the origin; at Δ = 2 the Jacobian of (3.4) and (2.1)
    there is singular.
    """
    B = [[0, 1, [[[0, 0], 1.0]]]]
    data = problems.from_json({"dimension": 2, "hamiltonian": [[[1, 1], 1.0]], "structure": B})
    problem = problems.polynomial_problem(data)
    for scheme in IMPLICIT:
        assert scheme.step(problem, np.zeros(2), 1.0, np.array([1.0])).tolist() == [0.0, 0.0]


@pytest.mark.parametrize("name", ["midpoint", "energy-preserving", "discrete-gradient"])
def test_a_domain_in_which_h_goes_on_beyond_is_left_by_name(name: str) -> None:
    """A rotation by Δ ≈ ½ from (1, 1) takes q to 1.36, where H is defined too:
    `domain` alone ends it at 1.2.
    """
    H = lambda y: 0.5 * (y[0] ** 2 + y[1] ** 2)  # noqa: E731
    problem = Problem(2, J, H, domain=lambda y: y[1] < 1.2, initial=(1.0, 1.0))
    y, dW = np.array([[1.0, 1.0, 0.1], [1.0, 1.0, -0.5]]), np.array([[0.4, 0.0, 0.4]])
    solve = schemes.by_name(name).solve
    assert solve is not None
    expected = [Status.LEFT_DOMAIN, Status.CONVERGED, Status.CONVERGED]
    found = solve(problem, y, 0.1, dW)
    assert found.status.tolist() == expected
    assert np.all(found.value[1] < 1.2)
    assert [solve(problem, y[:, k], 0.1, dW[:, k]).status[0] for k in range(3)] == expected
    everywhere = solve(replace(problem, domain=None, check=False), y, 0.1, dW)
    assert everywhere.status.tolist() == [Status.CONVERGED] * 3
    assert everywhere.value[1, 0] > 1.2


MODULES = ("energy_preserving", "midpoint", "several_structures")
Y0 = np.array([[0.8, -0.3], [0.6, 0.9], [0.1, -0.7]])
Y1 = Y0 + np.array([[0.2, 0.1], [-0.1, 0.3], [0.15, -0.2]])


def generic(degree: int = 4) -> Problem:
    """Every monomial up to a degree in H, every entry of B quadratic: nothing vanishes by
    chance.
    """
    exponents = [e for e in product(range(degree + 1), repeat=3) if 0 < sum(e) <= degree]
    H = poly.polynomial(3, {e: 1 / (3 + n) for n, e in enumerate(exponents)})
    short = [(n, e) for n, e in enumerate(exponents, start=1) if sum(e) <= 2]
    entries = tuple(
        (i, j, poly.polynomial(3, {e: (n + 2 * i - j) / 7 for n, e in short}))
        for i, j in ((0, 1), (0, 2), (1, 2))
    )
    other = tuple((i, j, poly.scale(-0.5, poly.add(p, poly.variable(3, i)))) for i, j, p in entries)
    return problems.polynomial_problem(PolynomialSystem(3, H, entries, noise_structures=(other,)))


def module_of(name: str):
    return import_module(f"sepv.schemes._{name}").step


def known(name: str) -> np.ndarray:
    """What the equation takes of the step: Δ, or h and the noise."""
    rows = {"several_structures": 2}.get(name, 1)
    return np.array([[0.3, -0.2], [0.25, 0.45]])[:rows]


@pytest.mark.parametrize("name", MODULES)
def test_the_jacobian_is_the_derivative_of_the_increment(name: str) -> None:
    """Against the complex step (Squire and Trapp 1998), which has no rounding of differences."""
    scheme, problem, step = module_of(name), generic(6), known(name)
    if name != "several_structures":
        problem = single(problem)
    K = scheme.jacobian(problem, Y0, Y1, step)
    for k in range(3):
        moved = Y1.astype(complex)
        moved[k] += 1e-30j
        column = scheme.increment(problem, Y0.astype(complex), moved, step).value.imag / 1e-30
        # Some 200 terms of size ≤ |K|, each rounded a few times.
        assert np.max(np.abs(K[:, k] - column)) <= 1e-13 * np.abs(K).max()
        differences = difference_jacobian(
            problem, Y0, Y1, step, scheme.increment, scheme.increment(problem, Y0, Y1, step).value
        )
        # Forward differences of width √eps: an error of √eps |∂²R|, which is of the size of K here.
        assert np.max(np.abs(differences[:, k] - column)) <= 1e-6 * np.abs(K).max()


def single(problem: Problem) -> Problem:
    """The same with one structure."""
    return problems.polynomial_problem(replace(problem.data, noise_structures=()))


@pytest.mark.parametrize(("stages", "degree"), [(1, 4), (2, 4), (3, 3)])
@pytest.mark.parametrize("averaged", [True, False])
def test_the_jacobian_of_the_stages_is_the_derivative_of_their_equations(
    stages: int, degree: int, averaged: bool
) -> None:
    """For these the few nodes that average H″ are exact."""
    problem = single(generic(degree))
    nodes = exact_nodes(stages, degree) if averaged else stages
    system = _Stages(problem, stages, Y0, np.array([0.3, -0.2]), nodes, averaged)
    z, lanes, size = 0.1 * np.cos(np.arange(3 * stages * 2)).reshape(3 * stages, 2), np.arange(2), 2.0**-17
    K = system.evaluate(z, lanes).slope()
    for k in range(3 * stages):
        ahead, behind = (z.copy(), z.copy())
        ahead[k] += size
        behind[k] -= size
        difference = (system.evaluate(s, lanes).value for s in (ahead, behind))
        column = np.subtract(*difference) / (2 * size)
        # size² of the third derivative and eps/size of the value, both of some ten times |K|.
        assert np.max(np.abs(K[:, k] - column)) <= 1e-8 * np.abs(K).max()


def test_derivatives_of_the_field_are_derivatives() -> None:
    problem, y = single(generic()), Y0
    plain = replace(problem, hessian=None, structure_derivative=None, check=False)
    v = problem.gradient(y)
    J = field_jacobian(problem, y)
    assert field_jacobian(plain, y) is None
    assert field_jacobian(replace(problem, hessian=None, check=False), y) is None
    for k in range(3):
        moved = y.astype(complex)
        moved[k] += 1e-30j
        assert np.allclose(J[:, k], vector_field(problem, moved).imag / 1e-30, rtol=1e-13, atol=1e-13)
    # Forward differences of width √eps |y|.
    for function in (hessian, lambda p, at: structure_slope(p, at, v)):
        exact = function(problem, y)
        assert np.max(np.abs(function(plain, y) - exact)) <= 1e-6 * np.abs(exact).max()


@pytest.mark.parametrize("side", [1, -1])
def test_differences_stay_inside_the_domain(side: int) -> None:
    """± y1 ≤ 1, and the first lane on the boundary: differences to the other side there,
    as good as any.
    """
    base = single(generic())

    def inside(y: np.ndarray) -> np.ndarray:
        return np.where(side * y[0] <= 1, 1, 0)  # numbers, as a user may write it

    def gradient(y: np.ndarray) -> np.ndarray:
        return np.where(inside(y), base.gradient(y), np.nan)

    without = dict.fromkeys(("hessian", "structure_derivative", "degree"))
    problem = replace(base, domain=inside, gradient=gradient, check=False, **without)
    y = np.array([[side, 0.5], [0.6, 0.9], [0.1, -0.7]])
    assert np.max(np.abs(hessian(problem, y) - base.hessian(y))) <= 1e-6 * np.abs(base.hessian(y)).max()
    scheme, step = module_of("midpoint"), known("midpoint")
    found, exact = (
        difference_jacobian(p, y, y, step, scheme.increment, scheme.increment(p, y, y, step).value)
        for p in (problem, base)
    )
    assert np.max(np.abs(found - exact)) <= 1e-6 * np.abs(exact).max()


@pytest.mark.parametrize("size", [1e-6, 1e-3, 1.0, 1e3])
@pytest.mark.parametrize("name", ["lotka-volterra", "pendulum", "rigid-body"])
def test_differences_along_a_vector_find_the_scale_of_the_field(name: str, size: float) -> None:
    """|y| for 1/y and for polynomials, 1 for a sine, however many turns |y| is.

    In binary64 an error of order six, (2⁻⁷)⁶ = 2e-13 beside f, and the rounding of y, eps|y| 2⁷; in
    long double, where that has 64 bits of mantissa, (2⁻⁹)⁶ and 2¹¹ times less rounding: at most a
    few roundings of f′v.
    """
    problem = problems.by_name(name)
    y = size * np.outer(np.asarray(problem.initial), [1.0, 0.7])
    v = np.outer(np.arange(1.0, problem.dimension + 1), [1.0, -0.5])
    exact = derivative_along(problem, y, v)
    plain = replace(problem, hessian=None, structure_derivative=None, check=False)
    binary64 = replace(
        plain,
        structure=lambda y: problem.structure(np.asarray(y, dtype=np.float64)),
        gradient=lambda y: problem.gradient(np.asarray(y, dtype=np.float64)),
        check=False,
    )
    reach = np.abs(y).max(axis=0)
    slope = np.abs(vector_field(problem, y)).max(axis=0) / np.minimum(reach, 1.0) * np.abs(v).max(axis=0)
    unit = np.abs(exact).max(axis=0) + slope
    rounded = EPS * 2**7 * (np.maximum(reach, 1.0) if name == "pendulum" else 1.0)
    assert np.all(np.abs(derivative_along(binary64, y, v) - exact) <= (2e-13 + 4 * rounded) * unit)
    if np.finfo(np.longdouble).nmant >= 63:
        wide = 16 * EPS + rounded * 2.0**-7
        assert np.all(np.abs(derivative_along(plain, y, v) - exact) <= wide * unit)
