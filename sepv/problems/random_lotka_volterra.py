"""Lotka-Volterra in three species with independent noises: B and H_0 of §4.4, H_j = y_j + β_j ln y_j.

dy = B(y)(∇H_0 dt + Σ_j c_j ∇H_j ∘dW_j) keeps every component positive, and the Casimir ln y_1 + bd ln y_2 − d ln y_3 of
B: a stochastic Poisson system as in Q. Liu and L. Wang, Structure-preserving numerical method for a class of stochastic
Poisson systems (J. Univ. Chin. Acad. Sci. 41, 2024). Each H_j has an exact flow, exponentials.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from sepv.hamiltonians import HamiltoniansProblem
from sepv.problem import Array, Problem
from sepv.problems._parts import flows
from sepv.problems.lotka_volterra import lotka_volterra


def random_lotka_volterra(
    beta: Sequence[float] = (0.5, -0.5, 0.25), noise: Sequence[float] = (0.125, 0.0625, 0.125)
) -> Problem:
    """The system from (1, 1.9, 0.5) with the parameters of §4.4 and a noise for each species."""
    base = lotka_volterra()
    others = tuple(partial(_hamiltonian, k, beta[k]) for k in range(len(tuple(noise))))
    return HamiltoniansProblem(
        dimension=3,
        structure=base.structure,
        hamiltonian=base.hamiltonian,
        noise=tuple(noise),
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
