"""Additive noise: the separable Hamiltonian of Hénon and Heiles with noise in its momenta.

H_0 = ½|p|² + ½|q|² + κ(q_1²q_2 − q_2³/3) with y = (p, q) is that of M. Hénon and C. Heiles,
Astron. J. 69 (1964). With H_j = −q_j the noise c_j B∇H_j ∘dW_j adds c_j dW_j to p_j. E[H_0] then
grows at the constant rate ½Σc_j² (the trace formula: D. Cohen and G. Vilmart, Int. J. Comput.
Math. 99, 2022, for Poisson systems).
"""

from __future__ import annotations

from collections.abc import Sequence

from sepv.problem import PolynomialSystem, Problem
from sepv.problems._common import canonical, flows, structure
from sepv.problems._polynomial_system import started
from sepv.record import PolynomialMap, poly


def noisy_henon_heiles(coupling: float = 0.5, noise: Sequence[float] = (0.5, 0.25)) -> Problem:
    """The system of Hénon and Heiles with additive noise in its momenta.

    The initial state is p = (0.2, −0.1), q = (0.3, 0.2).
    """
    others = [poly.scale(-1.0, poly.variable(4, 2 + j)) for j in range(len(tuple(noise)))]
    return _oscillators(coupling, noise, others, "noisy-henon-heiles")


def pushed_henon_heiles(coupling: float = 0.5, noise: Sequence[float] = (0.5, 0.5)) -> Problem:
    """The system of Hénon and Heiles with additive noise in momenta and positions.

    The noise Hamiltonians are H_1 = p_1 − ½q_1 and H_2 = ½p_2 − q_2. With noise in the momenta
    alone, f″(g, g) = 0 for the drift f and every noise field g, and the explicit midpoint rule
    would seem to have the weak order 2. Here f″(g, g) ≠ 0, so that error terms with this factor can
    be measured.
    """
    others = [poly.linear((1, 0, -0.5, 0)), poly.linear((0, 0.5, 0, -1))]
    return _oscillators(coupling, noise, others, "pushed-henon-heiles")


def _oscillators(
    coupling: float, noise: Sequence[float], others: Sequence[poly.Polynomial], name: str
) -> Problem:
    cubic = poly.polynomial(4, {(0, 0, 2, 1): coupling, (0, 0, 0, 3): -coupling / 3})
    parts = [poly.squares((1, 1, 0, 0)), poly.add(poly.squares((0, 0, 1, 1)), cubic)]
    data = PolynomialSystem(4, poly.add(*parts), canonical(4), tuple(noise), noise_hamiltonians=tuple(others))
    exact = flows(4, structure, [PolynomialMap((), (p,)) for p in (*parts, *others)])
    return started(data, name, (0.2, -0.1, 0.3, 0.2), flows=exact[:2], noise_flows=exact[2:])
