"""What steps ask for beside increments: Lévy's and space-time areas,
and increments of a few points with their law.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from doors import finding, verdicts
from sepv.properties._orders.gaussian import point_rule, rule_for
from sepv.properties._orders.weak_trees import tree

import sepv
from benchmarks.peers.solver import problem_of
from sepv import Effort, UsageError, Verdict, problems, schemes, verify
from sepv.problem import Array, Problem, Systems, matvec, noise_field
from sepv.record import _polynomial as poly
from sepv.schemes import Orders, PointLaw, Scheme, weakly
from sepv.schemes._claims import PATHWISE
from sepv.schemes._further_increments import as_matrix, as_rows, rows_of_any_path
from sepv.schemes._point_distributions import THREE_POINT, TWO_POINT, point_law
from sepv.simulate import _areas as areas
from sepv.simulate import _truncation as bounded
from sepv.simulate import _wiener as wiener

LOCAL = ["local-mean", "local-mean-square", "local-weak"]


def shark(sign: float = 1.0) -> Scheme:
    """ShARK for additive noise: J. Foster, G. dos Reis and C. Strange, arXiv 2210.17543,
    equation (6.1).
    """

    def step(problem: Problem, y: Array, h: float, dW: Array, H: Array) -> Array:
        def f(z: Array) -> Array:
            return matvec(problem.structure(z), problem.gradient(z))

        def noise(w: Array) -> Array:
            return sum((c * w[j] * noise_field(problem, j, y) for j, c in enumerate(problem.c)), 0.0 * y)

        start = y + sign * noise(H)
        first = f(start)
        second = f(start + 5 / 6 * (h * first + noise(dW)))
        return y + noise(dW) + h * (0.4 * first + 0.6 * second)

    return Scheme(
        "shark", step, mean_square_order=Orders(1.5), weak_order=2.0, systems=Systems.HAMILTONIANS, asks="space-time",
        truncation=None, batched=True, problems=(problem_of("additive"),),
    )  # fmt: skip


def near(samples: Array, expected: float) -> bool:
    """True where a mean is within 6 standard errors: eleven statements here,
    false alarm below 1e-7.
    """
    return bool(abs(samples.mean() - expected) < 6 * samples.std() / np.sqrt(samples.size))


def test_they_have_their_law_and_are_independent_of_the_increments() -> None:
    h, path = 0.25, areas.drawn(3, T=1.0, steps=4, noises=2, paths=20_000)
    H, dW, A = path.bridges[1], path.dW[1], path.areas[1, 0]
    assert near(H[0] ** 2, h / 12)
    assert near(H[0] * dW[0], 0.0)
    assert near(H[0] * H[1], 0.0)
    assert near(A * H[0] * dW[1], h * h / 12)


def test_over_coarse_steps_they_are_those_of_the_path() -> None:
    path = areas.drawn(5, T=2.0, steps=24, noises=1, paths=3)
    K, h = 6, 6 * path.h
    W = np.concatenate([np.zeros((1, 1, 3)), np.cumsum(path.dW, axis=0)])
    # ∫W ds over each fine step is δ(W_k + ½ΔW_k + H_k).
    areas_below = path.h * (W[:-1] + 0.5 * path.dW + path.bridges)
    for n in range(4):
        part = slice(K * n, K * (n + 1))
        whole = areas_below[part].sum(axis=0) - h * W[K * n]
        expected = whole / h - 0.5 * (W[K * (n + 1)] - W[K * n])
        assert np.allclose(path.coarse(4).bridges[n], expected, atol=1e-14)
    assert np.allclose(path.coarse(8).coarse(2).bridges, path.coarse(2).bridges, atol=1e-14)
    assert path.rows(4, "space-time").shape == (4, 2, 3)


def test_the_rule_has_their_moments_with_and_without_areas() -> None:
    for kind in ("additive", "general"):
        nodes = rule_for(shark(), problem_of(kind), 0.25, 6)
        assert nodes.bridges is not None
        w, H, x = nodes.weights, nodes.bridges, nodes.xi
        assert np.allclose(H @ w, 0)
        assert np.allclose((H * w) @ H.T, np.eye(2) / 12)
        assert np.allclose((H * w) @ x.T, 0)
        known = x if nodes.zeta.shape == x.shape else np.concatenate([x, H])[:, nodes.index]
        assert np.allclose(nodes.zeta, known)
    # The areas of the last one are made of the same B_i: E[A_12 H_1 ΔW_2] = h²/12.
    assert nodes.areas is not None
    assert np.isclose(np.sum(w * nodes.areas[0] * H[0] * x[1]), 1 / 12)


def test_order_three_halves_of_additive_noise_is_seen_and_missed() -> None:
    report = verify(shark(), laws=LOCAL, effort=Effort())
    slopes = {f.law: (f.witness or {})["measured"][0]["slope"] for f in report.findings}
    assert all(f.verdict is Verdict.HOLDS for f in report.findings), [f.message for f in report.findings]
    assert slopes["local-mean-square"] == pytest.approx(2.0, abs=0.15)
    # With −H the means are right, and the order of paths is 1.
    wrong = verify(shark(-1.0), laws=LOCAL, effort=Effort())
    assert wrong.finding("local-mean-square").verdict is Verdict.VIOLATED
    assert wrong.finding("local-weak").verdict is Verdict.HOLDS


# Areas of two noises.


def test_areas_have_the_moments_of_levys() -> None:
    whole = areas.drawn(1, T=1.0, steps=16, noises=3, paths=20_000).coarse(1)
    A, W = whole.areas[0], whole.dW[0]
    assert near(A[0], 0.0)
    assert near(A[0] ** 2, 1 / 4)
    # E[A² | ΔW] = 1/12 + (ΔW_1² + ΔW_2²)/12, against a function of ΔW that is not constant.
    g = W[0] ** 2
    assert near(g * (A[0] ** 2 - 1 / 12 - (W[0] ** 2 + W[1] ** 2) / 12), 0.0)
    assert near(A[0] * W[2], 0.0)
    assert near(A[0] * A[1], 0.0)
    # A_12 and A_13 given ΔW: ΔW_2 ΔW_3/12.
    assert near(A[0] * A[1] * W[1] * W[2] - (W[1] * W[2]) ** 2 / 12, 0.0)
    # P. Lévy: E A⁴ = 5/16.
    assert near(A[0] ** 4, 5 / 16)


def test_areas_add_up_by_chens_relation() -> None:
    path = areas.drawn(2, T=1.0, steps=24, noises=3, paths=3)
    assert np.allclose(path.coarse(6).coarse(2).areas, path.coarse(2).areas, atol=1e-14)
    a, b = path.coarse(2).dW
    before, after = path.coarse(2).areas
    joined = before + after + 0.5 * np.stack([a[i] * b[j] - a[j] * b[i] for i, j in ((0, 1), (0, 2), (1, 2))])
    assert np.allclose(path.coarse(1).areas[0], joined, atol=1e-14)
    halves = path.rows(3, "halves")
    assert np.allclose(halves[:, 3:], path.coarse(6).dW[::2])
    with pytest.raises(UsageError, match="finer"):
        path.rows(24, "halves")


def test_the_rule_for_areas_has_their_second_moments() -> None:
    problem = problems.random_inertia()
    nodes = rule_for(schemes.area_midpoint, problem, 0.25, 4)
    assert nodes.areas is not None
    w, (A,), (x, _) = nodes.weights, nodes.areas, nodes.xi
    assert w.sum() == pytest.approx(1)
    assert w @ A == pytest.approx(0, abs=1e-14)
    assert w @ A**2 == pytest.approx(1 / 4)
    assert w @ (x * x * A**2) == pytest.approx(1 / 12 + (3 + 1) / 12)
    assert w @ (x * A) == pytest.approx(0, abs=1e-14)
    # A = √h · row.
    assert np.allclose(nodes.zeta[2], 0.5 * A)


def test_what_a_step_asks_for_reverses_with_the_path_and_moves_with_the_noises() -> None:
    dW = np.array([0.3, -0.2, 0.5])
    A = as_matrix(rows_of_any_path("areas", 0.25, dW), 3)
    back = as_matrix(rows_of_any_path("areas", -0.25, -dW), 3)
    assert np.array_equal(back, -A)
    order = [2, 0, 1]
    assert np.allclose(as_matrix(rows_of_any_path("areas", 0.25, dW[order]), 3), A[np.ix_(order, order)])
    assert np.array_equal(as_matrix(as_rows(A), 3), A)
    first = rows_of_any_path("halves", 0.25, dW)
    assert np.allclose(rows_of_any_path("halves", -0.25, -dW), -(dW - first))
    H = rows_of_any_path("space-time", 0.25, dW)
    assert np.allclose(rows_of_any_path("space-time", -0.25, -dW), H)
    assert np.allclose(rows_of_any_path("space-time", 0.25, dW[order]), H[order])


def test_areas_are_drawn_with_their_law_or_not_at_all() -> None:
    path = sepv.integrate("area-midpoint", "random-inertia", h=0.125, T=1.0, seed=3)
    assert path.dW.shape == (8, 3)
    again = sepv.integrate("area-midpoint", "random-inertia", h=0.125, T=1.0, dW=path.dW)
    assert np.array_equal(path.y, again.y)
    with pytest.raises(UsageError, match=r"dW of shape \(8, 3\)"):
        sepv.integrate("area-midpoint", "random-inertia", h=0.125, T=1.0, dW=path.dW[:, :2])


# Gauss-Hermite quadrature with four points: moments up to 7, enough for weak order 3.
_INNER, _OUTER = math.sqrt(3 - math.sqrt(6)), math.sqrt(3 + math.sqrt(6))
_RARE, _OFTEN = (3 - math.sqrt(6)) / 12, (3 + math.sqrt(6)) / 12
FOUR_POINT = PointLaw("four-point", (-_OUTER, -_INNER, _INNER, _OUTER), (_RARE, _OFTEN, _OFTEN, _RARE))
WEAK = ("local-weak", "weak-order")


@pytest.mark.parametrize(("law", "degree"), [(TWO_POINT, 3), (THREE_POINT, 5), (FOUR_POINT, 7)])
def test_moments_are_those_of_a_normal_number_up_to_twice_the_weak_order_plus_one(law, degree):
    assert law.degree == degree
    for noises in (1, 2, 3):
        points = point_rule(noises, law)
        normal = np.polynomial.hermite_e.hermegauss(8)
        for power in range(degree + 1):
            expected = normal[1] @ normal[0] ** power / normal[1].sum()
            # So too along any direction, which mixes the noises.
            direction = np.arange(1.0, noises + 1) / np.linalg.norm(np.arange(1.0, noises + 1))
            assert (direction @ points.xi) ** power @ points.weights == pytest.approx(expected, abs=1e-13)


@pytest.mark.parametrize("law", [TWO_POINT, THREE_POINT, FOUR_POINT], ids=lambda law: law.name)
def test_each_value_is_taken_with_its_probability(law: PointLaw) -> None:
    dW = wiener.increments(3, T=1.0, steps=64, noises=2, paths=4096)
    taken = bounded.seen(dW, 1 / 64, None, law)
    for value, weight in zip(law.values, law.weights, strict=True):
        count = int(np.count_nonzero(taken == value / 8))
        # Five standard deviations: a false alarm of 6e-7 for each of the nine counts, were the seed
        # not fixed.
        assert abs(count - weight * dW.size) < 5 * math.sqrt(dW.size * weight * (1 - weight))
    assert set(np.unique(taken)) == {value / 8 for value in law.values}


def test_thresholds_cut_off_the_weights_and_are_as_symmetric_as_the_law() -> None:
    assert TWO_POINT.thresholds == (0.0,)
    # Φ⁻¹(5/6) to 30 digits, from mpmath.
    assert THREE_POINT.thresholds == pytest.approx((-0.967421566101701, 0.967421566101701), abs=1e-15)
    for law in (THREE_POINT, FOUR_POINT):
        assert np.array_equal(law.thresholds, -np.array(law.thresholds)[::-1])


def _drifting() -> Problem:
    """dy = (1, 0)(dt + ΔW₁ + 0.5 ΔW₂): the end is the sum of the increments,
    in the order of the steps.
    """
    linear = poly.polynomial(2, {(0, 1): 1.0})
    B = ((0, 1, poly.polynomial(2, {(0, 0): 1.0})),)
    system = sepv.PolynomialSystem(2, linear, B, (1.0, 0.5), ())
    return replace(problems.polynomial_problem(system), initial=(0.0, 0.0))


@pytest.mark.parametrize(
    "increments", ["two-point", "three-point", FOUR_POINT], ids=lambda law: getattr(law, "name", law)
)
def test_both_engines_and_one_path_take_the_same_bits(increments: str | PointLaw) -> None:
    run = {"h": 2.0**-6, "steps": 96, "seed": 5, "increments": increments}
    plain = sepv.ensemble("euler-maruyama", _drifting(), paths=300, engine="numpy", **run)
    path = sepv.integrate("euler-maruyama", _drifting(), **run)
    assert np.array_equal(path.y[:, -1], plain.y[:, 0])
    law = point_law(increments)
    assert law is not None
    assert set(np.unique(path.dW)) == {v / 8 for v in law.values}
    pytest.importorskip("numba")
    compiled = sepv.ensemble("euler-heun", "pendulum", paths=300, engine="compiled", **run)
    numpy = sepv.ensemble("euler-heun", "pendulum", paths=300, engine="numpy", **run)
    assert np.array_equal(compiled.W, numpy.W)
    # Another increment of one step would move y by 0.1; what is left is the rounding of 96 steps.
    assert np.max(np.abs(compiled.y - numpy.y)) < 1e-13
    given = wiener.increments(5, T=1.5, steps=96, noises=2, paths=300)
    how = {"h": 2.0**-6, "dW": given, "steps": 96, "increments": law, "engine": "compiled"}
    again = sepv.ensemble("euler-heun", "pendulum", **how)
    assert np.array_equal(again.y, compiled.y)


def test_a_store_of_other_increments_is_refused(tmp_path: object) -> None:
    pytest.importorskip("zarr")
    run = {"h": 0.125, "steps": 8, "paths": 16, "store": f"{tmp_path}/paths.zarr", "engine": "numpy"}
    sepv.ensemble("midpoint", "pendulum", increments="two-point", **run)
    with pytest.raises(UsageError):
        sepv.ensemble("midpoint", "pendulum", increments="three-point", **run)


def test_increments_of_a_few_points_need_no_truncation_and_have_no_paths() -> None:
    scheme = weakly(schemes.energy_preserving, "two_point")
    assert (scheme.increments, scheme.truncation, scheme.mean_square_order) == (TWO_POINT, None, None)
    assert not PATHWISE & set(scheme.claims)
    report = sepv.verify(scheme, laws=[*PATHWISE, "truncation"])
    assert {f.verdict for f in report.findings} == {Verdict.NOT_APPLICABLE}
    assert report.to_json()["scheme"]["increments"] == "two-point"
    with pytest.raises(UsageError, match="bounded already, by 1 √h"):
        sepv.integrate(scheme, "pendulum", h=0.125, T=1.0, truncation=2)
    assert weakly(scheme, "normal").increments is None


@pytest.mark.parametrize(
    ("name", "increments", "order", "verdict"),
    [
        ("energy-preserving", "two-point", 1.0, "holds"),
        ("euler-maruyama", "two-point", 1.0, "holds"),
        ("several-structures", "two-point", 1.0, "holds"),
        ("modified-weak-2", "three-point", 2.0, "holds"),
        ("collocation-2", "three-point", 2.0, "holds"),
        ("collocation-3", FOUR_POINT, 3.0, "holds"),
        ("modified-weak-2", "two-point", 2.0, "violated"),
        ("energy-preserving", "three-point", 2.0, "violated"),
    ],
    ids=lambda value: getattr(value, "name", str(value)),
)
def test_right_schemes_hold_their_weak_orders_and_others_do_not(name, increments, order, verdict):
    scheme = replace(weakly(schemes.by_name(name), increments), weak_order=order)
    assert verdicts(scheme, WEAK) == dict.fromkeys(WEAK, verdict)


def test_a_tree_has_every_path_once_with_its_probability() -> None:
    scheme = weakly(schemes.euler_maruyama, "three-point")
    found = tree(scheme, _drifting(), np.zeros(2), 0.25, 2, THREE_POINT)
    y, weights, failed = found
    assert failed == ""
    assert weights.sum() == pytest.approx(1.0, abs=1e-14)
    assert y.shape == (2, 81)
    # The end is T plus a sum of mean 0 and variance |c|²T, T = ½.
    assert y[0] @ weights == pytest.approx(0.5, abs=1e-14)
    assert (y[0] - 0.5) ** 2 @ weights == pytest.approx(1.25 * 0.5, abs=1e-14)


def test_too_many_noises_are_said_and_not_summed() -> None:
    problem = problems.pendulum(noise=(0.5, 0.25, 0.125, 0.25, 0.5))
    scheme = replace(weakly(schemes.midpoint, "three-point"), problems=(problem,))
    found = finding(scheme, "weak-order")
    assert found.verdict is not Verdict.HOLDS
    assert "243 ends of a step are too many" in found.message
