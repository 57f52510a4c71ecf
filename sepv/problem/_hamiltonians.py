"""Systems with several Hamiltonians, dy = B(y)(∇H_0 dt + Σ_j c_j ∇H_j ∘dW_j),
for any brackets {H_0, H_j}.

All f_j = B∇H_j are Hamiltonian vector fields of the same structure B. The exact flow keeps the
Casimirs of B. If B satisfies Jacobi's identity, it is a Poisson map (J. Hong, J. Ruan, L. Sun
and L. Wang, Structure-preserving numerical methods for stochastic Poisson systems, Commun.
Comput. Phys. 29, 2021). H_0 is not kept in general. By the Itô form

    dy = (f_0 + ½ Σ_j c_j² f_j′f_j) dt + Σ_j c_j f_j dW_j,

the mean of H_0 changes at the rate LH_0 = ½ Σ_j c_j² {{H_0, H_j}, H_j} with {F, G} = ∇FᵀB∇G. If all
{H_0, H_j} = 0, H_0 is kept, and the system can also be written with several structures
(`sepv.problem._structures`).

Additive noise need not be in the image of B: in dy = B(y)∇H_0 dt + Σ_j c_j g_j dW_j the g_j are any
constant vectors (D. Cohen and G. Vilmart, Drift-preserving numerical integrators for stochastic
Poisson systems, arXiv 2005.13991). Then no Casimir is kept. Let F be H_0 or a Casimir of B. Because
∇FᵀB∇H_0 = 0, the generator L of the system gives

    LF = ½ Σ_j c_j² g_jᵀF″g_j.

If F is quadratic along the g_j, LF is a constant, and E[F] grows linearly in time (trace formula).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sepv.core.problem import Channel, Function
from sepv.errors import ProblemError
from sepv.problem._derived import derive
from sepv.problem._problem import Flow, Problem, constant, require_one_for_each_noise
from sepv.problem._structures import ClosedForm


@dataclass(frozen=True, eq=False, repr=False)
class HamiltoniansProblem(Problem):
    """A system dy = B(∇H_0 dt + Σ_j c_j ∇H_j ∘dW_j); `hamiltonian`,
    `gradient` and the other parts are those of H_0.

    Parameters
    ----------
    noise_hamiltonians : callables, (d, ...) -> (...)
        H_1, …, H_m, one for each coefficient in `noise`.
    noise_gradients : callables, (d, ...) -> (d, ...), optional
        ∇H_1, …, ∇H_m. If they are not given, they and the second derivatives are derived from the
        H_j.
    noise_hessians : callables, (d, ...) -> (d, d, ...), optional
        Without them Newton's Jacobian is formed from differences.
    noise_flows : callables (y, t) -> (d, ...), optional
        Exact flows of B∇H_1, …, B∇H_m at times t (...), for splitting methods.
    closed_form : callable (y0, T, W) -> (d, M), optional
        The exact solution y(T) from y0 with W = W(T), (m, M), if the flows commute.
    noise_vectors : sequence of (d,) vectors, optional
        g_1, …, g_m of additive noise Σ c_j g_j dW_j, in the place of the B∇H_j. `casimirs` are
        still those of B.
    damping : (d, d) matrix, optional
        Γ of a friction −Γy dt in the drift, beside noises of either kind. `sepv.problem.friction`
        makes one at a temperature, with `noise_vectors`.

    Raises
    ------
    ProblemError
        As for `Problem`; each H_j is checked like H.

    Examples
    --------
    A rigid body whose second axis is disturbed:

    >>> import numpy as np
    >>> import sepv
    >>> from sepv.problem import HamiltoniansProblem
    >>> body = sepv.problems.rigid_body()
    >>> problem = HamiltoniansProblem(
    ...     3, body.structure, lambda y: (y[0] ** 2 + y[1] ** 2 / 2 + y[2] ** 2 / 3) / 2,
    ...     noise=(0.5,), noise_hamiltonians=(lambda y: y[1] ** 2 / 2,),
    ...     casimirs=body.casimirs, initial=(0.8, 0.6, 0.1),
    ... )
    >>> path = sepv.integrate("stochastic-midpoint", problem, h=0.125, T=1.0)
    >>> changes = np.ptp(np.sum(path.y**2, axis=0)), np.ptp(problem.hamiltonian(path.y))
    >>> bool(changes[0] < 1e-14), bool(changes[1] < 1e-14)
    (True, False)
    """

    noise_hamiltonians: tuple[Function, ...] = ()
    noise_gradients: tuple[Function, ...] = ()
    noise_hessians: tuple[Function, ...] = ()
    noise_flows: tuple[Flow, ...] = ()
    closed_form: ClosedForm | None = None
    noise_vectors: tuple[Any, ...] = ()
    damping: Any = 0.0

    def __post_init__(self, check: bool) -> None:
        super().__post_init__(check)
        if np.ndim(self.damping) or self.damping:
            rows = constant("damping", self.damping, (self.dimension, self.dimension))
            # The number 0 and a tuple without rows are false: `problem.damping` is true where there
            # is friction.
            object.__setattr__(self, "damping", tuple(map(tuple, rows.tolist())) if rows.any() else 0.0)
        vectors = tuple(constant("noise_vectors", g, (self.dimension,)) for g in self.noise_vectors)
        object.__setattr__(self, "noise_vectors", vectors)
        if vectors:
            require_one_for_each_noise(self, "noise_vectors", "g_j")
            if self.noise_hamiltonians:
                raise ProblemError(
                    expected="noise_hamiltonians or noise_vectors",
                    received="both",
                    remedy="leave out the H_j, and give every noise its vector B∇H_j",
                )
            self._checked_invariants(check)
            return
        if not self.noise_gradients:
            derived = [derive(self.dimension, self.structure, H) for H in self.noise_hamiltonians]
            object.__setattr__(self, "noise_gradients", tuple(f.gradient for f in derived))
            object.__setattr__(self, "noise_hessians", tuple(f.hessian for f in derived))
        for key in ("noise_hamiltonians", "noise_gradients", "noise_hessians", "noise_flows"):
            if getattr(self, key) or key in ("noise_hamiltonians", "noise_gradients"):
                require_one_for_each_noise(self, key, "H_j")
        if check:
            checked = tuple(
                Problem(
                    self.dimension, self.structure, H, self.noise_gradients[j], domain=self.domain,
                    hessian=self.noise_hessians[j] if self.noise_hessians else None, initial=self.initial,
                    name=f"{self.name}, H_{j + 1}",
                ).hamiltonian
                for j, H in enumerate(self.noise_hamiltonians)
            )  # fmt: skip
            object.__setattr__(self, "noise_hamiltonians", checked)
        self._checked_invariants(check)

    def _channels(self) -> tuple[Channel, ...]:
        own, *_ = super()._channels()
        first = own._replace(damping=self.damping)
        if self.noise_vectors:
            return (first, *(Channel(vector=g) for g in self.noise_vectors))
        second = self.noise_hessians or (None,) * self.noises
        parts = zip(self.noise_hamiltonians, self.noise_gradients, second, strict=True)
        noises = (own._replace(hamiltonian=H, gradient=g, hessian=K, keeping=None) for H, g, K in parts)
        return (first, *noises)
