"""Langevin dynamics dq = M⁻¹p dt, dp = (−∇V − γp) dt + √(2γkT M) dW with y = (q, p):
friction and noise at kT.
"""

from __future__ import annotations

from sepv.problem import PolynomialSystem, Problem, friction
from sepv.problems._common import canonical
from sepv.problems._mechanical import harmonic_trap
from sepv.problems._polynomial_system import started
from sepv.record import poly


def langevin_oscillator(frequency: float = 1.0, rate: float = 1.0, temperature: float = 1.0) -> Problem:
    """The oscillator H = ½(p² + ω²q²) with friction γ at kT, from q = 1/ω, p = 0: ⟨q²⟩ = kT/ω²,
    ⟨p²⟩ = kT.
    """
    return friction(harmonic_trap((frequency,)), rate, temperature, "langevin-oscillator")


def langevin_double_well(barrier: float = 1.0, rate: float = 1.0, temperature: float = 0.5) -> Problem:
    """The double well H = ½p² + b(q² − 1)² of H. A. Kramers (1940), with friction γ at kT,
    from q = −1, p = 0.
    """
    H = poly.polynomial(2, {(0, 2): 0.5, (4, 0): barrier, (2, 0): -2 * barrier, (0, 0): barrier})
    well = started(PolynomialSystem(2, H, canonical(2, 1.0), ()), "double-well", (-1.0, 0.0))
    return friction(well, rate, temperature, "langevin-double-well")


def langevin_pair(
    coupling: float = 0.5,
    masses: tuple[float, float] = (1.0, 2.0),
    rate: float = 0.5,
    temperature: float = 1.0,
) -> Problem:
    """Two bodies on springs, H = ½Σ(p_k²/m_k + q_k²) + (κ/2)(q_2 − q_1)², with friction γ,
    from q = (1, 0), p = 0.
    """
    bent = {(2, 0, 0, 0): 0.5, (0, 2, 0, 0): 0.5, (1, 1, 0, 0): -1.0}
    H = poly.add(
        poly.squares((1.0, 1.0, *(1 / m for m in masses))),
        poly.polynomial(4, {e: coupling * c for e, c in bent.items()}),
    )
    pair = started(PolynomialSystem(4, H, canonical(4, 1.0), ()), "pair", (1.0, 0.0, 0.0, 0.0))
    return friction(pair, rate, temperature, "langevin-pair")
