"""Lotka-Volterra (§4.4) next to the axes, and at steps for which no solution exists."""

from __future__ import annotations

import numpy as np

from sepv.problem import NamedProblem
from sepv.problems.hard._hard_case import REFUSALS, HardCase, Sample, sizes, split

_DATA = NamedProblem(
    "lotka-volterra",
    (("a", (-2.0,)), ("b", (-1.0,)), ("d", (-0.5,)), ("nu", (1.0,)), ("mu", (2.0,)), ("noise", (0.5,))),
)


def _axes(rng: np.random.Generator, lanes: int) -> Sample:
    """Each component 1 or so, or down to 1e-150."""
    y = np.where(
        rng.random((3, lanes)) < 0.5,
        np.abs(sizes(rng, 1e-150, 1e-3, (3, lanes))),
        rng.uniform(0.3, 2, (3, lanes)),
    )
    return Sample(y, *split(rng, 1e-4, 2.0**-5, lanes, 0.5))


def _coarse(rng: np.random.Generator, lanes: int) -> Sample:
    y = np.array([[1.0], [1.9], [0.5]]) * rng.uniform(0.5, 2.0, (3, lanes))
    return Sample(y, *split(rng, 0.1, 4.0, lanes, 0.5))


CASES = (
    HardCase(
        name="lotka-volterra-axes",
        reason="components down to 1e-150: ∇H up to 1e150 meets B that vanishes as fast",
        expected="solved; damped into y > 0 where a full Newton step leaves it",
        data=_DATA,
        sample=_axes,
    ),
    HardCase(
        name="lotka-volterra-coarse",
        reason="|Δ| from 0.1 to 4: the branch of solutions from y0 ends at a fold",
        expected="solved before the fold, refused beyond: no energy level is bounded, and no solution need exist",
        data=_DATA,
        sample=_coarse,
        refusals=REFUSALS,
    ),
)
