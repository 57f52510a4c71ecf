"""Systems with a skew structure for each noise, dy = B(y)∇H dt + Σ_j c_j G_j(y)∇H ∘dW_j (Cohen and
Dujardin, §1).

The flow keeps H and every Casimir common to B and all G_j. A scheme holds the increments of a step
fixed, and solves dy = A(y)∇H dt over the time 1 with the structure A = h B + Σ_j c_j ΔW_j G_j.

A system with several Hamiltonians, dy = B∇H_0 dt + Σ_j c_j B∇H_j ∘dW_j, has this form if all {H_0,
H_j} = 0. Let v = B∇H_j and w = ∇H_0, so that vᵀw = {H_0, H_j} = 0. Then S_j = (v wᵀ − w vᵀ)/|w|²
has S_j∇H_0 = B∇H_j. If w is only the part of ∇H_0 orthogonal to the gradients of all Casimirs C of
B, S_j∇H_0 is still v, and each C is a Casimir of S_j.

**Critical points of H_0.** At a state with w = 0 and v ≠ 0 no such S_j exists. The exact flows of
the H_j keep the set {w = 0}, and move a solution inside this set. A scheme that multiplies S_j by
an average m of ∇H_0 cannot follow that motion. Let v, w and S_j be evaluated at the midpoint ȳ of
the step, and m = w + e. Then vᵀw = 0 gives

    S_j m − v = (v (wᵀe) − w (vᵀe))/|w|²,      |S_j m − v| ≤ |v| |e|/|w|.

For smooth H_0, |e| ≤ |H_0‴| |y1 − y0|²/24; for quadratic H_0, |e| is a rounding of ∇H_0. S_j m
approximates v = B∇H_j only if |e| is far below |w|. Near a curved set of critical points |e| and
|w| have the same size, however small the step. An example in the plane is H_0 = ½(I − 1)², H_1 = I
with I = ½|y|²: for y0 and y1 with the same I = I_0, m = (I_0 − 1 − |y1 − y0|²/12)ȳ and w = (I_0 − 1
− |y1 − y0|²/8)ȳ. With I_0 = 1, m = ⅔w, so that a step turns by two thirds of the exact angle for
every h. Therefore |S_j m − v| is computed for each solved step (`CommutingStructure.missed`), and
the step fails if this distance exceeds a quarter of |v|.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sepv.core.arrays import EPS, TINY, Array, majorant, matvec
from sepv.core.problem import Channel, Function
from sepv.errors import ProblemError
from sepv.problem._checks import sample_states
from sepv.problem._directions import directions
from sepv.problem._fields import casimir_gradients
from sepv.problem._problem import Problem, require_one_for_each_noise
from sepv.problem._products import dot

# The function of y0 (d,), T and W(T) (m, M) that gives y(T), for systems whose flows commute.
ClosedForm = Callable[[Array, float, Array], Array]
# The largest {H_0, H_j} relative to |∇H_0||B∇H_j| that counts as zero: a few hundred roundings.
BRACKET_TOLERANCE = 1e-12
# The largest error |S_j∇̄H_0 − B∇H_j| that a step may have, relative to |B∇H_j|. Next to a curved
# set of nondegenerate critical points this error is 1/3 for every h: over a chord ∇̄H_0 is the mean
# of a parabola, 1/12, and w is its value in the middle, 1/8. Elsewhere it is of the order of |y1
# − y0|², and a step with an error of 1/4 is useless anyway.
MISSED_MAX_SHARE = 0.25
# S_j counts as undefined if w is below its rounding, the first factor times the terms of w, but v
# is above the second factor times the terms of v. The margin is wide because both w and v vanish
# next to an isolated critical point.
ROUNDING_OF_W, ROUNDING_OF_V = 16 * EPS, 1024 * EPS


@dataclass(frozen=True, eq=False, repr=False)
class StructuresProblem(Problem):
    """A system dy = B∇H dt + Σ_j c_j G_j∇H ∘dW_j; `structure`,
    `hamiltonian` and other parts are those of the drift.

    Parameters
    ----------
    noise_structures : callables, (d, ...) -> (d, d, ...), or constant matrices (d, d)
        G_1, …, G_m, one for each coefficient in `noise`.
    noise_structure_derivatives : callables, optional
        ∂G_ij/∂y_k at [i, j, k] for each G. Without them Newton's Jacobian is formed from
        differences.
    closed_form : callable (y0, T, W) -> (d, M), optional
        The exact solution y(T) from y0 with W = W(T), (m, M), if the flows commute.
    casimirs, linear_casimirs
        Casimirs common to B and all G_j.

    Raises
    ------
    ProblemError
        As for `Problem`; each G_j is checked like B.
    """

    noise_structures: tuple[Function, ...] = ()
    noise_structure_derivatives: tuple[Function, ...] | None = None
    closed_form: ClosedForm | None = None

    def __post_init__(self, check: bool) -> None:
        super().__post_init__(check)
        require_one_for_each_noise(self, "noise_structures", "G_j")
        if check:
            checked = tuple(
                Problem(
                    self.dimension, G, self.hamiltonian, self.gradient, casimirs=self.casimirs,
                    linear_casimirs=self.linear_casimirs, domain=self.domain, initial=self.initial,
                    name=f"{self.name}, a noise structure",
                ).structure
                for G in self.noise_structures
            )  # fmt: skip
            object.__setattr__(self, "noise_structures", checked)
        self._checked_invariants(check)

    def _channels(self) -> tuple[Channel, ...]:
        own, *_ = super()._channels()
        slopes = self.noise_structure_derivatives or (None,) * self.noises
        return (own, *(_channel(own, G, D) for G, D in zip(self.noise_structures, slopes, strict=True)))


def _channel(own: Channel, G: Any, derivative: Function | None) -> Channel:
    """The channel G∇H of a noise beside the drift `own`; B∇H_j if G is made from an H_j with {H,
    H_j} = 0.
    """
    if isinstance(G, CommutingStructure):
        return own._replace(gradient=G.noise_gradient, hessian=G.noise_hessian, hamiltonian=None, keeping=G)
    return own._replace(structure=G, structure_derivative=derivative, keeping=G)


def undefined(problem: Problem, y0: Array, y1: Array, mean: Array, parts: Array) -> np.ndarray:
    """True for paths, (M,), whose step has |S_j∇̄H_0 − B∇H_j| > MISSED_MAX_SHARE |B∇H_j| for some
    noise j.

    `mean` (d, M) is the averaged gradient ∇̄H_0, and `parts` (1 + m, M) holds h and the c_j ΔW_j.
    """
    outside = np.zeros(y0.shape[1], dtype=bool)
    size = np.maximum(np.abs(y0), np.abs(y1)).max(axis=0)
    for part, F in zip(parts[1:], problem.channels[1:], strict=True):
        if F.keeping is not F.structure:
            missed, field, rounding = F.keeping.missed(y0 + 0.5 * (y1 - y0), mean)
            # A noise term below a rounding of y does not move y.
            allowed = np.abs(part) * (MISSED_MAX_SHARE * field + rounding) + EPS * size
            outside |= (part != 0) & ~(np.abs(part) * missed <= allowed)
    return outside


@dataclass(frozen=True)
class CommutingStructure:
    """The structure S_j(y) = (v wᵀ − w vᵀ)/|w|² with S_j∇H_0 = B∇H_j,
    for a Hamiltonian H_j that commutes with H_0.

    Here v = B∇H_j, and w is the part of ∇H_0 orthogonal to the Casimirs' gradients. Where w is zero
    to rounding, S_j is NaN if v is not zero, and 0 if v is zero to rounding too, because such a
    state does not move.
    """

    structure: Function
    gradient: Function
    noise_gradient: Function
    casimirs: tuple[Any, ...] = ()
    linear_casimirs: tuple[Any, ...] = ()
    noise_hessian: Function | None = None

    def __call__(self, y: Array) -> Array:
        v, slope = self.field(y), self.gradient(y)
        w = self.tangent(y, slope)
        # w is scaled by its largest component, because its square may underflow.
        size = np.abs(w).max(axis=0)
        unit = w / np.where(size > 0, size, 1.0)
        square = dot(unit, unit)
        factor = 1.0 / np.where(size > 0, size * square, 1.0)
        S = factor * (v[:, None] * unit[None] - unit[:, None] * v[None])
        lost = size <= ROUNDING_OF_W * np.abs(slope).max(axis=0)
        if np.any(lost):
            moves = np.abs(v).max(axis=0) > ROUNDING_OF_V * self._terms(y).max(axis=0)
            S = np.where(lost, np.where(moves, np.nan, 0.0), S)
        return np.asarray(S)

    def field(self, y: Array) -> Array:
        """The field v = B∇H_j, (d, ...)."""
        return matvec(self.structure(y), self.noise_gradient(y))

    def missed(self, y: Array, mean: Array) -> tuple[Array, Array, Array]:
        """Three maximum norms (M,) at y, for v = B∇H_j: the error |S_j(y) mean − v|, |v|,
        and the rounding of v.
        """
        v = self.field(y)
        apart = np.abs(matvec(self(y), mean) - v).max(axis=0)
        return apart, np.abs(v).max(axis=0), ROUNDING_OF_V * self._terms(y).max(axis=0)

    def _terms(self, y: Array) -> Array:
        """The sums of the absolute values of the terms of v = B∇H_j, (d, ...)."""
        return matvec(majorant(self.structure, y), majorant(self.noise_gradient, y))

    def tangent(self, y: Array, w: Array) -> Array:
        """The part of w (d, ...) that is orthogonal to the gradients of all Casimirs at y."""
        tangent: Array = directions(casimir_gradients(self.casimirs, self.linear_casimirs, 2 * y)).without(w)
        return tangent

    def majorant(self, y: Array) -> Array:
        """The scale 2(M_v M_wᵀ + M_w M_vᵀ)/|w|² of roundings of S_j, where M_v,
        M_w sum the |terms| of v and ∇H_0.
        """
        B, g, G = (majorant(f, y) for f in (self.structure, self.gradient, self.noise_gradient))
        w = self.tangent(y, self.gradient(y))
        square, v = dot(w, w), matvec(B, G)
        factor = np.where(square > 0, 2.0, 0.0) / np.where(square > 0, square, 1.0)
        return np.asarray(factor * (v[:, None] * g[None] + g[:, None] * v[None]))


def commuting_hamiltonians(
    drift: Problem,
    gradients: Sequence[Function],
    *,
    hessians: Sequence[Function | None] = (),
    noise: Sequence[float] | None = None,
    closed_form: ClosedForm | None = None,
    name: str = "",
    data: Any = None,
    check: bool = True,
) -> StructuresProblem:
    """The problem dy = B∇H_0 dt + Σ_j c_j B∇H_j ∘dW_j with {H_0, H_j} = 0, from `drift`,
    a problem with B and H_0.

    Parameters
    ----------
    gradients : callables, (d, ...) -> (d, ...)
        ∇H_1, …, ∇H_m with {H_0, H_j} = 0.
    hessians : callables, (d, ...) -> (d, d, ...), optional
        The second derivatives of the H_j.
    closed_form : callable (y0, T, W), optional
        The exact solution, as for `StructuresProblem`.
    check : bool
        False leaves out the check of the brackets, for example if polynomial coefficients show that
        they vanish.

    Raises
    ------
    ProblemError
        If a bracket {H_0, H_j} = ∇H_0ᵀB∇H_j is not zero at the initial state or a state near it.
        The message gives the value and the state.
    """
    for j, gradient in enumerate(gradients if check else (), 1):
        _check_bracket(drift, gradient, j)
    structures = tuple(
        CommutingStructure(drift.structure, drift.gradient, g, drift.casimirs, drift.linear_casimirs, K)
        for g, K in zip(gradients, hessians or (None,) * len(gradients), strict=True)
    )
    keys = (
        "dimension", "structure", "hamiltonian", "gradient", "casimirs", "linear_casimirs", "hessian",
        "structure_derivative", "mean_gradient", "degree", "domain", "initial", "invariants",
    )  # fmt: skip
    return StructuresProblem(
        **{key: getattr(drift, key) for key in keys},
        noise=np.ones(len(gradients)) if noise is None else np.asarray(noise),
        noise_structures=structures,
        closed_form=closed_form,
        name=name or f"{drift.name} with {len(gradients)} noise Hamiltonians",
        data=data,
        check=False,
    )


def _check_bracket(drift: Problem, gradient: Function, j: int) -> None:
    """Raise a ProblemError if {H_0, H_j} is not zero at a sample state; `gradient` is ∇H_j."""
    for y in sample_states(drift):
        w, v = drift.gradient(y), matvec(drift.structure(y), gradient(y))
        bracket, size = float(w @ v), float(np.linalg.norm(w) * np.linalg.norm(v))
        if not abs(bracket) <= BRACKET_TOLERANCE * max(size, TINY):
            raise ProblemError(
                expected=f"{{H_0, H_{j}}} = ∇H_0ᵀ B ∇H_{j} = 0 everywhere: else H_0 is not kept",
                received=f"{{H_0, H_{j}}} = {bracket!r} at y = {y.tolist()}",
                remedy=f"take an H_{j} whose flow keeps H_0, such as a function of its first integrals",
            )
