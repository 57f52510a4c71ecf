"""Steps of more than one solve: projected on the invariants, divided,
or followed along their curve of solutions.
"""

import numpy as np
import pytest

import sepv
from sepv import StepFailure, ensemble, problems, schemes
from sepv.core.newton import Status
from sepv.problem import PolynomialSystem, casimir_gradients
from sepv.record import EPS, polynomial
from sepv.record._polynomial import constant
from sepv.schemes import continued, divided
from sepv.schemes._projected import solve_projection

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
    moved, least = np.sqrt(np.sum((kept - plain) ** 2, axis=0)), lost / slope
    # To first order lost/|∇H|, along the gradient; what it turns over that way is of the second.
    assert np.all(np.abs(moved - least) <= 4 * EPS * np.max(np.abs(y)) + 2 * least**2 / slope)


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
    # What the last correction leaves is of second order; H has eight terms, slopes up to 4, and
    # logarithms of y ≪ 1.
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
    system = PolynomialSystem(3, polynomial(3, SQUARES), (), (1.0,), (tuple(map(tuple, A.tolist())),))
    problem, scheme = problems.polynomial_problem(system), schemes.projected(4)
    y, end = rng.standard_normal((3, 64)), rng.standard_normal((3, 64))
    (together,) = casimir_gradients([A], [], 2 * y)
    alone = [casimir_gradients([A], [], 2 * y[:, [k]])[0] for k in range(64)]
    assert np.array_equal(together, np.hstack(alone))
    # Three products of at most 2·2·3 and their sums: four roundings of 12.
    assert np.max(np.abs(together - 2 * A @ y)) <= 4 * 12 * EPS
    assert np.array_equal(scheme.step(problem, end, 0.1, np.zeros((1, 64))), end)


def test_long_steps_from_a_small_state_end_at_the_rounding_of_what_they_move() -> None:
    """H linear and B constant: z* = ΔB∇H is the solution up to rounding of itself,
    far above that of y0 = 0.
    """
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
    H = polynomial(3, {(4, 0, 0): 0.25, (0, 2, 0): 0.5})
    idle = PolynomialSystem(3, H, ((0, 1, constant(3, -1.0)),), (0.5,))
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
    """C = y1² at y1 = 0: the correction of H must not move y1,
    because none along ∇C = 0 could move it back.
    """
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
    # |∇H||y| ≤ 5|y|⁵ for |y| ≥ 1: each of 16 steps rounds y1 and the terms of its residual, 8
    # eps|y|⁵ for both.
    assert np.max(np.abs(moved)) <= 16 * 8 * EPS * max(1.0, np.max(np.abs(ends))) ** 5


@pytest.mark.parametrize("name", ["energy-preserving", "both-invariants", "collocation-2"])
def test_divided_steps_reach_the_end_and_keep_the_energy(name: str) -> None:
    """Lotka-Volterra at h = 1/8: more than a tenth of the paths have a step of (2.1)
    without a solution.
    """
    problem, scheme = problems.lotka_volterra(), schemes.by_name(name)
    options = {"h": 0.125, "T": 1.0, "paths": 64, "seed": 1}
    plain = sepv.ensemble(scheme, problem, engine="numpy", **options)
    ends = sepv.ensemble(divided(scheme), problem, **options)
    assert plain.divisions == 0
    assert not ends.status.any()
    assert (ends.divisions > 0) == bool(plain.status.any())
    assert ends.energy_defect.max() < 1e-12
    fine = plain.status == 0
    assert np.array_equal(ends.y[:, fine], plain.y[:, fine])  # nothing else is touched


def by_hand(problem, y, h, dW, depth: int) -> tuple[np.ndarray, int, bool]:
    """(y1, divisions, solved) of one state, halves of halves written out with the scheme itself."""
    solution = schemes.energy_preserving.solve(problem, y, h, dW)
    if not solution.status[0]:
        return solution.value[:, 0], 0, True
    if not depth:
        return solution.value[:, 0], 0, False
    middle, first, arrived = by_hand(problem, y, h / 2, dW / 2, depth - 1)
    if not arrived:
        return middle, 1 + first, False
    end, second, solved = by_hand(problem, middle, h / 2, dW / 2, depth - 1)
    return end, 1 + first + second, solved


@pytest.mark.parametrize("depth", [1, 3])
def test_parts_are_the_steps_of_the_scheme_and_their_divisions_are_counted(depth: int) -> None:
    problem = problems.lotka_volterra(noise=(0.5,))
    dW = np.array([[0.1, 0.9, -1.4, 2.0, -2.5, 4.0, 6.0]])
    y = np.asarray(problem.initial)[:, None] * (1 + np.arange(7) / 50)
    h, solution = 0.125, divided(schemes.energy_preserving, depth).solve(problem, y, 0.125, dW)
    found = [by_hand(problem, y[:, k], h, dW[:, k], depth) for k in range(7)]
    assert np.array_equal(solution.value, np.stack([value for value, _, _ in found], axis=1))
    assert solution.divisions.tolist() == [count for _, count, _ in found]
    assert solution.divisions.dtype == np.int64
    assert (solution.status == 0).tolist() == [solved for _, _, solved in found]
    assert len({count for _, count, _ in found}) >= min(depth, 3)
    assert np.max(np.abs(solution.change - (solution.value - y))) < 1e-15
    whole = schemes.energy_preserving.solve(problem, y, h, dW)
    assert np.array_equal(solution.change[:, 0], whole.change[:, 0])


