"""Hard numbers: cancelling coefficients, huge constants, mixed and extreme scales, stiffness."""

from __future__ import annotations

from math import comb

import numpy as np

from sepv.problem import PolynomialSystem
from sepv.problems._canonical import canonical
from sepv.problems.hard._hard_case import HardCase, Sample, box, sizes, split
from sepv.record._polynomial import polynomial, squares

# ½p² + (q − 1)^10, expanded: coefficients up to 252 that cancel to nothing at q = 1.
_CANCELLING = polynomial(2, {(2, 0): 0.5, **{(0, k): float((-1) ** k * comb(10, k)) for k in range(11)}})
_CONSTANT = polynomial(2, {(0, 0): 2.0**60, (2, 0): 0.5, (0, 4): 0.25})
_MIXED = polynomial(
    4, {(2, 0, 0, 0): 5e7, (0, 0, 2, 0): 5e7, (0, 2, 0, 0): 5e-9, (0, 0, 0, 4): 2.5e-9, (0, 1, 0, 1): 1e-8}
)
_FREQUENCIES = (1.0, 1e2, 1e4, 1e6)
_SEXTIC = polynomial(2, {(6, 0): 0.25, (0, 6): 0.25, (2, 0): 0.5})
_FLAT = squares((1.0, 1.0))


def _near_one(rng: np.random.Generator, lanes: int) -> Sample:
    return Sample(
        np.stack([sizes(rng, 1e-8, 1.0, lanes), 1 + sizes(rng, 1e-8, 0.3, lanes)]),
        *split(rng, 1e-3, 1.0, lanes),
    )


def _mixed(rng: np.random.Generator, lanes: int) -> Sample:
    """The fast pair turns up to five times a step."""
    return Sample(sizes(rng, 1e-2, 1.5, (4, lanes)), *split(rng, 1e-10, 3e-7, lanes))


def _enormous(rng: np.random.Generator, lanes: int) -> Sample:
    """Half where H overflows and ∇H does not, half where both do."""
    return Sample(sizes(rng, 10.0**52, 10.0**70, (2, lanes)), *split(rng, 1e-3, 1.0, lanes))


def _minute(rng: np.random.Generator, lanes: int) -> Sample:
    return Sample(sizes(rng, 1e-320, 1e-290, (2, lanes)), *split(rng, 1e-3, 1.0, lanes))


CASES = (
    HardCase(
        name="degree-10-cancelling",
        reason="(q − 1)^10 expanded, near q = 1: terms of size 252 cancel to 1e-80",
        expected="solved to a bound that follows the terms, not their sum",
        data=PolynomialSystem(2, _CANCELLING, canonical(2)),
        sample=_near_one,
        laws=("energy", "reference"),
    ),
    HardCase(
        name="huge-constant",
        reason="H = 2^60 + …: binary64 cannot see any defect of H below 256",
        expected="solved; only H in extended precision shows the defect",
        data=PolynomialSystem(2, _CONSTANT, canonical(2)),
        sample=box(2, 1e-3, 0.3),
        laws=("energy", "symmetry", "reference"),
    ),
    HardCase(
        name="mixed-scales",
        reason="energies from 1e-8 to 1e8 in one H: the slow pair is below the rounding of the fast one",
        expected="solved, each component to its own scale",
        data=PolynomialSystem(4, _MIXED, canonical(4)),
        sample=_mixed,
    ),
    HardCase(
        name="stiff-quadratic",
        reason="frequencies 1 to 10^6, |Δ| up to 10^6 periods",
        expected="solved in an iteration or two: the equation is linear, its matrix of condition |Δ| 10^6",
        data=PolynomialSystem(8, squares((*_FREQUENCIES, *_FREQUENCIES)), canonical(8)),
        sample=box(8, 1e-4, 1.0),
        laws=("energy", "midpoint"),
    ),
    HardCase(
        name="overflowing-energy",
        reason="|y| from 1e52 to 1e70 with H of degree 6: H, then ∇H, is beyond 1e308",
        expected="refused: overflow, or no convergence at |Δ| 1e208 times the contraction radius",
        data=PolynomialSystem(2, _SEXTIC, canonical(2)),
        sample=_enormous,
        refusals=("OVERFLOW", "NO_CONVERGENCE", "SINGULAR"),
        laws=(),
    ),
    HardCase(
        name="subnormal-states",
        reason="|y| from 1e-320 to 1e-290: products underflow",
        expected="solved to the smallest number there is",
        data=PolynomialSystem(2, _FLAT, canonical(2)),
        sample=_minute,
    ),
)
