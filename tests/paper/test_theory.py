"""The panels about §2, §3 and the remarks: verdicts that the theory gives, on small samples."""

import random
from fractions import Fraction
from itertools import combinations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import gamma, ndtr

from sepv import exact_flow, problems
from sepv.exact._dense_flow import FlowFailure
from sepv.paper import deterministic, extensions, lemma, local, remarks
from sepv.paper.several_with_areas import step_with_areas
from sepv.problem import Problem, derivative_along, vector_field
from sepv.problems._common import structure
from sepv.schemes import energy_preserving
from sepv.simulate import _wiener as wiener
from sepv.simulate import ensemble, truncation_bound

SOURCES = {"§2", "Lemma 3.2", "(3.2)", "(3.5)", "(3.6)", "after (3.5)", "(3.8)", "(3.9)",
           "Lemma 2.1 of [16], as (3.8) and (3.9)", "proof of Theorem 3.3"}  # fmt: skip


@pytest.mark.parametrize("section", [deterministic, lemma, local], ids=lambda m: m.__name__.split(".")[-1])
def test_statements_that_need_no_sampling_hold(section) -> None:
    results = {job.key: job.function(**job.arguments) for job in section.jobs(None)}
    statements = [s for panel in section.panels(results) for s in panel.statements]
    assert statements
    assert {s.source for s in statements} <= SOURCES
    assert not [s.measured for s in statements if s.verdict != "holds"]


def test_a_wrong_coefficient_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    right = lemma.coefficients
    monkeypatch.setattr(lemma, "coefficients", lambda problem, y: [1.01 * c for c in right(problem, y)])
    panel = lemma.panels({("theory", "lemma", name): lemma.measured(name) for name in lemma.LEMMA_PROBLEMS})[
        0
    ]
    wrong = {
        source: [s.verdict for s in panel.statements if s.source == source]
        for source in ("Lemma 3.2", "(3.5)", "(3.6)")
    }
    assert wrong["Lemma 3.2"] == wrong["(3.5)"] == ["fails"] * len(lemma.LEMMA_PROBLEMS)
    assert wrong["(3.6)"] == ["holds", "fails", "fails"]  # the rigid body's H is quadratic: c = c̃


def test_the_discrete_gradient_has_order_one_on_the_rigid_body_without_noise() -> None:
    errors = np.array(deterministic.errors("discrete-gradient", "rigid-body"))
    assert abs(np.log2(errors[-2] / errors[-1]) - 1) < 0.05


def test_the_casimir_of_lotka_volterra_falls_in_proportion_to_time() -> None:
    found = remarks.casimir_loss(2.0**-7, 1024, 16, 0, "auto")
    means = dict(zip(found["t"], found["mean"], strict=True))
    assert found["T"] == 8.0
    assert -0.2 < means[8.0] < 3 * means[1.0] < 0
    assert not found["failed"]


def test_a_short_run_does_not_refute_and_does_not_confirm_the_rectangle() -> None:
    found = remarks.casimir_loss(2.0**-8, 256, 8, 0, "auto")
    panel = remarks._lost({("theory", "lost", str(h)): found for h in remarks.LOST_H})
    assert panel.statements[0].verdict == "open"


def test_the_sublinear_problem_is_what_the_remark_says() -> None:
    """H and f are not bounded, f grows less than |y|, and f′ is bounded."""
    problem = remarks.sublinear()
    far = 10.0 ** np.arange(2, 13, 2) * np.array([[1.0], [-1.0]])
    speed = np.linalg.norm(vector_field(problem, far), axis=0)
    assert np.all(np.diff(speed) > 9 * speed[:-1] * 0.9)
    assert np.all(np.diff(speed / np.linalg.norm(far, axis=0)) < 0)
    assert problem.hamiltonian(far[:, -1]) > 1e12
    assert np.max(np.abs(problem.hessian(np.linspace(-100, 100, 2001) * np.ones((2, 1))))) <= 1.5
    y0, y1 = np.array([0.5, 1.0]), np.array([0.5 + 1e-9, -3.0])
    gap = problem.hamiltonian(y1) - problem.hamiltonian(y0)
    assert problem.mean_gradient(y0, y1) @ (y1 - y0) == pytest.approx(gap, rel=1e-14)


