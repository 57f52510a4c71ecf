"""Lotka-Volterra in three species with independent noises: B and H_0 of §4.4, H_j = y_j + β_j ln y_j.

dy = B(y)(∇H_0 dt + Σ_j c_j ∇H_j ∘dW_j) keeps every component positive, and the Casimir ln y_1 + bd ln y_2 − d ln y_3 of
B: a stochastic Poisson system as in Q. Liu and L. Wang, Structure-preserving numerical method for a class of stochastic
Poisson systems (J. Univ. Chin. Acad. Sci. 41, 2024). Each H_j has an exact flow, exponentials.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from sepv.problem import Array, HamiltoniansProblem, Problem
from sepv.problems._lotka_volterra import lotka_volterra
from sepv.problems._sum_of_parts import flows


def random_lotka_volterra(
    beta: ArrayLike = (0.5, -0.5, 0.25), noise: ArrayLike = (0.125, 0.0625, 0.125), **parameters: float
) -> Problem:
    """The system from (1, 1.9, 0.5) with a noise for each of the first species.

    Parameters
    ----------
    beta : β_j, for as many species at least as there are noises.
    parameters : a, b, d, nu and mu of `lotka_volterra`; by default those of §4.4.
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
