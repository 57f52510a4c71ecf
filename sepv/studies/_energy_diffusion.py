"""Theory of the energy of a symplectic scheme with random steps, one degree of freedom:
random walk, drift and offset.

With a fixed step Δ a symplectic scheme keeps, to high order, a modified Hamiltonian H + Δ²H₂ + …
that depends on Δ. So with random steps the energy is not kept. For the midpoint rule, with f
= J⁻¹∇H, L = f·∇ and H₂ = −fᵀH″f/24,

    H(y1) − H(y0) = −Δ²(H₂(y1) − H₂(y0)) + O(Δ⁵) = Δ³G + O(Δ⁴),
    G = −LH₂ = H‴(f, f, f)/24 = −∇H·(c − c̃),

with c(y) of (3.1) and c̃(y) of (3.5) in the paper. Let X = Σ c_jΔŴ_j be the noise in Δ, and κ = E
X⁴/E X², which is 3|c|²h without truncation. X³ − κX is uncorrelated with X, and only X moves the
phase on the orbit. So the changes of H + κH₂ have mean zero to leading order, and H does a random
walk of variance 2Dt. With the average ⟨·⟩ over the orbit, D = (E X⁶ − (E X⁴)²/E X²)⟨G²⟩/(2h), which
is 3|c|⁶h²⟨G²⟩ without truncation.

This module computes D with all powers of Δ, from single steps of the scheme at states of the exact
orbit. The phase φ is a Markov chain, φ → φ + Δ, in which the energy grows by u(φ, Δ). The variance
of the sum of u grows by 2Dh per step,

    2Dh = ⟨E u²⟩ + 2 Σ_{n ≥ 1} ⟨E u_0 u_n⟩,

which is a geometric series for each harmonic of u (M. Green 1954, R. Kubo 1957).

The drift follows from symplecticity. Every step keeps the area, so the measure dI of the
action I is stationary, and no mass crosses I = 0. The only diffusion with both properties is
p_t = ∂_I(D_I ∂_I p), D_I = D/ω², in which I drifts by D_I′(I). In terms of H, with dH = ω dI
and the period T = 2π/ω,

    E[H(y_n)] − H(y0) = offset + t (1/T) d(T D)/dH.

The offset is reached once the phase is random. It is O(h), for the midpoint rule κ(H₂(y0) − ⟨H₂⟩).
The drift is O(h²).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sepv.exact import PHASES, Orbit, closed_orbit
from sepv.problem import Array, Problem
from sepv.properties import gaussian_rule_for as rule_for
from sepv.schemes import Scheme, ask

# The distance of neighbouring orbits relative to |y|. Central differences have its square, 1e-6, as
# relative error.
ORBIT_DISTANCE = 1e-3


@dataclass(frozen=True)
class EnergyDiffusion:
    """The energy's random walk in theory: E[H] − H(y0) = offset + drift t and Var H = 2
    diffusion t.

    Both formulas hold while the walk stays near the orbit through y0, whose period is `period`.
    """

    offset: float
    drift: float
    diffusion: float
    period: float

    def reaches(self, t: float) -> bool:
        """True if the rms √(2Dt) of the energy at t is at most D/drift,
        a change of H that about doubles D.
        """
        return 2 * t * self.drift**2 <= self.diffusion

    def at(self, t: Array) -> tuple[Array, Array]:
        """E[H] − H(y0) and the rms of H − E[H] at times t,
        for t so long that the phase on the orbit is random.
        """
        return self.offset + self.drift * t, np.sqrt(np.maximum(2 * self.diffusion, 0) * t)


def energy_diffusion(scheme: Scheme, problem: Problem, h: float) -> EnergyDiffusion | None:
    """The energy's offset, drift and diffusion by theory,
    for paths from the problem's initial state y0.

    None if the theory does not apply: the scheme does not claim symplecticity or takes one state at
    a time, B is not a constant (2, 2) matrix, there is no noise, or the orbit through y0 is not
    closed.
    """
    if not (
        "poisson-map:constant" in scheme.claims
        and scheme.batched
        and problem.dimension == 2
        and np.any(problem.c)
    ):
        return None
    y0 = np.array(problem.initial, dtype=np.float64)
    slope = problem.gradient(y0)
    steepness = float(np.linalg.norm(slope))
    if not steepness:
        return None
    apart = ORBIT_DISTANCE * float(np.linalg.norm(y0)) / steepness * slope
    below, here, above = (closed_orbit(problem, y) for y in (y0 - apart, y0, y0 + apart))
    if below is None or here is None or above is None:
        return None
    if np.any(problem.structure(below.states) != problem.structure(above.states[:, ::-1])):
        return None
    walks = [_walk(scheme, problem, h, orbit) for orbit in (below, here, above)]
    rise = float(problem.hamiltonian(above.states[:, 0]) - problem.hamiltonian(below.states[:, 0]))
    drift = (above.period * walks[2][0] - below.period * walks[0][0]) / rise / here.period
    return EnergyDiffusion(walks[1][1], drift, walks[1][0], here.period)


def _walk(scheme: Scheme, problem: Problem, h: float, orbit: Orbit) -> tuple[float, float]:
    """The diffusion D of the energy near an orbit, and the offset Σ_n E[u_n] for paths from the
    orbit's first state.

    u_n is the energy's increment in step n; D is computed from the correlations of all u_n.
    """
    nodes = rule_for(scheme, problem, h, 12)
    noise, weights = np.sqrt(h) * nodes.zeta[:, nodes.index], nodes.weights
    y = np.repeat(orbit.states, weights.size, axis=1)
    ends = ask(scheme, problem, y, h, np.tile(noise, (1, PHASES)))
    u = (problem.hamiltonian(ends) - problem.hamiltonian(y)).reshape(PHASES, weights.size)
    harmonics = np.fft.fft(u, axis=0) / PHASES
    number = np.fft.fftfreq(PHASES, 1 / PHASES)[:, None]
    turned = np.exp(2j * np.pi / orbit.period * number * problem.random_step(h, noise[: problem.noises]))
    mean, forgotten = (harmonics @ weights)[1:], 1 - (turned @ weights)[1:]
    carried = ((np.conj(harmonics) * turned) @ weights)[1:]
    variance = float(np.sum(np.abs(harmonics) ** 2 @ weights)) + 2 * float(
        np.sum(carried * mean / forgotten).real
    )
    return variance / (2 * h), float(np.sum(mean / forgotten).real)
