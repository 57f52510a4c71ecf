"""Hard structure matrices: components that do not move, low rank, zeros, nearly skew, d = 1."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sepv.problem import Array, PolynomialSystem
from sepv.problems._canonical import canonical, hat
from sepv.problems.hard._hard_case import UNIT3, HardCase, Sample, box, sizes, split
from sepv.record import _polynomial as poly
from sepv.record._polynomial import polynomial, squares

_RESTING = PolynomialSystem(
    4,
    polynomial(
        4, {(2, 0, 0, 0): 0.5, (0, 4, 0, 0): 0.25, (0, 1, 3, 0): 0.5, (1, 0, 0, 2): 0.25, (0, 0, 1, 3): 1.0}
    ),
    ((0, 1, poly.constant(4, -1.0)), (0, 3, poly.constant(4, 2.0**-40))),
)
_NOTHING = PolynomialSystem(3, squares((1.0, 2.0, 3.0)), ())
_RANK_2 = PolynomialSystem(
    6,
    poly.add(squares((1.0,) * 6), polynomial(6, {(1, 1, 1, 1, 0, 0): 0.25, (0, 2, 0, 0, 1, 1): 0.25})),
    ((0, 1, polynomial(6, {(0, 0, 0, 0, 0, 0): -1.0, (0, 0, 1, 0, 0, 1): 0.5})),),
    (1.0,),
    (),
    tuple(tuple(float(i == k) for i in range(6)) for k in range(2, 6)),
)
# B = |y|² hat(y) vanishes to third order at y = 0, where ∇H does not: H has a linear part.
_NORM = squares((2.0, 2.0, 2.0))
_VANISHING = PolynomialSystem(
    3,
    poly.add(squares((1.0, 2.0, 3.0)), poly.linear((1.0, 0.5, 0.0))),
    hat(_NORM),
    (1.0,),
    (UNIT3,),
)
_PLANE = PolynomialSystem(2, polynomial(2, {(2, 0): 0.5, (0, 4): 0.25, (0, 2): 0.5}), canonical(2))
_LINE = PolynomialSystem(1, polynomial(1, {(4,): 1.0, (1,): 1.0}), ())


def _resting(rng: np.random.Generator, lanes: int) -> Sample:
    """A quarter of the components is exactly zero."""
    y = np.where(rng.random((4, lanes)) < 0.25, 0.0, rng.uniform(-1.5, 1.5, (4, lanes)))
    return Sample(y, *split(rng, 1e-9, 0.1, lanes))


def _about_the_zero(rng: np.random.Generator, lanes: int) -> Sample:
    y = sizes(rng, 1e-200, 1.0, (1, lanes)) * rng.uniform(-1, 1, (3, lanes))
    y[:, rng.random(lanes) < 0.1] = 0.0
    return Sample(y, *split(rng, 1e-3, 0.2, lanes))


def _tilted(skewness: float) -> Callable[[Array], Array]:
    """B = J⁻¹ with a symmetric part of this size added above the diagonal."""

    def structure(y: Array) -> Array:
        zero, one = np.zeros_like(y[0]), np.ones_like(y[0])
        return np.stack([np.stack([zero, (skewness - 1) * one]), np.stack([one, zero])])

    return structure


def _nearly_skew(skewness: float, text: str, expected: str) -> HardCase:
    return HardCase(
        name=f"nearly-skew-{text}",
        reason=f"B with a symmetric part of {text}",
        expected=expected,
        data=_PLANE,
        sample=box(2, 1e-3, 0.2),
        laws=(),
        structure=_tilted(skewness),
        skewness=skewness,
    )


CASES = (
    HardCase(
        name="components-at-rest",
        reason="one component never moves, one by 1e-12: the quotients of a discrete gradient are 0/0",
        expected="solved: quotients are averages, which lose nothing as the denominator vanishes",
        data=_RESTING,
        sample=_resting,
        laws=("energy", "symmetry"),
    ),
    HardCase(
        name="rank-0",
        reason="B = 0",
        expected="y1 = y0 to the bit",
        data=_NOTHING,
        sample=box(3, 1e-3, 0.2),
        laws=("energy", "symmetry", "reference"),
    ),
    HardCase(
        name="rank-2-of-6",
        reason="B of rank 2 in six dimensions: four components are Casimirs",
        expected="solved; four components do not move at all",
        data=_RANK_2,
        sample=box(6, 1e-3, 0.2),
        laws=("energy", "casimir", "symmetry"),
    ),
    HardCase(
        name="vanishing-structure",
        reason="B = |y|² hat(y) about its zero, from |y| = 1 down to 1e-200 and 0, with ∇H ≠ 0 there",
        expected="solved; y = 0 is at rest although ∇H ≠ 0",
        data=_VANISHING,
        sample=_about_the_zero,
        laws=("energy", "casimir", "symmetry"),
    ),
    _nearly_skew(1e-16, "1e-16", "solved: below the rounding of B itself, H is kept to its bound"),
    _nearly_skew(
        1e-12,
        "1e-12",
        "sepv.Problem refuses it; forced upon the solver, H moves by exactly Δ 1e-12 g1 g2 and no more",
    ),
    HardCase(
        name="one-dimension",
        reason="d = 1: the only skew B is 0",
        expected="y1 = y0 to the bit",
        data=_LINE,
        sample=box(1, 1e-3, 0.2),
        laws=("energy", "symmetry", "reference"),
    ),
)
