"""Explicit methods projected on the invariants."""

import numpy as np
import pytest

from sepv import StepFailure, ensemble, problems, schemes
from sepv.problem import PolynomialSystem, casimir_gradients
from sepv.record import polynomial
from sepv.record._polynomial import constant
from sepv.schemes._projected import solve_projection
from sepv.solve import Status

EPS = 2.0**-52
ORDERS = (4, 8)


@pytest.mark.parametrize("order", ORDERS)
def test_it_moves_the_explicit_step_by_what_that_loses(order: int) -> None:
    problem = problems.pendulum()
    y = 1.2 * np.random.default_rng(0).standard_normal((2, 40))
    dW = 0.3 * np.random.default_rng(1).standard_normal((2, 40))
    plain = schemes.explicit(order).step(problem, y, 0.2, dW)
    kept = schemes.projected(order).step(problem, y, 0.2, dW)
    lost = np.abs(problem.hamiltonian(plain) - problem.hamiltonian(y))
    slope = np.sqrt(np.sum(problem.gradient(plain) ** 2, axis=0))
    assert lost.max() > 1e-9
    # Roundings of y1, which H sees as |∇H||y1|, and of the terms of H.
    terms = np.sum(np.abs(problem.gradient(kept) * kept), axis=0) + 1 + kept[0] ** 2
    assert np.all(np.abs(problem.hamiltonian(kept) - problem.hamiltonian(y)) <= EPS * terms)
    moved = np.sqrt(np.sum((kept - plain) ** 2, axis=0))
    # To first order lost/|∇H|, along the gradient; what it turns over that way is of the second.
    assert np.all(
        np.abs(moved - lost / slope) <= 4 * EPS * np.max(np.abs(y)) + 2 * (lost / slope) ** 2 / slope
    )


def body(hamiltonian: dict, casimirs: tuple) -> PolynomialSystem:
    """so(3) with any H."""
    minus = [polynomial(3, {tuple(int(i == k) for k in range(3)): -1.0}) for i in range(3)]
    plus = polynomial(3, {(0, 1, 0): 1.0})
    return PolynomialSystem(
        3, polynomial(3, hamiltonian), ((0, 1, minus[2]), (0, 2, plus), (1, 2, minus[0])), (0.5,), casimirs
    )


ROUND = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
SQUARES = {(2, 0, 0): 1.4, (0, 2, 0): 0.8, (0, 0, 2): 0.5, (1, 0, 3): 0.25}


def test_a_large_constant_in_the_energy_costs_nothing() -> None:
    y, dW = np.array([0.8, 0.5, -0.4]), np.array([0.3])
    scheme = schemes.projected(8)
    plain = scheme.step(problems.polynomial_problem(body(SQUARES, (ROUND,))), y, 0.1, dW)
    large = body({**SQUARES, (0, 0, 0): 1e12}, (ROUND,))
    assert np.array_equal(scheme.step(problems.polynomial_problem(large), y, 0.1, dW), plain)


def test_a_casimir_that_is_listed_twice_is_kept_once() -> None:
    y, dW = np.array([0.8, 0.5, -0.4]), np.array([0.3])
    once, twice = (problems.polynomial_problem(body(SQUARES, (ROUND,) * n)) for n in (1, 2))
    scheme = schemes.projected(8)
    a, b = scheme.step(once, y, 0.1, dW), scheme.step(twice, y, 0.1, dW)
    # |y| = 1 and H = 0.6: a rounding or two of y, and of the sums of three and four terms.
    assert np.max(np.abs(a - b)) <= 2 * EPS
    assert abs(b @ b - y @ y) <= 2 * EPS
    assert abs(once.hamiltonian(b) - once.hamiltonian(y)) <= 4 * EPS
    # Without the Casimir among the invariants it is lost: what keeps it is the projection.
    none = problems.polynomial_problem(body(SQUARES, ()))
    assert abs((c := scheme.step(none, y, 0.4, 2 * dW)) @ c - y @ y) > 1e-12


def test_a_state_at_rest_stays() -> None:
    y = np.array([[0.0, 1.0], [0.0, 0.0], [0.0, 0.0]])
    assert np.array_equal(schemes.projected(4).step(problems.rigid_body(), y, 0.1, np.full((1, 2), 0.4)), y)
    system = PolynomialSystem(2, polynomial(2, {(0, 0): 3.0}), ((0, 1, constant(2, 1.0)),), (1.0,))
    flat, point = problems.polynomial_problem(system), np.array([0.3, 0.4])
    assert np.array_equal(schemes.projected(4).step(flat, point, 0.1, np.array([0.4])), point)


def test_steps_that_are_too_coarse_say_so() -> None:
    problem, scheme = problems.lotka_volterra(), schemes.projected(4)
    y = np.repeat(np.array(problem.initial)[:, None], 200, axis=1)
    dW = 2.0 * np.random.default_rng(0).standard_normal((1, 200))
    solution = scheme.solve(problem, y, 0.5, dW)
    assert {Status.CONVERGED, Status.LEFT_DOMAIN} <= set(solution.status.tolist())
    good = solution.status == Status.CONVERGED
    assert np.all(problem.domain(solution.value[:, good]))
    kept = problem.hamiltonian(solution.value[:, good]) - problem.hamiltonian(y[:, good])
    # What the last correction leaves is of second order; H has eight terms, slopes up to 4, and logarithms of y ≪ 1.
    size = 1 + np.max(np.abs(solution.value[:, good]), axis=0)
    assert np.all(np.abs(kept) <= 64 * EPS * size)
    bad = int(np.flatnonzero(~good)[0])
    with pytest.raises(StepFailure):
        scheme.step(problem, y[:, bad], 0.5, dW[:, bad])


