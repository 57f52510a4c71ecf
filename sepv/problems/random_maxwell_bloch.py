"""Maxwell-Bloch with a Hamiltonian of its own for the noise, and with two whose fields do not commute.

B and H_0 = ½y_1² + y_3 are those of `sepv.problems.maxwell_bloch`, H_1 = ½y_1² and H_2 = y_3 its two parts, one for
each noise: C.-E. Bréhier, D. Cohen and T. Jahnke (Math. Comp. 92, 2023) disturb the system in this way. Their flows are
linear.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sepv import polynomial as poly
from sepv.hamiltonians import HamiltoniansProblem
from sepv.problem import Array, PolynomialSystem, Problem
from sepv.problems.maxwell_bloch import maxwell_bloch
from sepv.problems.polynomial_system import polynomial_problem


def random_maxwell_bloch(noise: Sequence[float] = (0.5,)) -> Problem:
    """The system from (1, 0.5, 0.5), with one noise or two."""
    base = maxwell_bloch()
    assert isinstance(base.data, PolynomialSystem)
    parts = (poly.polynomial(3, [((2, 0, 0), 0.5)]), poly.variable(3, 2))[: len(tuple(noise))]
    # Of (y2² + y3²)/2 alone a factor is known to be a Casimir as a matrix.
    casimir = ((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    data = replace(base.data, noise=tuple(noise), nambu=None, casimirs=(casimir,), noise_hamiltonians=parts)
    problem = polynomial_problem(data)
    assert isinstance(problem, HamiltoniansProblem)
    return replace(
        problem, initial=base.initial, name="random-maxwell-bloch", flows=(_turn, _push),
        noise_flows=(_turn, _push)[: len(parts)], check=False,
    )  # fmt: skip


def _turn(y: Array, t: Array) -> Array:
    """The flow of ½y_1²: (y_2, y_3) turns by the angle t y_1."""
    cos, sin = np.cos(t * y[0]), np.sin(t * y[0])
    return np.stack([y[0], cos * y[1] + sin * y[2], cos * y[2] - sin * y[1]])


def _push(y: Array, t: Array) -> Array:
    """The flow of y_3: y_1 moves by t y_2."""
    return np.stack([y[0] + t * y[1], y[1], y[2]])