def test_lotka_volterra_fails_at_large_steps_whether_truncated_or_not() -> None:
    shares = [remarks.failing("lotka-volterra", truncated, 48, 0, "numpy") for truncated in (True, False)]
    assert min(shares[0][0], shares[1][0]) > 0.1
    assert remarks.failing("harmonic-oscillator", False, 48, 0, "numpy") == [0.0] * len(remarks.CLIP_STEPS)
    assert problems.by_name("harmonic-oscillator").noises == 1


def test_areas_keep_the_energy_whatever_they_are_and_bring_order_one() -> None:
    found = extensions.errors(64, 0)
    panel = extensions._areas(found)
    assert panel.statements[0].verdict == "holds", panel.statements[0].measured
    problem = problems.by_name(extensions.TOPS_PROBLEM)
    y = np.array(problem.initial)
    wild = np.array([[0.0, 0.3], [-0.3, 0.0]])
    y1 = step_with_areas(problem, y, 0.1, np.array([0.2, -0.1]), wild)
    assert abs(problem.hamiltonian(y1) - problem.hamiltonian(y)) < 1e-15
    # A wrong sign of the areas leaves the order at one half.
    start, fine = y, wiener.increments(0, T=0.5, steps=1024, noises=2, paths=range(32))
    exact = extensions.heun(problem, start, 0.5, fine)
    off = []
    for sign in (1.0, -1.0):
        z = np.repeat(start[:, None], 32, axis=1)
        for dW, A in zip(wiener.coarsen(fine, 32), extensions.areas(fine, 32), strict=True):
            z = step_with_areas(problem, z, 0.5 / 32, dW, sign * A)
        off.append(np.sqrt(np.mean((z - exact) ** 2)))
    assert off[1] > 4 * off[0]


def test_stages_raise_the_order_where_flows_commute() -> None:
    errors = extensions.staged(2, 12, 0)
    assert errors[0] / errors[-1] > 8**1.5


def test_paths_stay_in_the_sets_of_remark_3_5_and_a_smaller_set_shows() -> None:
    for name in ("pendulum", "rigid-body"):
        found = remarks.furthest(name, 0, "numpy")
        beyond = {k: 1.01 * v / max(found.values()) for k, v in found.items()}
        assert [remarks._in_the_set(name, at).verdict for at in (found, beyond)] == ["holds", "fails"]


def test_one_step_with_a_hamiltonian_that_is_not_bounded_has_the_slopes_of_order_one() -> None:
    mean, rms = remarks.sublinear_step()
    assert abs(mean - 2) < 0.1
    assert abs(rms - 1.5) < 0.1


Poly = dict[tuple[int, ...], Fraction]
# Series in Δ up to Δ³ are object arrays of four rational numbers.
ONE = np.array([Fraction(1), *[Fraction(0)] * 3])


def _random_polynomial(rng: random.Random, degree: int, terms: int = 8) -> Poly:
    exponents = [[rng.randrange(3) for _ in range(degree)] for _ in range(terms)]
    return {
        tuple(e.count(i) for i in range(3)): Fraction(rng.randint(-5, 5), rng.randint(1, 4))
        for e in exponents
    }


def _derivative(p: Poly, i: int) -> Poly:
    return {(*e[:i], e[i] - 1, *e[i + 1 :]): v * e[i] for e, v in p.items() if e[i]}


def _at(p: Poly, y: np.ndarray) -> np.ndarray:
    """The polynomial at a state (3, 4) whose components are series in Δ."""
    total = 0 * ONE
    for exponents, value in p.items():
        term = value * ONE
        for component in np.repeat(y, exponents, axis=0):
            term = np.convolve(term, component)[:4]
        total = total + term
    return total


