"""Hard cases of the random step Δ = h + Σ c_j ΔW_j: tiny, zero, of either sign,
at the truncation bound and beyond.
"""

from __future__ import annotations

import numpy as np

from sepv.hard_cases._hard_case import HardCase, Sample, sizes
from sepv.problem import NamedProblem, PolynomialSystem
from sepv.problems import UNIT3, canonical, hat
from sepv.record import polynomial, squares

_QUARTIC = polynomial(2, {(2, 0): 0.5, (0, 4): 0.25, (0, 2): -0.5, (1, 3): 0.125})


def _about_one(rng: np.random.Generator, d: int, lanes: int) -> np.ndarray:
    return rng.uniform(-1.5, 1.5, (d, lanes))


def _tiny(rng: np.random.Generator, lanes: int) -> Sample:
    """Steps of one tiny h ≤ 1e-12: half have |ΔW| from 1e-300 to 1e-12,
    half ΔW = √h ξ with ξ ~ N(0, 1).
    """
    h = 10.0 ** rng.uniform(-300, -12)
    dW = np.sqrt(h) * rng.standard_normal((1, lanes))
    extreme = rng.random(lanes) < 0.5
    dW[0, extreme] = sizes(rng, 1e-300, 1e-12, int(extreme.sum()))
    return Sample(_about_one(rng, 3, lanes), h, dW)


def _zero(rng: np.random.Generator, lanes: int) -> Sample:
    h = 2.0 ** -rng.integers(1, 40)
    return Sample(_about_one(rng, 2, lanes), h, np.full((1, lanes), -h))


def _cancelling(rng: np.random.Generator, lanes: int) -> Sample:
    h = 2.0 ** -rng.integers(2, 8)
    return Sample(_about_one(rng, 2, lanes), h, -h * (1 + sizes(rng, 2.0**-52, 1.0, (1, lanes))))


def _truncated(rng: np.random.Generator, lanes: int) -> Sample:
    """Increments ΔW = ±t √h A_h, with Remark 2.1's bound A_h = √(4|ln h|): half have t = 1,
    half 1 < t ≤ 4.
    """
    h = 2.0 ** -rng.integers(1, 12)
    bound = np.sqrt(h) * np.sqrt(4 * abs(np.log(h)))
    factor = np.where(rng.random((1, lanes)) < 0.5, 1.0, rng.uniform(1, 4, (1, lanes)))
    q = rng.uniform(-np.pi, np.pi, lanes)
    return Sample(
        np.stack([rng.uniform(-2, 2, lanes), q]), h, rng.choice([-1.0, 1.0], (1, lanes)) * factor * bound
    )


STEP_CASES = (
    HardCase(
        "tiny-steps", "|Δ| from 1e-12 down to 1e-300: y1 − y0 is far below an ulp of y",
        "solved in an iteration or two, nothing divided by Δ",
        PolynomialSystem(3, squares((1.0, 2.0, 3.0)), hat(), (1.0,), (UNIT3,)), _tiny,
        laws=("energy", "casimir", "reference", "symmetry"),
    ),
    HardCase(
        "zero-step", "h and the noise cancel to Δ = 0",
        "y1 = y0 to the bit wherever the scheme is a function of Δ",
        PolynomialSystem(2, _QUARTIC, canonical(2)), _zero, laws=("energy", "identity"),
    ),
    HardCase(
        "cancelling-step", "h + ΔW cancels to anything from 2^-52 h to h, of either sign",
        "solved; backwards steps are steps",
        PolynomialSystem(2, _QUARTIC, canonical(2)), _cancelling, laws=("energy", "symmetry"),
    ),
    HardCase(
        "truncation-bound",
        "increments at √h A_h of Remark 2.1 and up to four times beyond, from h = 1/2 down",
        "solved: the energy level bounds p, so that a solution exists for every Δ; "
        "for |Δ| of several units Newton may miss it and then says so",
        NamedProblem("pendulum", (("noise", (1.0,)),)), _truncated, refusals=("NO_CONVERGENCE", "SINGULAR"),
    ),
)  # fmt: skip
