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

The order of a scheme that uses no random numbers but the increments ΔW_j depends on the brackets of
the noises, [f_i, f_j] = f_j′f_i − f_i′f_j (`column`). It is 1 if all brackets vanish, as for one
noise, and ½ in general.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np

from sepv.core.arrays import Array, matmul, matvec
from sepv.core.problem import Function, combined_gradient, differences, hessian
from sepv.errors import ProblemError, Skipped, SystemsError, UsageError
from sepv.problem._checks import sample_states
from sepv.problem._damped import DampedProblem
from sepv.problem._derived import derive
from sepv.problem._directional import structure_slope
from sepv.problem._drift import damping_matrix, drift
from sepv.problem._problem import Flow, Problem, constant, require_one_for_each_noise
from sepv.problem._structures import ClosedForm, CommutingStructure, StructuresProblem

# The largest bracket that counts as zero, relative to its factors. Slopes by differences may have a
# relative error of 1e-8, and a bracket that does not vanish is far larger at some sample state.
VANISHES = 1e-6


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
        Γ of a friction −Γy dt in the drift, beside additive noise by `noise_vectors`
        (`sepv.problem.friction`).

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
        if self.damping and (self.noise_hamiltonians or self.noise_gradients):
            raise ProblemError(
                expected="friction −Γy dt beside noise_vectors",
                received="damping, and noises with Hamiltonians of their own",
                remedy="give every noise its vector B∇H_j",
            )
        if self.noise_vectors:
            vectors = tuple(constant("noise_vectors", g, (self.dimension,)) for g in self.noise_vectors)
            object.__setattr__(self, "noise_vectors", vectors)
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

    @property
    def structures(self) -> Sequence[Function]:
        raise UsageError(
            expected="a scheme for several Hamiltonians, such as stochastic-midpoint",
            received=f"a scheme that takes the structures of noises, which {self.name} does not have",
            remedy="use a scheme with systems='hamiltonians': with {H_0, H_j} ≠ 0 no scheme keeps H_0",
        )

    @property
    def gradients(self) -> Sequence[Function]:
        if self.noise_vectors:
            raise Skipped(f"the noise of {self.name} has vectors, and no Hamiltonians")
        return (self.gradient, *self.noise_gradients)

    @property
    def hessians(self) -> Sequence[Function]:
        drift, *_ = super().hessians
        if self.noise_vectors:
            return (drift, *[self._no_curvature] * self.noises)
        return (
            drift,
            *(self.noise_hessians or (partial(differences, self, G) for G in self.noise_gradients)),
        )

    def _no_curvature(self, y: Array) -> Array:
        return np.zeros((self.dimension, *y.shape))

    def random_step(self, h: float, dW: Array) -> Array:  # noqa: ARG002  (the signature of `Problem`)
        """Raise SystemsError: a step has the random length Δ = h + Σ c_j ΔW_j for a single
        Hamiltonian only.
        """
        if self.damping:
            raise SystemsError(
                expected="a scheme for friction, such as baoab",
                received=f"a scheme for (1.1), which would leave out the friction of {self.name}",
                remedy="use a scheme with systems='friction'",
            )
        raise SystemsError(
            expected="a scheme for several Hamiltonians, such as stochastic-midpoint",
            received=f"a scheme that reduces the noise of {self.name} to one random step",
            remedy="use a scheme with systems='hamiltonians': with several Hamiltonians there is no such step",
        )


def is_several(problem: Problem) -> bool:
    """True if the system is not dy = B∇H(dt + Σ c_j∘dW_j),
    so that a step has no random length Δ = h + Σ c_jΔW_j.
    """
    return isinstance(problem, (StructuresProblem, HamiltoniansProblem, DampedProblem))


def has_structures(problem: Problem) -> bool:
    """True if the fields of the noises are G_j∇H, where not every G_j comes from a Hamiltonian
    H_j.
    """
    return not all(isinstance(G, CommutingStructure) for G in getattr(problem, "noise_structures", ()))


def noise_vectors(problem: Problem) -> Array:
    """The constant vectors g_j of additive noise, as rows (m, d); shape (0, d)
    if the noise is not given by vectors.
    """
    return np.reshape(getattr(problem, "noise_vectors", ()), (-1, problem.dimension))


def noise_gradients(problem: Problem) -> Sequence[Function]:
    """The gradients ∇H_1, …, ∇H_m of the noise Hamiltonians; for dy = B∇H(dt + Σ c_j∘dW_j)
    each of them is ∇H.

    Raises Skipped if the noises are given by vectors, or by structures that do not come from
    Hamiltonians.
    """
    return problem.gradients[1:]


def hamiltonian_field(problem: Problem, y: Array, parts: Array) -> Array:
    """The field B(y)(h∇H_0 + Σ c_j ΔW_j ∇H_j) of a step, (d, M),
    for problems that have `noise_gradients`.

    `parts` (1 + m, M) holds h and the c_j ΔW_j.
    """
    return matvec(problem.structure(y), combined_gradient(problem, y, parts))


def noise_hessian(problem: Problem, j: int, y: Array) -> Array:
    """The second derivatives of the Hamiltonian of noise number j = 0, …, m − 1 at y, (d, d, ...).

    If the problem does not give them, they are differences of the gradient. For noise vectors they
    are 0.
    """
    return problem.hessians[1 + j](y)


