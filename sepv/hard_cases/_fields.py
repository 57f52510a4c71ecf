"""Hard cases of the matrix B(y): components at rest, low rank, zeros, a small symmetric part,
dimension 1.
"""

from __future__ import annotations

import numpy as np

from sepv.hard_cases._hard_case import HardCase, box, sizes, steps
from sepv.problem import Array, PolynomialSystem
from sepv.problems import UNIT3, canonical, hat
from sepv.record import poly

_RESTING_SYSTEM = PolynomialSystem(
    4,
    poly.polynomial(
        4, {(2, 0, 0, 0): 0.5, (0, 4, 0, 0): 0.25, (0, 1, 3, 0): 0.5, (1, 0, 0, 2): 0.25, (0, 0, 1, 3): 1.0}
    ),
    ((0, 1, poly.constant(4, -1.0)), (0, 3, poly.constant(4, 2.0**-40))),
)
_RANK_2 = PolynomialSystem(
    6,
    poly.add(
        poly.squares((1.0,) * 6), poly.polynomial(6, {(1, 1, 1, 1, 0, 0): 0.25, (0, 2, 0, 0, 1, 1): 0.25})
    ),
    ((0, 1, poly.polynomial(6, {(0, 0, 0, 0, 0, 0): -1.0, (0, 0, 1, 0, 0, 1): 0.5})),),
    (1.0,),
    (),
    tuple(tuple(float(i == k) for i in range(6)) for k in range(2, 6)),
)
# B = |y|² hat(y) vanishes to third order at y = 0, but ∇H does not vanish, because H has a linear
# part.
_NORM = poly.squares((2.0, 2.0, 2.0))
_VANISHING_B = PolynomialSystem(
    3, poly.add(poly.squares((1.0, 2.0, 3.0)), poly.linear((1.0, 0.5, 0.0))), hat(_NORM), (1.0,), (UNIT3,)
)


def _resting(rng: np.random.Generator, lanes: int) -> Array:
    """States with a quarter of their components exactly zero."""
    return np.where(rng.random((4, lanes)) < 0.25, 0.0, rng.uniform(-1.5, 1.5, (4, lanes)))


def _about_the_zero(rng: np.random.Generator, lanes: int) -> Array:
    """States with |y| from 1e-200 to 1; a tenth of the states have y = 0, where B vanishes."""
    y = sizes(rng, 1e-200, 1.0, (1, lanes)) * rng.uniform(-1, 1, (3, lanes))
    y[:, rng.random(lanes) < 0.1] = 0.0
    return y


def _nearly_skew(skewness: float, text: str, expected: str) -> HardCase:
    """The hard case of B = J⁻¹ with `skewness` added above the diagonal,
    so that B is not quite skew.
    """
    H = poly.polynomial(2, {(2, 0): 0.5, (0, 4): 0.25, (0, 2): 0.5})

    def structure(y: Array) -> Array:
        zero, one = np.zeros_like(y[0]), np.ones_like(y[0])
        return np.stack([np.stack([zero, (skewness - 1) * one]), np.stack([one, zero])])

    return HardCase(
        name=f"nearly-skew-{text}",
        reason=f"B with a symmetric part of {text}",
        expected=expected,
        data=PolynomialSystem(2, H, canonical(2)),
        sample=box(2, 1e-3, 0.2),
        laws=(),
        structure=structure,
        skewness=skewness,
    )


FIELD_CASES = (
    HardCase(
        "components-at-rest",
        "one component never moves, one by 1e-12: the quotients of a discrete gradient are 0/0",
        "solved: quotients are averages, which lose nothing as the denominator vanishes",
        _RESTING_SYSTEM, steps(1e-9, 0.1, _resting), laws=("energy", "symmetry"),
    ),
    HardCase(
        "rank-0", "B = 0",
        "y1 = y0 to the bit",
        PolynomialSystem(3, poly.squares((1.0, 2.0, 3.0)), ()), box(3, 1e-3, 0.2),
        laws=("energy", "symmetry", "reference"),
    ),
    HardCase(
        "rank-2-of-6", "B of rank 2 in six dimensions: four components are Casimirs",
        "solved; four components do not move at all",
        _RANK_2, box(6, 1e-3, 0.2), laws=("energy", "casimir", "symmetry"),
    ),
    HardCase(
        "vanishing-structure",
        "B = |y|² hat(y) about its zero, from |y| = 1 down to 1e-200 and 0, with ∇H ≠ 0 there",
        "solved; y = 0 is at rest although ∇H ≠ 0",
        _VANISHING_B, steps(1e-3, 0.2, _about_the_zero), laws=("energy", "casimir", "symmetry"),
    ),
    _nearly_skew(1e-16, "1e-16", "solved: below the rounding of B itself, H is kept to its bound"),
    _nearly_skew(
        1e-12, "1e-12",
        "sepv.Problem refuses it; forced upon the solver, H moves by exactly Δ 1e-12 g1 g2 and no more",
    ),
    HardCase(
        "one-dimension", "d = 1: the only skew B is 0",
        "y1 = y0 to the bit",
        PolynomialSystem(1, poly.polynomial(1, {(4,): 1.0, (1,): 1.0}), ()), box(1, 1e-3, 0.2),
        laws=("energy", "symmetry", "reference"),
    ),
)  # fmt: skip