def _third(B: list[list[Poly]], g: list[Poly], y: np.ndarray, nodes: dict[Fraction, Fraction]) -> np.ndarray:
    """The coefficient of Δ³ of z = ΔB(y + z/2) Σ w g(y + τz), by iteration from z = 0."""
    z = 0 * y
    for _ in range(3):
        middle = y + z / 2
        mean = [sum(w * _at(p, y + tau * z) for tau, w in nodes.items()) for p in g]
        field = [sum(np.convolve(_at(p, middle), m)[:4] for p, m in zip(row, mean, strict=True)) for row in B]
        z = np.array([[Fraction(0), *f[:3]] for f in field])
    return z[:, 3]


def test_the_coefficients_of_both_schemes_differ_by_a_24th_of_the_curvature_of_the_gradient_exactly() -> None:
    """c − c̃ = (1/24) B g″(f, f) in rational arithmetic,
    for random H and skew B in three variables.

    Up to Δ³ the average over τ sees g up to second order, for which Simpson's rule is exact.
    """
    half = Fraction(1, 2)
    simpson = {Fraction(0): Fraction(1, 6), half: Fraction(2, 3), Fraction(1): Fraction(1, 6)}
    for seed in range(6):
        rng = random.Random(seed)
        H = {e: v for degree in (4, 3, 2) for e, v in _random_polynomial(rng, degree).items()}
        g = [_derivative(H, i) for i in range(3)]
        upper = {
            p: _random_polynomial(rng, 2, 4) | _random_polynomial(rng, 1, 3)
            for p in combinations(range(3), 2)
        }
        lower = {(j, i): {e: -v for e, v in p.items()} for (i, j), p in upper.items()}
        B = [[(upper | lower).get((i, j), {}) for j in range(3)] for i in range(3)]
        y = np.array([Fraction(rng.randint(-6, 6), 7) * ONE for _ in range(3)])
        values = np.array([[_at(p, y)[0] for p in row] for row in B])
        f = values @ [_at(p, y)[0] for p in g]
        curvature = [
            [[_at(_derivative(_derivative(p, j), k), y)[0] for k in range(3)] for j in range(3)] for p in g
        ]
        expected = values @ (np.array(curvature) @ f @ f) / 24
        gap = _third(B, g, y, simpson) - _third(B, g, y, {half: Fraction(1)})
        assert np.array_equal(gap, expected)
        assert expected.any()


def test_the_coefficients_are_bounded_along_paths_by_a_constant_that_does_not_depend_on_h() -> None:
    """Remark 3.3: sup |a|, |b|, |c| along paths of (2.1) are those of the exact orbit,
    on which the paths lie.
    """
    for name, period in (("pendulum", 6.73), ("rigid-body", 20.0)):
        problem = problems.by_name(name)

        def sizes(y: np.ndarray, problem=problem) -> np.ndarray:
            a = vector_field(problem, y)
            parts = (a, 0.5 * derivative_along(problem, y, a), lemma.coefficients(problem, y)[0])
            return np.array([np.max(np.linalg.norm(part, axis=0)) for part in parts])

        bound = sizes(exact_flow(problem, np.linspace(0, period, 4000)).y)
        for h in (2.0**-2, 2.0**-4, 2.0**-6):
            times = h * np.arange(1, round(8 / h) + 1)
            found = ensemble("energy-preserving", problem, h=h, T=8.0, paths=16, times=times, engine="numpy")
            seen = sizes(found.states.reshape(problem.dimension, -1))
            # 4000 points of the orbit miss a maximum by their square.
            assert np.all(seen <= bound * (1 + 1e-4))
            assert np.all(seen > 0.9 * bound)


def test_with_bounded_derivatives_alone_the_coefficients_have_no_such_bound() -> None:
    """Remark 3.3 needs B and ∇H bounded themselves: B = y1 J⁻¹, H = −y2 has f = (y1, 0),
    and a = y1 grows along steps.

    (2.1) multiplies y1 by (1 + Δ/2)/(1 − Δ/2). The largest of N = 1/h steps with the largest
    increment of k = 2.
    """
    B, H = (lambda y: y[0] * structure(y)), (lambda y: -y[1])
    problem = Problem(2, B, H, noise=(1.0,), initial=(1.0, 0.0))
    largest = []
    for h in (2.0**-4, 2.0**-5, 2.0**-6):
        dW = np.full((1,), np.sqrt(h) * truncation_bound(h, 2))
        y = np.array(problem.initial)
        for _ in range(round(1 / h)):
            y = energy_preserving.step(problem, y, h, dW)
        largest.append(y[0])
    assert largest[0] > 1e6
    assert np.all(np.diff(np.log(largest)) > 0.25 * np.log(largest[:-1]))


