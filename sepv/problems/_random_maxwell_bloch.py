"""Maxwell-Bloch with a Hamiltonian of its own for the noise, and with two whose fields do not commute.

B and H_0 = ½y_1² + y_3 are those of `sepv.problems.maxwell_bloch`, H_1 = ½y_1² and H_2 = y_3 its two parts, one for
each noise: C.-E. Bréhier, D. Cohen and T. Jahnke (Math. Comp. 92, 2023) disturb the system in this way. Their flows are
linear.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from sepv.problem import PolynomialSystem, Problem
from sepv.problems._maxwell_bloch import maxwell_bloch
from sepv.problems._polynomial_system import started
from sepv.problems._sum_of_parts import flows
from sepv.record import PolynomialMap
from sepv.record import _polynomial as poly


def random_maxwell_bloch(noise: Sequence[float] = (0.5,)) -> Problem:
    """The system from (1, 0.5, 0.5), with one noise or two."""
    base = maxwell_bloch()
    assert isinstance(base.data, PolynomialSystem)
    halves = (poly.squares((1, 0, 0)), poly.variable(3, 2))
    parts = halves[: len(tuple(noise))]
    # Of (y2² + y3²)/2 alone a factor is known to be a Casimir as a matrix.
    casimir = ((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    data = replace(base.data, noise=tuple(noise), nambu=None, casimirs=(casimir,), noise_hamiltonians=parts)
    own = flows(3, base.structure, [PolynomialMap((), (p,)) for p in halves])
    y0 = (1.0, 0.5, 0.5)
    return started(data, "random-maxwell-bloch", y0, flows=own, noise_flows=own[: len(parts)])
