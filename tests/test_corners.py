"""The cases that no seed may miss: each is solved by each scheme, and together they have what laws ask for."""

from __future__ import annotations

import numpy as np
import pytest

from sepv import problems, schemes
from sepv.corners import corners, with_casimirs, with_constant_structure, with_quadratic_hamiltonian
from sepv.problem import PolynomialSystem
from sepv.strategies import contraction_radius


@pytest.mark.parametrize("name", schemes.ALL)
def test_every_scheme_solves_every_corner(name: str) -> None:
    for case in corners():
        assert np.isfinite(schemes.ALL[name].step(*case.build())).all(), case.describe()


def test_polynomial_corners_lie_inside_the_contraction_radius() -> None:
    inside = [c for c in corners() if isinstance(c.problem, PolynomialSystem)]
    assert len(inside) >= 8
    for case in inside:
        problem, y, h, dW = case.build()
        assert h + float(np.sum(np.abs(problem.c * dW))) <= contraction_radius(problem, y)


def test_each_law_finds_what_it_speaks_of() -> None:
    degrees = {problems.build(c.problem).degree for c in corners()}
    assert {2, 5, 6, None} <= degrees
    assert {float(np.sign(c.h + np.dot(problems.build(c.problem).c, c.dW))) for c in corners()} == {1.0, -1.0}
    assert all(len(problems.build(c.problem).casimirs) for c in with_casimirs())
    assert {getattr(c.problem, "name", "") for c in with_quadratic_hamiltonian()} == {
        "harmonic-oscillator",
        "rigid-body",
    }
    assert {getattr(c.problem, "name", "") for c in with_constant_structure()} == {
        "",
        "harmonic-oscillator",
        "pendulum",
    }