def test_a_batch_has_the_bits_of_its_states_with_eight_components() -> None:
    """From eight on `np.sum` adds the components of a single state in pairs."""
    rng = np.random.default_rng(5)
    squares = {tuple(2 * int(i == k) for k in range(8)): w for i, w in enumerate(rng.uniform(0.5, 2.0, 8))}
    pairs = tuple((i, i + 4, constant(8, 1.0)) for i in range(4))
    problem = problems.polynomial_problem(PolynomialSystem(8, polynomial(8, squares), pairs, (0.5,)))
    y, dW = rng.standard_normal((8, 50)), 0.3 * rng.standard_normal((1, 50))
    scheme = schemes.projected(4)
    alone = [scheme.step(problem, y[:, [n]], 0.1, dW[:, [n]]) for n in range(50)]
    assert np.array_equal(scheme.step(problem, y, 0.1, dW), np.hstack(alone))


def test_a_batch_has_the_bits_of_its_states_with_any_casimir() -> None:
    """A product of a matrix with a batch by a library rounds by the size of the batch."""
    rng = np.random.default_rng(3)
    A = np.array([[0.3, 1.0, 0.7], [1.0, 1.1, 2.0], [0.7, 2.0, -0.9]])
    system = PolynomialSystem(
        3, polynomial(3, SQUARES), (), (1.0,), (tuple(tuple(row) for row in A.tolist()),)
    )
    problem, scheme = problems.polynomial_problem(system), schemes.projected(4)
    y, end = rng.standard_normal((3, 64)), rng.standard_normal((3, 64))
    (together,) = casimir_gradients([A], [], 2 * y)
    alone = [casimir_gradients([A], [], 2 * y[:, [k]])[0] for k in range(64)]
    assert np.array_equal(together, np.hstack(alone))
    # Three products of at most 2·2·3 and their sums: four roundings of 12.
    assert np.max(np.abs(together - 2 * A @ y)) <= 4 * 12 * EPS
    assert np.array_equal(scheme.step(problem, end, 0.1, np.zeros((1, 64))), end)


def test_long_steps_from_a_small_state_end_at_the_rounding_of_what_they_move() -> None:
    """H linear and B constant: z* = ΔB∇H is the solution up to rounding of itself, far above that of y0 = 0."""
    a = np.array([-0.7, 0.9, 0.0])
    system = PolynomialSystem(
        3, polynomial(3, {(1, 0, 0): a[0], (0, 1, 0): a[1]}), ((0, 1, constant(3, -1.0)),), (1.0,)
    )
    problem, delta = problems.polynomial_problem(system), np.random.default_rng(0).uniform(0.1, 10.0, 400)
    for sign in (1, -1):  # all components negative or zero, and all of them positive or zero
        solution = solve_projection(problem, 4, np.zeros((3, 400)), sign * delta)
        assert not solution.status.any()
        assert solution.iterations.max() <= 4
        exact = sign * delta * np.array([[-a[1]], [a[0]], [0.0]])
        # Four stages of rounded products, their sum, and what the projection takes off again.
        assert np.max(np.abs(solution.value - exact) / delta) <= 8 * EPS


def test_what_a_correction_leaves_alone_does_not_end_the_iteration() -> None:
    """A third component that nothing moves has a correction of zero."""
    idle = PolynomialSystem(
        3, polynomial(3, {(4, 0, 0): 0.25, (0, 2, 0): 0.5}), ((0, 1, constant(3, -1.0)),), (0.5,)
    )
    problem = problems.polynomial_problem(idle)
    y = np.array([1.1, 0.3, 0.7])
    solution = schemes.projected(4).solve(problem, y, 0.5, np.array([0.2]))
    assert solution.iterations[0] > 2
    assert solution.gradient_evaluations.tolist() == (5 + 2 * solution.iterations).tolist()
    assert solution.value[2, 0] == y[2]
    # H from four products and two sums, each rounded; ∇H·y < 4H.
    moved = problem.hamiltonian(solution.value[:, 0]) - problem.hamiltonian(y)
    assert abs(moved) <= 8 * EPS * problem.hamiltonian(y)


@pytest.mark.parametrize("engine", ["numpy", "compiled"])
def test_a_casimir_is_kept_where_its_gradient_vanishes(engine: str) -> None:
    """C = y1² at y1 = 0: the correction of H must not move y1, because none along ∇C = 0 could move it back."""
    idle = PolynomialSystem(
        3,
        polynomial(3, {(1, 4, 0): 0.5, (0, 2, 0): 0.5, (0, 3, 2): 0.25}),
        ((1, 2, constant(3, 1.0)),),
        (0.5,),
        (((1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),),
    )
    problem, y = problems.polynomial_problem(idle), np.array([0.0, 1.0, 0.5])
    ends = ensemble(schemes.projected(4), problem, h=1 / 16, steps=16, paths=32, y0=y, engine=engine).y
    assert np.all(ends[0] == 0.0)
    moved = problem.hamiltonian(ends) - problem.hamiltonian(y)
    # |∇H||y| ≤ 5|y|⁵ for |y| ≥ 1: each of 16 steps rounds y1 and the terms of its residual, 8 eps|y|⁵ for both.
    assert np.max(np.abs(moved)) <= 16 * 8 * EPS * max(1.0, np.max(np.abs(ends))) ** 5
