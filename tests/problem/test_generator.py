"""The generator's series of moments, exactly: against quadrature of solutions that are known, and by hand."""

from fractions import Fraction

import numpy as np
import pytest
from sepv.properties._orders.gaussian import rule
from sepv.reference.generator import is_linear, moments

from sepv import problems
from sepv.problem import PolynomialSystem, Problem


def data_of(problem: Problem) -> PolynomialSystem:
    assert isinstance(problem.data, PolynomialSystem)
    return problem.data


def test_one_rotation_with_noise_is_damped_in_the_mean() -> None:
    """H = ½|y|², B = J⁻¹, c = 1: E y(h) = e^(−h/2) R(h) y0, whose series begins with 1, J⁻¹ − ½."""
    from sepv.record import _polynomial as poly

    H = poly.polynomial(2, {(2, 0): 0.5, (0, 2): 0.5})
    system = PolynomialSystem(2, H, ((0, 1, poly.constant(2, 1.0)),), (1.0,))
    first, second = moments(system, (1.0, 2.0), ((1, 0), (0, 1)), 2)
    assert is_linear(system)
    assert first[:2] == [0, Fraction(2) - Fraction(1, 2)]
    assert second[:2] == [0, Fraction(-1) - 1]
    # (J⁻¹ − ½)²/2 = (¼ − 1 − J⁻¹)/2
    assert first[2] == (Fraction(-3, 4) * 1 - 2) / 2
    assert second[2] == (Fraction(-3, 4) * 2 + 1) / 2


@pytest.mark.parametrize("make", [problems.commuting_rotations, problems.commuting_oscillators])
def test_series_and_quadrature_of_the_closed_form_agree(make: type) -> None:
    """Two terms and a remainder of O(h³), at two h: the ratio of what is left is 8."""
    problem = make()
    assert not is_linear(data_of(problem))
    y0, alphas = np.asarray(problem.initial), ((1, 0, 0, 0), (0, 0, 1, 0), (2, 0, 0, 0), (0, 1, 1, 0))
    series = np.array(moments(data_of(problem), tuple(y0.tolist()), alphas, 2), dtype=np.float64)
    left = []
    for h in (2.0**-10, 2.0**-11):
        nodes = rule(2, h, None, 10)
        x = problem.closed_form(y0, h, np.sqrt(h) * nodes.xi) - y0[:, None]
        mean = np.array([np.prod(x ** np.array(a)[:, None], axis=0) @ nodes.weights for a in alphas])
        left.append(mean - series @ h ** np.arange(3.0))
    assert np.abs(left[0]).max() < 1e-6
    assert left[0] / left[1] == pytest.approx(np.full(4, 8.0), rel=0.05)
