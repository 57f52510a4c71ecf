"""Lotka-Volterra systems in three species, with one noise (§4.4 of Cohen and Dujardin's paper)
or independent ones.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from sepv._arguments import is_number
from sepv.errors import ProblemError
from sepv.problem import Array, HamiltoniansProblem, Nambu, Problem
from sepv.problems._common import flows, named, skew, total


def lotka_volterra(
    a: float = -2.0,
    b: float = -1.0,
    d: float = -0.5,
    nu: float = 1.0,
    mu: float = 2.0,
    noise: ArrayLike = 0.5,
) -> Problem:
    """The stochastic Lotka-Volterra system in three species,
    from §4.4 of Cohen and Dujardin's paper.

    B_12 = d y1y2, B_13 = bd y1y3, B_23 = −y2y3; H = ab y1 + y2 − a y3 + ν ln y2 − μ ln y3, in the
    octant y > 0. The initial state is (1, 1.9, 0.5). The Casimir ln y1 + bd ln y2 − d ln y3 is
    not quadratic, so that the paper's scheme (2.1) does not keep it. The default parameters, with
    c = 0.5, are those of §4.4.
    """
    if not all(is_number(v) for v in (a, b, d, nu, mu)):
        raise ProblemError(
            expected="finite parameters a, b, d, ν, μ",
            received=f"{(a, b, d, nu, mu)!r}",
            remedy="those of §4.4 are −2, −1, −0.5, 1, 2",
        )
    parts = (
        lambda y: a * b * y[0],
        lambda y: y[1] + nu * np.log(y[1]),
        lambda y: -a * y[2] - mu * np.log(y[2]),
    )
    pairs = (0, 1, d), (0, 2, b * d), (1, 2, -1.0)

    def structure(y: Array) -> Array:
        return skew(y, ((i, j, factor * y[i] * y[j]) for i, j, factor in pairs))

    return named(
        "lotka-volterra",
        noise,
        {"a": (a,), "b": (b,), "d": (d,), "nu": (nu,), "mu": (mu,)},
        dimension=3,
        structure=structure,
        hamiltonian=total(parts),
        domain=lambda y: np.all(y > 0, axis=0),
        initial=(1.0, 1.9, 0.5),
        flows=flows(3, structure, parts),
        # At some states of the orbit a step beyond Δ = 0.267 has no solution (`sepv solvability`);
        # 2⁻⁵ is an eighth.
        longest_step=2.0**-5,
        # B(y)v = −y1y2y3 (v × ∇C).
        nambu=Nambu(
            factor=lambda y: -y[0] * y[1] * y[2],
            casimir=lambda y: np.log(y[0]) + b * d * np.log(y[1]) - d * np.log(y[2]),
        ),
    )


def random_lotka_volterra(
    beta: ArrayLike = (0.5, -0.5, 0.25), noise: ArrayLike = (0.125, 0.0625, 0.125), **parameters: float
) -> Problem:
    """Lotka-Volterra in three species with independent noises: B and H_0 of `lotka_volterra`,
    H_j = y_j + β_j ln y_j.

    The initial state is (1, 1.9, 0.5), and noise j belongs to species j. The flow of dy = B(y)(∇H_0
    dt + Σ_j c_j ∇H_j ∘dW_j) keeps the Casimir of B, and all components stay positive. Q. Liu and L.
    Wang, Structure-preserving numerical method for a class of stochastic Poisson systems (J. Univ.
    Chin. Acad. Sci. 41, 2024), treat such systems. The exact flow of each H_j consists of
    exponentials.

    Parameters
    ----------
    beta : β_j, at least one for each noise.
    parameters : a, b, d, nu and mu of `lotka_volterra`, by default those of the paper's §4.4.
    """
    base = lotka_volterra(**parameters)
    c = tuple(float(v) for v in np.atleast_1d(noise))
    offsets = [float(v) for v in np.atleast_1d(beta)]
    others = tuple(partial(_hamiltonian, k, offsets[k]) for k in range(len(c)))
    return HamiltoniansProblem(
        dimension=3,
        structure=base.structure,
        hamiltonian=base.hamiltonian,
        noise=c,
        domain=base.domain,
        initial=base.initial,
        flows=base.flows,
        name="random-lotka-volterra",
        noise_hamiltonians=others,
        noise_flows=flows(3, base.structure, others),
        check=False,
    )


def _hamiltonian(k: int, b: float, y: Array) -> Array:
    return np.asarray(y[k] + b * np.log(y[k]))
