"""Hard cases of scale: coefficients that cancel, huge constants, mixed or extreme magnitudes,
stiffness.
"""

from __future__ import annotations

from math import comb

import numpy as np

from sepv.hard_cases._hard_case import HardCase, box, sizes, steps
from sepv.problem import PolynomialSystem
from sepv.problems import canonical
from sepv.record import polynomial, squares

# ½p² + (q − 1)^10, expanded: coefficients up to 252 that cancel to nothing at q = 1.
_CANCELLING = polynomial(2, {(2, 0): 0.5, **{(0, k): float((-1) ** k * comb(10, k)) for k in range(11)}})
_MIXED_SCALES = polynomial(
    4, {(2, 0, 0, 0): 5e7, (0, 0, 2, 0): 5e7, (0, 2, 0, 0): 5e-9, (0, 0, 0, 4): 2.5e-9, (0, 1, 0, 1): 1e-8}
)


SCALE_CASES = (
    HardCase(
        "degree-10-cancelling", "(q − 1)^10 expanded, near q = 1: terms of size 252 cancel to 1e-80",
        "solved to a bound that follows the terms, not their sum",
        PolynomialSystem(2, _CANCELLING, canonical(2)),
        steps(1e-3, 1.0, lambda rng, n: np.stack([sizes(rng, 1e-8, 1.0, n), 1 + sizes(rng, 1e-8, 0.3, n)])),
        laws=("energy", "reference"),
    ),
    HardCase(
        "huge-constant", "H = 2^60 + …: binary64 cannot see any defect of H below 256",
        "solved; only H in extended precision shows the defect",
        PolynomialSystem(2, polynomial(2, {(0, 0): 2.0**60, (2, 0): 0.5, (0, 4): 0.25}), canonical(2)),
        box(2, 1e-3, 0.3), laws=("energy", "symmetry", "reference"),
    ),
    HardCase(
        # The fast pair of components makes up to five turns in one step.
        "mixed-scales",
        "energies from 1e-8 to 1e8 in one H: the slow pair is below the rounding of the fast one",
        "solved, each component to its own scale",
        PolynomialSystem(4, _MIXED_SCALES, canonical(4)),
        steps(1e-10, 3e-7, lambda rng, n: sizes(rng, 1e-2, 1.5, (4, n))),
    ),
    HardCase(
        "stiff-quadratic", "frequencies 1 to 10^6, |Δ| up to 10^6 periods",
        "solved in an iteration or two: the equation is linear, its matrix of condition |Δ| 10^6",
        PolynomialSystem(8, squares((1.0, 1e2, 1e4, 1e6) * 2), canonical(8)), box(8, 1e-4, 1.0),
        laws=("energy", "midpoint"),
    ),
    HardCase(
        # At half of the states H overflows but ∇H does not; at the other half both overflow.
        "overflowing-energy", "|y| from 1e52 to 1e70 with H of degree 6: H, then ∇H, is beyond 1e308",
        "refused: overflow, or no convergence at |Δ| 1e208 times the contraction radius",
        PolynomialSystem(2, polynomial(2, {(6, 0): 0.25, (0, 6): 0.25, (2, 0): 0.5}), canonical(2)),
        steps(1e-3, 1.0, lambda rng, n: sizes(rng, 10.0**52, 10.0**70, (2, n))),
        refusals=("OVERFLOW", "NO_CONVERGENCE", "SINGULAR"), laws=(),
    ),
    HardCase(
        "subnormal-states", "|y| from 1e-320 to 1e-290: products underflow",
        "solved to the smallest number there is",
        PolynomialSystem(2, squares((1.0, 1.0)), canonical(2)),
        steps(1e-3, 1.0, lambda rng, n: sizes(rng, 1e-320, 1e-290, (2, n))),
    ),
)  # fmt: skip
