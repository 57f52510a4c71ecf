"""The Maxwell-Bloch equations, with one noise or with a Hamiltonian for each noise.

The system y1′ = y2, y2′ = y1y3, y3′ = −y1y2 is y′ = ∇C × ∇H with H = ½y1² + y3 and
C = ½(y2² + y3²), so that B(y)v = −v × ∇C(y): see D. David and D. Holm, Multiple Lie-Poisson
structures, reductions, and geometric phases for the Maxwell-Bloch travelling wave equations
(J. Nonlinear Sci. 2, 1992).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from sepv.problem import PolynomialSystem, Problem
from sepv.problems._common import flows
from sepv.problems._nambu_system import nambu_system
from sepv.problems._polynomial_system import started
from sepv.record import PolynomialMap, poly


def maxwell_bloch(noise: Sequence[float] = (0.5,)) -> Problem:
    """The Maxwell-Bloch equations of laser-matter dynamics for real fields,
    a polynomial system with two invariants.

    The initial state is (1, 0.5, 0.5).
    """
    H, C = poly.add(poly.squares((1, 0, 0)), poly.variable(3, 2)), poly.squares((0, 1, 1))
    data = nambu_system(H, poly.constant(3, -1.0), C, tuple(noise))
    return started(data, "maxwell-bloch", (1.0, 0.5, 0.5))


def random_maxwell_bloch(noise: Sequence[float] = (0.5,)) -> Problem:
    """The Maxwell-Bloch equations with a Hamiltonian for each noise;
    the fields of two such noises do not commute.

    The initial state is (1, 0.5, 0.5), and there are one or two noises. H_1 = ½y_1² and H_2 = y_3
    are the two parts of H_0, as in C.-E. Bréhier, D. Cohen and T. Jahnke (Math. Comp. 92, 2023).
    The flows of H_1 and H_2 are linear.
    """
    base = maxwell_bloch()
    assert isinstance(base.data, PolynomialSystem)
    halves = (poly.squares((1, 0, 0)), poly.variable(3, 2))
    parts = halves[: len(tuple(noise))]
    # The Casimir 2C = y2² + y3² as a matrix.
    casimir = ((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    data = replace(base.data, noise=tuple(noise), nambu=None, casimirs=(casimir,), noise_hamiltonians=parts)
    half_flows = flows(3, base.structure, [PolynomialMap((), (p,)) for p in halves])
    y0 = (1.0, 0.5, 0.5)
    return started(data, "random-maxwell-bloch", y0, flows=half_flows, noise_flows=half_flows[: len(parts)])
