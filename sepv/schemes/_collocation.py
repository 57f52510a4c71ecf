"""Energy-preserving collocation with s Gauss nodes and the random step:
mean-square order s for (1.1).

The methods of D. Cohen and E. Hairer (Linear energy-preserving integrators for Poisson systems, BIT
51, 2011) are used with the step Δ = h + Σ_j c_j ΔŴ_j (ΔŴ_j: truncated ΔW_j). Let c_i, b_i and ℓ_i
be the s Gauss nodes, their weights and their Lagrange polynomials. A step computes the polynomial u
of degree s with u(0) = y0 and

    u̇(c_i) = Δ B(u(c_i)) b_i⁻¹ ∫₀¹ ℓ_i(τ) ∇H(u(τ)) dτ,  i = 1 … s,      y1 = u(1).

**Energy.** With the averages g_i = b_i⁻¹∫ℓ_i ∇H(u), H(y1) − H(y0) = ∫∇H(u)ᵀu̇ dτ = Σ_i b_i g_iᵀ
u̇(c_i) = Δ Σ_i b_i g_iᵀ B(u(c_i)) g_i = 0 for every skew B. **Quadratic Casimirs.** d/dτ uᵀAu has
degree 2s − 1, which Gauss nodes integrate exactly. It vanishes at each node. **Special cases.** For
quadratic H, g_i = ∇H(u(c_i)), and this is the s-stage Gauss method. With s = 1 it is (2.1).

**Order.** The deterministic order is 2s. The local error C(y)Δ^{2s+1} has the mean O(h^{s+1}) and
the root mean square O(h^{s+1/2}), so that Milstein's theorem gives mean-square order s and weak
order s. Truncating the increments as in Remark 2.1 adds an error of order k/2 in h, so that order s
needs k ≥ 2s. With k = 2s this error is larger than the method's own from three stages on
(`sepv.exact._truncation_error`). The default is therefore k = 4s.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from sepv._arguments import require_whole
from sepv.core.equations import Equations, Evaluation, iterate, merge
from sepv.core.newton import Root, Status, into_domain
from sepv.core.step import Solution
from sepv.problem import (
    Array,
    Problem,
    argument_rounding,
    average_gradient,
    hessian,
    linear_solve,
    matmul,
    matvec,
    structure_slope,
)
from sepv.record import EPS
from sepv.schemes._one_step import ENERGY_PRESERVING, Solved, one_step
from sepv.schemes._scheme import Scheme
from sepv.schemes._tableaux import MAX_STAGES, exact_nodes, gauss_tableau, moments

# For H that is not a polynomial: the first quadrature has s + FIRST_NODES nodes, and the largest at
# most MAX_NODES, as in `sepv.core.average`.
FIRST_NODES, MAX_NODES = 4, 128


class _Stages:
    """The equations of the stages z_i = u̇(c_i) = Δ B(Y_i) g_i of a batch of M steps from y0,
    with Y_i = u(c_i).

    The stages z are an array (d, s, M), which the solver gets as (d·s, M). `lanes` are the numbers
    of the paths in a call. If `averaged` is False, g_i is not an average but ∇H(Y_i), as in the
    Gauss method.
    """

    def __init__(
        self, problem: Problem, stages: int, y0: Array, delta: Array, nodes: int, averaged: bool = True
    ) -> None:
        self.problem, self.stages, self.y0, self.delta, self.nodes = problem, stages, y0, delta, nodes
        self.averaged = averaged
        self.A, self.b = gauss_tableau(stages).A, gauss_tableau(stages).b
        self.work = np.zeros((2, delta.size), dtype=np.int64)  # evaluations of ∇H and of B

    def polynomial(self, z: Array, lanes: np.ndarray, integrals: Array) -> Array:
        """The collocation polynomial u (d, N, M) at N points τ_n; `integrals` (N, s)
        has the entries ∫₀^{τ_n} ℓ_j.
        """
        u = np.repeat(self.y0[:, None, lanes], integrals.shape[0], axis=1)
        for j in range(self.stages):
            u += integrals[:, j, None] * z[:, j, None]
        return u

    def averages(self, z: Array, lanes: np.ndarray, nodes: int) -> tuple[Array, Array]:
        """The averages g_i = b_i⁻¹∫ℓ_i ∇H(u) (d, s, M) by Gauss quadrature, and a scale (M,)
        of their rounding.
        """
        W, P = moments(self.stages, nodes)
        u = self.polynomial(z, lanes, P)
        gradients = self.problem.gradient(u)
        if self.problem.domain is not None:
            gradients = np.where(self.problem.domain(u), gradients, np.nan)
        total = np.zeros_like(z)
        for n in range(nodes):
            total += W[:, n, None] * gradients[:, None, n]
        return total, np.max(np.abs(gradients), axis=(0, 1)) * float(np.max(np.sum(np.abs(W), axis=1)))

    def evaluate(self, flat: Array, lanes: np.ndarray) -> Evaluation:
        """R(z) for z = `flat` (d·s, M): Δ B(Y_i) g_i for each stage i.
        On demand the result also gives ∂R/∂z.
        """
        d, s = self.problem.dimension, self.stages
        z = flat.reshape(d, s, -1)
        Y = self.polynomial(z, lanes, self.A)
        if s == 1 and self.averaged:
            # u is the segment from y0 to y1, for which problems may have closed forms.
            mean = average_gradient(self.problem, self.y0[:, lanes], self.y0[:, lanes] + z[:, 0])
            g, cost, reliable = mean.value[:, None], mean.evaluations, mean.reliable
        else:
            g = self.averages(z, lanes, self.nodes)[0] if self.averaged else self.problem.gradient(Y)
            cost, reliable = np.full(z.shape[2], self.nodes), np.ones(z.shape[2], dtype=bool)
        value = self.delta[lanes] * matvec(self.problem.structure(Y), g)
        np.add.at(self.work[0], lanes, cost)
        np.add.at(self.work[1], lanes, s)
        return Evaluation(value.reshape(flat.shape), reliable, lambda: self.jacobian(z, lanes, Y, g))

    def jacobian(self, z: Array, lanes: np.ndarray, Y: Array, g: Array) -> Array:
        """The derivative K (d·s, d·s, M) of the right sides Δ B(Y_i) g_i by the z_j;
        Newton's matrix is 1 − K.

        K = Δ(a_ij B′(Y_i)[·]g_i + B(Y_i) b_i⁻¹∫ℓ_i A_j H″(u)) with A_j(τ) = ∫₀^τ ℓ_j and
        a_ij = A_j(c_i). The average of H″ uses few nodes, which changes the speed of
        Newton's iteration and not its limit.
        """
        d, s = self.problem.dimension, self.stages
        few = s if not self.averaged else s + 4 if self.problem.degree is None else min(self.nodes, s + 2)
        W, P = moments(s, few)
        curvature = hessian(self.problem, self.polynomial(z, lanes, P))
        averaged = np.zeros((d, d, s, s, z.shape[2]))
        for n in range(P.shape[0]):
            averaged += (W[:, n, None] * P[n])[..., None] * curvature[:, :, None, None, n]
        B, turned = self.problem.structure(Y), structure_slope(self.problem, Y, g)
        K = matmul(B[:, :, :, None], averaged) + turned[:, :, :, None] * self.A[..., None]
        return np.asarray((self.delta[lanes] * K).swapaxes(1, 2).reshape(d * s, d * s, -1))

    def inside(self, flat: Array, lanes: np.ndarray) -> np.ndarray:
        """True for each path whose y1, stages and quadrature points u(τ_n) lie in the domain."""
        assert self.problem.domain is not None
        z = flat.reshape(self.problem.dimension, self.stages, -1)
        points = np.concatenate([self.A, moments(self.stages, self.nodes)[1], self.b[None]])
        inside = self.problem.domain(self.polynomial(z, lanes, points))
        return np.asarray(np.all(inside, axis=0), dtype=bool)

    def start(self, equations: Equations) -> Array:
        """The start of the iteration (d·s, M): Newton's step from z = 0,
        shortened to stay in the domain, or z = 0.

        At z = 0 the polynomial u is y0, so that ∇H and B are evaluated once for all nodes.
        """
        d, s, problem = self.problem.dimension, self.stages, self.problem
        B, g = problem.structure(self.y0), problem.gradient(self.y0)
        slope = self.delta * (structure_slope(problem, self.y0, g) + matmul(B, hessian(problem, self.y0)))
        K = (self.A[..., None] * slope[:, :, None, None]).swapaxes(1, 2).reshape(d * s, d * s, -1)
        field = np.repeat((self.delta * matvec(B, g))[:, None], s, axis=1).reshape(d * s, -1)
        z = linear_solve(np.eye(d * s)[..., None] - K, field)
        usable = np.all(np.isfinite(z), axis=0) & np.any(field != 0, axis=0)
        z = np.where(usable, z, 0.0)
        moved, inside = into_domain(equations.inside, np.zeros_like(z), -z, np.arange(z.shape[1]))
        return np.where(inside, moved, 0.0)


def solve_stages(
    problem: Problem, stages: int, y0: Array, delta: Array, *, averaged: bool = True
) -> Solution:
    """Solve one step of a batch of M paths from y0 (d, M) with random steps `delta` (M,).

    If `averaged` is False, the step is that of the Gauss method, with g_i = ∇H(u(c_i)).

    For a polynomial H of degree ν, quadrature with ⌈sν/2⌉ nodes is exact. For any other H the
    averages of ∇H with N and with 3N/2 nodes are compared. If they differ by more than rounding,
    the step is solved again with 2N nodes. A path for which MAX_NODES nodes are too few gets the
    status QUADRATURE.
    """
    exact = problem.degree is not None or stages == 1 or not averaged
    nodes = exact_nodes(stages, problem.degree or 2) if exact else stages + FIRST_NODES
    nodes = nodes if averaged else stages
    size = np.repeat(np.abs(y0)[:, None], stages, axis=1).reshape(-1, y0.shape[1])
    with np.errstate(all="ignore"):
        system = _Stages(problem, stages, y0, delta, nodes, averaged)
        equations = Equations(size, system.evaluate, system.inside if problem.domain is not None else None)
        root = iterate(equations, system.start(equations))
        np.add(root.iterations, 1, out=root.iterations)  # that of the start
        system.work += 1
        inexact = np.arange(y0.shape[1]) if not exact else np.zeros(0, dtype=np.intp)
        while inexact.size:
            inexact = inexact[root.status[inexact] == Status.CONVERGED]
            inexact = inexact[~_agrees(system, root, inexact)]
            system.nodes *= 2
            if system.nodes > MAX_NODES:
                root.status[inexact] = Status.QUADRATURE
                break
            if inexact.size:
                merge(root, iterate(equations, root.value[:, inexact], inexact), inexact)
        z = root.value.reshape(*y0.shape[:1], stages, -1)
        update = system.b[0] * z[:, 0]
        for j in range(1, stages):
            update = update + system.b[j] * z[:, j]
    gradients, structures = system.work
    counts = root.iterations, gradients, structures
    return Solution(y0 + update, root.residual, *counts, root.status, change=update)


def _agrees(system: _Stages, root: Root, lanes: np.ndarray) -> np.ndarray:
    """True for each path of `lanes` whose averages of ∇H with N nodes and with 3N/2 nodes agree to
    rounding.
    """
    nodes = system.nodes + system.nodes // 2
    z = root.value[:, lanes].reshape(system.problem.dimension, system.stages, -1)
    system.work[0, lanes] += nodes
    finer, size = system.averages(z, lanes, nodes)
    used = system.averages(z, lanes, system.nodes)[0]
    y0, y1 = system.y0[:, lanes], system.y0[:, lanes] + z.sum(axis=1) / system.stages
    rounding = nodes * EPS * size + 4 * argument_rounding(system.problem, y0, y1)
    return np.asarray(np.max(np.abs(finer - used), axis=(0, 1)) <= rounding)


@lru_cache(maxsize=8)
def collocation(stages: int) -> Scheme:
    """The energy-preserving collocation scheme with s stages, s = 1 … 6;
    any other number raises UsageError.

    Increments are truncated to √(2kh|ln h|) (Remark 2.1), with k = 4s for s > 1 and the paper's
    k = 2 for s = 1.
    """
    source = "Cohen and Hairer (2011), with the random step"
    return staged("collocation", stages, ENERGY_PRESERVING, source, averaged=True)


def staged(name: str, stages: int, claims: frozenset[str], source: str, *, averaged: bool) -> Scheme:
    """The `Scheme` of an s-stage method, called name-s, such as "gauss-2";
    its steps are solved by `solve_stages`.
    """
    beyond = "s stages have mean-square order s; beyond 6 rounding is reached at any useful step size"
    s = require_whole("stages", stages, beyond, 1, MAX_STAGES)

    def solve(problem: Problem, y: Array, h: float, dW: Array) -> Solution:
        return solve_stages(problem, s, y, problem.random_step(h, dW), averaged=averaged)

    return one_step(f"{name}-{s}", Solved(solve), claims, source, float(s), stages=s)
