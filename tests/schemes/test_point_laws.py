"""Increments of a few points: their law, the same bits from both engines, and what the laws about orders find."""

import math
from dataclasses import replace

import numpy as np
import pytest
from doors import verdicts
from sepv.properties._orders.gaussian import point_rule
from sepv.properties._orders.weak_trees import tree

import sepv
from sepv import problems, schemes
from sepv.errors import UsageError
from sepv.problem import Problem
from sepv.record import _polynomial as poly
from sepv.schemes import PointLaw, weakly
from sepv.schemes._point_distributions import THREE_POINT, TWO_POINT, point_law
from sepv.schemes._scheme import PATHWISE
from sepv.simulate import _truncation as bounded
from sepv.simulate import _wiener as wiener
from sepv.verification import Verdict

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
        # Five standard deviations: a false alarm of 6e-7 for each of the nine counts, were the seed not fixed.
        assert abs(count - weight * dW.size) < 5 * math.sqrt(dW.size * weight * (1 - weight))
    assert set(np.unique(taken)) == {value / 8 for value in law.values}


def test_thresholds_cut_off_the_weights_and_are_as_symmetric_as_the_law() -> None:
    assert TWO_POINT.thresholds == (0.0,)
    # Φ⁻¹(5/6) to 30 digits, from mpmath.
    assert THREE_POINT.thresholds == pytest.approx((-0.967421566101701, 0.967421566101701), abs=1e-15)
    for law in (THREE_POINT, FOUR_POINT):
        assert np.array_equal(law.thresholds, -np.array(law.thresholds)[::-1])


def _drifting() -> Problem:
    """dy = (1, 0)(dt + ΔW₁ + 0.5 ΔW₂): the end is the sum of the increments, in the order of the steps."""
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
    with pytest.raises(UsageError, match="weak order alone"):
        replace(schemes.midpoint, increments="two-point")
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
    finding = sepv.verify(scheme, laws="weak-order").finding("weak-order")
    assert finding.verdict is not Verdict.HOLDS
    assert "243 ends of a step are too many" in finding.message