def noise_field(problem: Problem, j: int, y: Array) -> Array:
    """The field of noise number j = 0, …, m − 1 without its c_j, (d, ...): B∇H_j, G_j∇H,
    or the vector g_j.
    """
    if has_structures(problem):
        return matvec(problem.structures[1 + j](y), problem.gradient(y))
    if len(vectors := noise_vectors(problem)):
        return np.broadcast_to(vectors[j].reshape(-1, *(1,) * (y.ndim - 1)), y.shape)
    return matvec(problem.structure(y), noise_gradients(problem)[j](y))


def noise_slope(problem: Problem, j: int, y: Array) -> Array:
    """The derivative f_j′(y), (d, d, ...), of the field f_j of noise number j (`noise_field`)."""
    if has_structures(problem):
        turned = structure_slope(problem, y, problem.gradient(y), 1 + j)
        return turned + matmul(problem.structures[1 + j](y), hessian(problem, y))
    if len(noise_vectors(problem)):
        return np.zeros((problem.dimension, *y.shape))
    turned = structure_slope(problem, y, noise_gradients(problem)[j](y))
    return turned + matmul(problem.structure(y), noise_hessian(problem, j, y))


def bracket(problem: Problem, i: int, j: int, y: Array) -> Array:
    """The Lie bracket [f_i, f_j] = f_j′f_i − f_i′f_j of two noise fields without their factors c,
    (d, ...).

    The bracket multiplies the Lévy area A_ij in the expansion of the solution.
    """
    first = matvec(noise_slope(problem, j, y), noise_field(problem, i, y))
    return first - matvec(noise_slope(problem, i, y), noise_field(problem, j, y))


def drift_bracket(problem: Problem, j: int, y: Array) -> Array:
    """The Lie bracket [f_0, f_j] of the drift and the field of noise number j without its factor
    c_j, (d, ...).

    The bracket multiplies A_0j = ½∫(s dW_j − W_j ds) in the expansion of the solution.
    """
    turned = structure_slope(problem, y, problem.gradient(y))
    drift_slope = turned + matmul(problem.structure(y), hessian(problem, y))
    drift_slope = drift_slope - damping_matrix(problem).reshape(*turned.shape[:2], *(1,) * (y.ndim - 1))
    pushed = matvec(noise_slope(problem, j, y), drift(problem, y))
    return pushed - matvec(drift_slope, noise_field(problem, j, y))


def ito_drift(problem: Problem, y: Array) -> Array:
    """The drift of the Itô form of a problem, f_0 + ½ Σ_j c_j² f_j′f_j, (d, ...),
    with f_0 = B∇H_0 − Γy.
    """
    total = drift(problem, y)
    for j, c in enumerate(problem.c):
        total = total + 0.5 * c * c * matvec(noise_slope(problem, j, y), noise_field(problem, j, y))
    return total


def column(problem: Problem) -> str:
    """The kind of a problem's noise, on which claims of order depend: "additive", "one",
    "commutative" or "general".

    In "additive" noise all fields are constant. "one" is one noise, or several noises of one H, as
    in (1.1). For "commutative" noise all brackets of fields are 0. Fields are tested at sample
    states only, and may differ elsewhere.
    """
    if not is_several(problem):
        return "one"
    acting = [int(j) for j in np.flatnonzero(problem.c)]
    if acting and _vanish(problem, lambda y: [noise_slope(problem, j, y) for j in acting], per_field=True):
        return "additive"
    if len(acting) < 2:
        return "one"
    pairs = list(combinations(acting, 2))
    if _vanish(problem, lambda y: [bracket(problem, i, j, y) for i, j in pairs]):
        return "commutative"
    return "general"


def commutes(problem: Problem) -> bool:
    """True if the drift and all noise fields commute: y(T) is then the flow of T f_0 + Σ c_j W_j(T)
    f_j at time 1.
    """

    def brackets(y: Array) -> list[Array]:
        return [drift_bracket(problem, int(j), y) for j in np.flatnonzero(problem.c)]

    return column(problem) != "general" and _vanish(problem, brackets)


def _vanish(problem: Problem, values: Callable[[Array], list[Any]], *, per_field: bool = False) -> bool:
    """True if all vectors or matrices `values(y)` are at most VANISHES times a scale,
    at every sample state y.

    The scale is about max|f_j| · max|f_j′| for the noise fields f_j at y. With `per_field` it is
    max|f_j|/max(1, |y|).
    """
    acting = [int(j) for j in np.flatnonzero(problem.c)]
    for y in sample_states(problem):
        lanes = y[:, None]
        field = max((float(np.max(np.abs(noise_field(problem, j, lanes)))) for j in acting), default=0.0)
        slope = max((float(np.max(np.abs(noise_slope(problem, j, lanes)))) for j in acting), default=0.0)
        unit = field / max(1.0, float(np.max(np.abs(y))))
        size = unit if per_field else max(field, unit) * max(slope, unit)
        if max((float(np.max(np.abs(v))) for v in values(lanes)), default=0.0) > VANISHES * size:
            return False
    return True
