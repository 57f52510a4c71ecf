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
from sepv.problem import Array, Flow, Function, Problem
from sepv.problems.lotka_volterra import exponential, lotka_volterra, pairs_of


def random_lotka_volterra(
    beta: Sequence[float] = (0.5, -0.5, 0.25), noise: Sequence[float] = (0.125, 0.0625, 0.125)
) -> Problem:
    """The system from (1, 1.9, 0.5) with the parameters of §4.4 and a noise for each species."""
    base = lotka_volterra()
    count = len(tuple(noise))
    return HamiltoniansProblem(
        dimension=3,
        structure=base.structure,
        hamiltonian=base.hamiltonian,
        gradient=base.gradient,
        noise=tuple(noise),
        hessian=base.hessian,
        structure_derivative=base.structure_derivative,
        domain=base.domain,
        initial=base.initial,
        flows=base.flows,
        name="random-lotka-volterra",
        noise_hamiltonians=tuple(partial(_hamiltonian, k, beta[k]) for k in range(count)),
        noise_gradients=tuple(partial(_gradient, k, beta[k]) for k in range(count)),
        noise_hessians=tuple(partial(_hessian, k, beta[k]) for k in range(count)),
        noise_flows=tuple(_flow(k, beta[k]) for k in range(count)),
        check=False,
    )


def _hamiltonian(k: int, b: float, y: Array) -> Array:
    return np.asarray(y[k] + b * np.log(y[k]))


def _gradient(k: int, b: float, y: Array) -> Array:
    found = np.zeros_like(y)
    found[k] = 1 + b / y[k]
    return found


def _hessian(k: int, b: float, y: Array) -> Array:
    found = np.zeros((3, *y.shape), dtype=y.dtype)
    found[k, k] = -b / (y[k] * y[k])
    return found


def _flow(k: int, b: float) -> Flow:
    slope: Function = lambda x: x + b  # noqa: E731  (y_k ∂_kH_k)
    return exponential(k, pairs_of(), slope)
