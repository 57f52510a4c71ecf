"""Three point vortices in the plane, carried by their own flow and by a random flow.

H_0 = −(1/4π) Σ_{k<l} Γ_kΓ_l ln|x_k − x_l|² and B = J/Γ_k in the plane of vortex k (H.
Aref, Annu. Rev. Fluid Mech. 15, 1983). The random flow has stream functions ψ_1 = sin x
and ψ_2 = cos y: H_j = Σ_k Γ_k ψ_j(x_k) adds Σ_j c_j J∇ψ_j(x_k) ∘dW_j to dx_k, which is
transport noise as in D. Holm (Proc. R. Soc. A 471, 2015). B is constant.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sepv.problem import Array, HamiltoniansProblem, Problem
from sepv.problems._common import skew


def point_vortices(
    strengths: Sequence[float] = (1.0, 0.5, -0.75), noise: Sequence[float] = (0.25, 0.25)
) -> Problem:
    """Vortices of `strengths` Γ_k with the state y = (x_1, y_1, x_2, …), from (0, 0), (1, 0.25)
    and (0.25, 1).
    """
    G = [float(g) for g in strengths]
    n = len(G)

    def structure(y: Array) -> Array:
        return skew(y, ((2 * k, 2 * k + 1, 1 / g) for k, g in enumerate(G)))

    def hamiltonian(y: Array) -> Array:
        total: Array = 0 * y[0]
        for k in range(n):
            for m in range(k + 1, n):
                square = (y[2 * k] - y[2 * m]) ** 2 + (y[2 * k + 1] - y[2 * m + 1]) ** 2
                total = total - (G[k] * G[m] / (4 * np.pi)) * np.log(square)
        return total

    def waves_in_x(y: Array) -> Array:
        return np.asarray(sum(g * np.sin(y[2 * k]) for k, g in enumerate(G)))

    def waves_in_y(y: Array) -> Array:
        return np.asarray(sum(g * np.cos(y[2 * k + 1]) for k, g in enumerate(G)))

    return HamiltoniansProblem(
        dimension=2 * n,
        structure=structure,
        hamiltonian=hamiltonian,
        noise=tuple(noise),
        noise_hamiltonians=(waves_in_x, waves_in_y),
        initial=(0.0, 0.0, 1.0, 0.25, 0.25, 1.0)[: 2 * n],
        name="point-vortices",
    )
