"""A step Φ has det Φ′(y0) = 1 wherever the exact flow keeps volume, that is, div(B∇H) = 0.

By Liouville's theorem det φ_θ′ = exp ∫₀^θ div f dt for f = B∇H. Because B is skew, div f = Σ_ij
∂_iB_ij ∂_jH. It is 0 for every H if B is constant, for rotations, and for a charge in any magnetic
field. The map of J. P. Boris (1970) for such a charge keeps volume and is not symplectic (H. Qin et
al., Phys. Plasmas 20, 2013). Poisson maps and symmetric schemes need not keep volume: for d = 3 the
midpoint rule does not.
"""

from __future__ import annotations

import numpy as np
from sepv.properties._poisson_map import tangent
from sepv.properties._structures import places

from sepv.law import Case, Cases, Effort, Measurement, Middle, require, searched
from sepv.law.contraction import shortened
from sepv.problem import Array, Problem, derivative_of_structure, one_field
from sepv.problems import build
from sepv.record import EPS
from sepv.schemes import Scheme

# A divergence of at most DIVERGENCE_TOLERANCE times its terms counts as 0, because derivatives of B
# have errors. The bound includes it.
DIVERGENCE_TOLERANCE = 1e-8


def divergence(problem: Problem, y: Array) -> tuple[float, float]:
    """Return div(B∇H) at y (d,), and the sum of the absolute values of its terms."""
    slope, gradient = derivative_of_structure(problem, y), problem.gradient(y)
    terms = np.einsum("iji->ij", slope) * gradient
    return float(np.sum(terms)), float(np.sum(np.abs(terms)))


def volume_kept(case: Case) -> Case | None:
    """Keep a case if its flow keeps volume, and shorten its step to at most half the contraction
    radius.
    """
    problem = build(case.problem)
    for state in places(problem, np.array(case.y)):
        value, size = divergence(problem, state)
        if not abs(value) <= DIVERGENCE_TOLERANCE * size:
            return None
    return shortened(case)


def check(scheme: Scheme, case: Case) -> Measurement:
    """Measure |det Φ′ − 1|, with det from an LU factorisation with partial pivoting.

    The factorisation's error is d u|L||U| with unit roundoff u (Higham, Theorem 9.3). Because |L|
    ≤ 1, elimination at most doubles a column's largest entry d times, so a column of |U| sums to
    less than 2^d times this entry of Φ′. det Φ′ is linear in each column D_j and at most the
    product of their lengths (Hadamard). So column errors E_j change it by at most Π(|D_j| + |E_j|)
    − Π|D_j|. A div(B∇H) of at most DIVERGENCE_TOLERANCE of its terms counts as 0, and twice its
    integral over the step is added to the bound.
    """
    problem, y, h, dW = case.build()
    slope, E, _, y1 = tangent(scheme, case)
    d = y.size
    E = E + d * EPS * 2**d * np.max(np.abs(slope), axis=0)
    determinant = float(np.linalg.det(slope))
    lengths, errors = np.linalg.norm(slope, axis=0), np.linalg.norm(E, axis=0)
    allowed = float(np.prod(lengths + errors) - np.prod(lengths)) + d * EPS * abs(determinant)
    length = abs(h) + float(np.sum(np.abs(problem.c * dW)))
    allowed += 2 * length * max(abs(divergence(problem, state)[0]) for state in (y, y1))
    detail = f"det Φ′ = 1 {'+' if determinant >= 1 else '−'} {abs(determinant - 1):.6g}, y1 = {y1.tolist()}"
    return Measurement(abs(determinant - 1) / EPS, allowed / EPS, detail)


law = searched(
    name="volume",
    statement="det Φ′(y0) = 1 if div(B∇H) = 0",
    source="GNI VI.9",
    unit="ulp of 1",
    preserves=True,
    cost=0.5,
    steps=1500,
    middle=Middle.MAP,
    cases=Cases(
        # If B or the factor g of a Nambu system is constant, div(B∇H) = 0 for every H.
        where={
            "degree of B": ("0",),
            "degree of g": ("0",),
            "d": ("2", "3", "4–6"),
            "degree of H": ("1–2", "3–4", "5–6"),
            "terms of H": ("1–2", "3–9"),
        },
        adapt=volume_kept,
        why="the flow of the problems changes volume",
        needs={one_field: "the flow keeps volume where each of its fields does"},
    ),
    check=check,
)


def test_volume(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