def test_for_large_steps_the_scheme_has_several_solutions_and_for_small_ones_a_single_one() -> None:
    """The pendulum from (p, q) = (0, π): δ = q1 − q0 solves δ = ±Δ sin(δ/2), and p1 = 2δ/Δ.

    Δ = 2.2 is within reach of Remark 2.1 for h = ½ < 1 with the noises of §4.3. Each solution
    keeps H.
    """
    problem = problems.pendulum()
    h = 0.5
    assert h + sum(problem.c) * np.sqrt(h) * truncation_bound(h, 2) > 2.2
    y0 = np.array([0.0, np.pi])

    def solutions(step: float) -> list[np.ndarray]:
        def gap(move: float) -> float:
            y1 = np.array([2 * move / step, np.pi + move])
            return float(2 * move / step - step * (problem.structure(y0) @ problem.mean_gradient(y0, y1))[0])

        grid = np.linspace(-3.001, 3, 400)
        signs = np.sign([gap(move) for move in grid])
        moves = [brentq(gap, grid[n], grid[n + 1], xtol=1e-15) for n in np.flatnonzero(np.diff(signs))]
        return [np.array([2 * move / step, np.pi + move]) for move in moves]

    assert len(solutions(1.9)) == 1
    found = solutions(2.2)
    assert len(found) == 3
    for y1 in found:
        right = 2.2 * problem.structure(0.5 * (y0 + y1)) @ problem.mean_gradient(y0, y1)
        assert np.allclose(y1 - y0, right, atol=1e-13)
        assert abs(problem.hamiltonian(y1) - problem.hamiltonian(y0)) < 1e-14


def test_a_solution_exists_for_all_time_only_where_the_flow_does_in_both_directions() -> None:
    """(1.1): θ = t + cW reaches −x with probability e^(−2x/c²). H = pq² has q = q0/(1 − q0θ): for
    q0 = −1 the flow exists for all θ > −1, and the solution with probability 1 − e⁻² for c = 1
    only.
    """  # fmt: skip
    problem = Problem(
        dimension=2, structure=structure, hamiltonian=lambda y: y[0] * y[1] ** 2,
        noise=(1.0,), initial=(1.0, -1.0),
    )  # fmt: skip
    theta = np.array([-0.99, 0.0, 10.0, 1000.0])
    assert np.allclose(exact_flow(problem, theta).y[1], -1 / (1 + theta), rtol=1e-10)
    with pytest.raises(FlowFailure):
        exact_flow(problem, -1.01)


@pytest.mark.parametrize("p", [1.0, 1.5, 2.5, 6.0, 12.0])
def test_lemma_3_1_holds_for_any_p_with_the_constant_of_the_normal_law(p: float) -> None:
    """(E|ΔŴ|^p)^{1/p} ≤ C_p h^½, C_p = √2 (Γ((p + 1)/2)/√π)^{1/p}, with equality for ΔW; k = 2,
    h < 1.
    """
    constant = np.sqrt(2) * (gamma((p + 1) / 2) / np.sqrt(np.pi)) ** (1 / p)
    for h in (0.9, 0.5, 2.0**-6, 2.0**-12):
        for A in (truncation_bound(h, 2), 40.0):
            density = lambda x: 2 * x**p * np.exp(-x * x / 2) / np.sqrt(2 * np.pi)  # noqa: E731
            inside, _ = quad(density, 0, A, epsabs=0, epsrel=1e-12, limit=200)
            size = (inside + 2 * A**p * ndtr(-A)) ** (1 / p) * np.sqrt(h)
            assert size <= constant * np.sqrt(h) * (1 + 1e-11)
            assert A < 40 or size == pytest.approx(constant * np.sqrt(h), rel=1e-10)
