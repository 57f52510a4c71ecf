"""Right schemes for Langevin dynamics that look unusual: ABOBA by velocities,
the exact Gaussian step, and the mean of the exact step given what increments and areas tell.

The exact step for a quadratic V needs the flow e^{Kt} of the drift Ky, and a noise of covariance
C = ∫₀ʰ e^{Ks}GGᵀe^{Kᵀs}ds. Both are blocks of one matrix exponential
(C. Van Loan, IEEE Trans. Automat. Control 23, 1978):

    exp(h [[−K, GGᵀ], [0, Kᵀ]]) = [[·, e^{−Kh}C], [0, e^{Kᵀh}]].

The noise ζ = ∫₀ʰ e^{K(h−s)}G dW of a step has the covariances E_1G with ΔW and E_2G with ∫W ds,
where E_1 = ∫₀ʰ e^{Ku}du and E_2 = ∫₀ʰ e^{Ku}u du. So its mean given ΔW and the space-time area
H = (1/h)∫W ds − ½ΔW, which are independent with the variances h and h/12, is (1/h)E_1G ΔW
+ (12/h)(E_2/h − E_1/2)G H. What it leaves out has the size h^{5/2} and the mean 0: mean-square
order 2. Its covariance of order h⁵ is missing in the second moments.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sepv.errors import Skipped
from sepv.problem import (
    Array,
    Problem,
    damping_matrix,
    drift,
    hessian,
    langevin,
    noise_vectors,
    sample_states,
)
from sepv.schemes import LANGEVIN_CLAIMS, Scheme, by_name

# Halvings of the matrix of an exponential, and the terms of its series: for a norm up to 4 the
# first term that is left out is below 1e-26.
EXPONENTIAL_HALVINGS, EXPONENTIAL_TERMS = 4, 18


def exponential(A: Array) -> Array:
    """The exponential of a small matrix, by its series and repeated squares."""
    total = term = np.eye(len(A))
    for n in range(1, EXPONENTIAL_TERMS):
        term = term @ A / (n * 2.0**EXPONENTIAL_HALVINGS)
        total = total + term
    for _ in range(EXPONENTIAL_HALVINGS):
        total = total @ total
    return total


def slope(problem: Problem) -> Array:
    """The matrix K of the drift of a problem with quadratic V; Skipped for another V."""
    states = [hessian(problem, state) for state in sample_states(problem)]
    if any(np.max(np.abs(other - states[0])) > 2.0**-30 * np.max(np.abs(states[0])) for other in states):
        raise Skipped(f"V of {problem.name} is not quadratic")
    K: Array = problem.structure(np.zeros(problem.dimension)) @ states[0] - damping_matrix(problem)
    return K


def expected(problem: Problem, y: Array, h: float, dW: Array, bridge: Array) -> Array:
    """The mean of y(h) given ΔW and H, for a quadratic V."""
    d, K, G = problem.dimension, slope(problem), noise_vectors(problem).T * problem.c
    none, one = np.zeros((d, d)), np.eye(d)
    # The exponential's last blocks of the first row are E_1 and ∫₀ʰ(h − u)e^{Ku}du = hE_1 − E_2.
    row = exponential(h * np.block([[K, one, none], [none, none, one], [none, none, none]]))[:d]
    first, second = row[:, d : 2 * d], h * row[:, d : 2 * d] - row[:, 2 * d :]
    moved = first @ (drift(problem, y) + G @ dW / h)
    return np.asarray(y + moved + 12 / h * (second / h - first / 2) @ G @ bridge)


def gaussian(problem: Problem, y: Array, h: float, dW: Array, bridge: Array) -> Array:
    """The exact distribution of y(h) for a quadratic V, by the 2m normal numbers ΔW and H;
    Skipped for another V.
    """
    if h <= 0:
        raise Skipped("the noise of a step back has no covariance")
    d, at, K = problem.dimension, np.zeros(problem.dimension), slope(problem)
    G = noise_vectors(problem).T * problem.c
    blocks = exponential(h * np.block([[-K, G @ G.T], [np.zeros((d, d)), K.T]]))
    flow = blocks[d:, d:].T
    covariance = flow @ blocks[:d, d:]
    rest = -np.linalg.solve(K, drift(problem, at))
    normal = np.concatenate([dW, np.sqrt(12.0) * bridge]) / np.sqrt(h)
    moved = flow @ (y - rest)
    return rest + moved + np.linalg.cholesky(0.5 * (covariance + covariance.T)) @ normal


def by_velocities(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """ABOBA with v = M⁻¹p in place of p, and one factor for both parts of the noise."""
    own = langevin(problem)
    system = own.mechanics
    q, p = system.split(y)
    x = own.rate * h
    spread = np.sqrt(np.sinh(x) / x * np.exp(-x)) if x else 1.0
    q = q + h / 2 * system.velocity(p)
    push = h / 2 * system.velocity(system.force(q))
    v = np.exp(-x) * (system.velocity(p) + push) + spread * system.velocity(own.pushed(dW)) + push
    return system.join(q + h / 2 * v, system.momentum(v))


FRICTION_SCHEMES: tuple[Scheme, ...] = (
    replace(
        by_name("baoab"),
        name="aboba-by-velocities",
        step=by_velocities,
        claims=LANGEVIN_CLAIMS | {"equilibrium:positions"},
        source="ABOBA in velocities",
    ),
    Scheme(
        "exact-gaussian-step",
        gaussian,
        {"equilibrium", "equilibrium:positions", "poisson-map:conformal"},
        "the exact distribution for a quadratic V; Van Loan (1978)",
        systems=by_name("baoab").systems,
        problems=("langevin-oscillator", "langevin-pair"),
        asks="space-time",
        truncation=None,
    ),
    Scheme(
        "mean-given-areas",
        expected,
        {"equilibrium"},
        "E[y(h) | ΔW, H] for a quadratic V",
        systems=by_name("baoab").systems,
        problems=("langevin-oscillator", "langevin-pair"),
        mean_square_order=2,
        weak_order=2,
        asks="space-time",
        truncation=None,
        batched=True,
    ),
)