def test_a_divided_scheme_says_what_it_is_and_its_failures_what_they_were_asked() -> None:
    scheme = divided(schemes.energy_preserving)
    assert scheme.name == "energy-preserving, divided"
    assert not scheme.claims
    assert scheme.source == "Cohen and Dujardin (2014), equation (2.1); failed steps in up to 2^8 parts"
    assert "2^20 parts" in divided(schemes.energy_preserving, 20).source
    with pytest.raises(StepFailure) as caught:
        divided(schemes.energy_preserving, 1).step(
            problems.lotka_volterra(noise=(0.5,)), np.array([1.0, 1.9, 0.5]), 0.25, np.array([40.0])
        )
    assert caught.value.delta == 20.25


EP = schemes.energy_preserving
PENDULUM = problems.pendulum()
# States (columns) and Δ of the pendulum: the iteration from y fails for all but the first, whatever
# its roundings.
LONG = np.array([[0.2, 0.62, 0.45, 1.13, -2.37], [1.0, 1.5, 1.65, -1.59, 1.45]])
DELTA = np.array([0.1, 13.7, 17.1, 22.0, 19.52])
STEPS = np.stack([DELTA, np.zeros(5)])  # c = (1, ½), h = 0


def test_long_steps_of_the_pendulum_are_reached_along_their_curve() -> None:
    """The curve of the last one ends before the step does."""
    plain, found = EP.solve(PENDULUM, LONG, 0.0, STEPS), continued(EP).solve(PENDULUM, LONG, 0.0, STEPS)
    assert (plain.status == 0).tolist() == [True, False, False, False, False]
    assert (found.status == 0).tolist() == [True, True, True, True, False]
    assert found.continuations[0] == 0 < found.continuations[1:].min()
    assert np.array_equal(found.value[:, 0], plain.value[:, 0])  # nothing else is touched
    assert np.array_equal(found.value[:, :4], (LONG + found.change)[:, :4])
    drift = np.abs(PENDULUM.hamiltonian(found.value) - PENDULUM.hamiltonian(LONG))[:4]
    assert drift.max() < 1e-13
    assert found.residual[:4].max() < 1e-12
    assert (found.iterations > plain.iterations).tolist() == [False, True, True, True, True]


def test_the_solution_is_the_one_that_belongs_to_y() -> None:
    """Against 1024 short shares by hand, each from the last."""
    y, z = LONG[:, 1:2], np.zeros((2, 1))
    for share in np.arange(1, 1025) / 1024:
        part = EP.solve(PENDULUM, y, 0.0, share * STEPS[:, 1:2], start=z)
        assert not part.status.any()
        assert np.abs(part.change - z).max() < 0.2
        z = part.change
    found = continued(EP).solve(PENDULUM, y, 0.0, STEPS[:, 1:2])
    assert np.allclose(found.change, z, rtol=0, atol=1e-12)


@pytest.mark.parametrize("delta", [1.14, 2.0])
def test_beyond_a_fold_there_is_no_solution_to_be_found(delta: float) -> None:
    """The curve of Lotka-Volterra from the paper's state ends at Δ = 1.139 in y = (1, 1.9, 0.5)."""
    problem, y = problems.lotka_volterra(), np.array([1.0, 1.9, 0.5])
    with pytest.raises(StepFailure):
        continued(EP).step(problem, y, delta, np.array([0.0]))
    assert np.isfinite(continued(EP).step(problem, y, 1.139, np.array([0.0]))).all()


def test_ensembles_and_paths_count_what_was_continued() -> None:
    options = {"h": 1e-9, "y0": LONG[:, 1], "truncation": None}
    dW = np.repeat(STEPS[None, :, [1, 0, 1]], 2, axis=0)
    dW[1] *= 0.01
    plain = sepv.ensemble(EP, PENDULUM, dW=dW, steps=2, engine="numpy", **options)
    ends = sepv.ensemble(continued(EP), PENDULUM, dW=dW, steps=2, **options)
    assert (plain.status > 0).tolist() == [True, False, True]
    assert not ends.status.any()
    assert plain.continuations == 0 < ends.continuations
    assert ends.energy_defect.max() < 1e-13
    both = sepv.ensemble(divided(continued(EP)), PENDULUM, dW=dW, steps=2, **options)
    assert (both.continuations, both.divisions) == (ends.continuations, 0)
    path = sepv.integrate(continued(EP), PENDULUM, dW=dW[:, :, 0], steps=2, **options)
    assert path.continuations == ends.continuations / 2


def test_every_scheme_of_one_stage_takes_a_start_and_claims_nothing_when_continued() -> None:
    for scheme in (schemes.midpoint, schemes.discrete_gradient, schemes.both_invariants):
        step = problems.rigid_body(), np.asarray(problems.rigid_body().initial), 0.1, np.zeros(1)
        again = continued(scheme)
        assert not again.claims
        assert np.array_equal(again.step(*step), scheme.step(*step))
