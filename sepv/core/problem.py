"""The part of a problem dy = F_0 dt + Σ_j c_j F_j∘dW_j that a step uses.

Each field F_k is a `Channel`. In (1.1) there is one structure B and one Hamiltonian H, so that each
F_k is B∇H. The first axis of every array is that of components: a state is an array (d,), a batch
of M states (d, M), and B(y) is (d, d) or (d, d, M). `sepv.problem.Problem` derives and checks them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sepv.core.arrays import Array, Flags, OfLanes, forward_differences, matmul, matvec
from sepv.errors import Skipped

Function = Callable[[Array], Array]
OfSegment = Callable[[Array, Array], Array]


class Channel(NamedTuple):
    """A field F(y) = S(y)∇H(y) + g − Γy of the drift or of a noise; a part left out is absent.

    S, ∇H, S′, H″ and H are functions of states. `keeping` is a structure whose product with ∇H_0 of
    the drift is S∇H, where one is known. g has d numbers, and Γ is a number or has d rows.
    """

    structure: Any = None
    gradient: Any = None
    structure_derivative: Any = None
    hessian: Any = None
    hamiltonian: Any = None
    keeping: Any = None
    vector: Any = None
    damping: Any = 0.0


@dataclass(frozen=True, eq=False)
class System:
    """The functions of a stochastic Poisson system that a step uses.

    Attributes
    ----------
    dimension : int
        The dimension d of states.
    structure, structure_derivative : callables, (d, ...) -> (d, d, ...) and (d, d, d, ...)
        B(y), skew, and ∂B_ij/∂y_k at [i, j, k].
    hamiltonian, gradient, hessian : callables, (d, ...) -> (...), (d, ...) and (d, d, ...)
        H, ∇H and H″.
    noise : (m,)
        The coefficients c_j ≥ 0, also as the array `c`.
    mean_gradient : callable (y0, y1) -> ∫₀¹∇H(y0 + τ(y1 − y0))dτ, optional
        A closed form, exact to rounding.
    degree : int, optional
        The degree of a polynomial H.
    domain : callable (d, ...) -> (...) of bool, optional
        True for the states at which H and B are defined.
    casimirs, linear_casimirs : matrices A (d, d) and vectors b (d,)
        Casimirs yᵀAy and bᵀy.
    nambu : optional
        For d = 3: the Casimir C and the factor g with B(y)v = g(y)(v × ∇C(y)).
    """

    dimension: int
    structure: Function
    hamiltonian: Function
    gradient: Function
    noise: ArrayLike = (1.0,)
    casimirs: tuple[Any, ...] = ()
    linear_casimirs: tuple[Any, ...] = ()
    hessian: Function | None = None
    structure_derivative: Function | None = None
    mean_gradient: OfSegment | None = None
    degree: int | None = None
    domain: Callable[[Array], Flags] | None = None
    nambu: Any = None
    c: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "c", np.array(self.noise, dtype=np.float64))

    @property
    def noises(self) -> int:
        """The number m of Wiener processes."""
        return int(self.c.size)

    @cached_property
    def channels(self) -> tuple[Channel, ...]:
        """The fields F_0, …, F_m of the drift and of each noise."""
        return self._channels()

    def _channels(self) -> tuple[Channel, ...]:
        B, slope = self.structure, self.structure_derivative
        return (Channel(B, self.gradient, slope, self.hessian, self.hamiltonian, B),) * (1 + self.noises)

    @property
    def structures(self) -> Sequence[Any]:
        """The structures S_0, …, S_m with S_k∇H_k = S_k∇H."""
        return [F.keeping for F in self.channels]

    @property
    def structure_derivatives(self) -> Sequence[Function] | None:
        """The derivatives of the `structures`; None if one is not given."""
        found = [F.structure_derivative for F in self.channels if F.structure is F.keeping]
        return None if None in found or len(found) <= self.noises else found

    @property
    def gradients(self) -> Sequence[Any]:
        """The gradients ∇H_0, …, ∇H_m of the channels."""
        return [F.gradient for F in self.channels]

    def derivative_along(self, y: Array, v: Array) -> Array:
        """The derivative f′(y)v of the field f = B∇H, (d, ...), for a system with B′ and H″."""
        jacobian = field_jacobian(self, y)
        assert jacobian is not None, "wider records derive it"
        return matvec(jacobian, v)

    def random_step(self, h: float, dW: Array) -> Array:
        """The random step Δ = h + Σ_j c_j ΔW_j, of shape () or (M,), summed in the order of j."""
        delta = np.full(np.shape(dW)[1:], float(h))
        for c, increment in zip(self.c, dW, strict=True):
            delta = delta + c * increment
        return delta


def require_undamped(problem: System) -> None:
    """Raise Skipped for a damped problem: a formula without a term for damping ignores it."""
    if problem.channels[0].damping:
        raise Skipped(f"the scheme leaves out the damping of {getattr(problem, 'name', 'the problem')}")


def combined(problem: System, y: Array, parts: Array) -> Array:
    """The structure h B(y) + Σ_j c_j ΔW_j G_j(y), (d, d, M); `parts` (1 + m, M): h, c_j ΔW_j."""
    require_undamped(problem)
    drift, *noises = problem.structures
    total: Array = parts[0] * drift(y)
    for part, G in zip(parts[1:], noises, strict=True):
        # A noise with increment zero does not use its structure, which may be undefined (NaN) at y.
        total = total + np.where(part != 0, part * G(y), 0.0)
    return total


def combined_slope(problem: System, y: Array, parts: Array) -> Array | None:
    """The derivative of h B + Σ_j c_j ΔW_j G_j by y, (d, d, d, M); None if one is not given."""
    derivatives = problem.structure_derivatives
    return None if derivatives is None else _sum(derivatives, y, parts)


def combined_gradient(problem: System, y: Array, parts: Array) -> Array:
    """The gradient (d, M) of hH_0 + Σ_j c_j ΔW_j H_j at y; `parts` (1 + m, M): h, c_j ΔW_j."""
    require_undamped(problem)
    return _sum(problem.gradients, y, parts)


def combined_hessian(problem: System, y: Array, parts: Array) -> Array:
    """The Hessian (d, d, M) of hH_0 + Σ_j c_j ΔW_j H_j at y; `parts` (1 + m, M): h, c_j ΔW_j."""
    return _sum([partial(hessian, problem, channel=F) for F in problem.channels], y, parts)


def _sum(functions: Sequence[Function], y: Array, parts: Array) -> Array:
    total = parts[0] * functions[0](y)
    for part, function in zip(parts[1:], functions[1:], strict=True):
        total = total + part * function(y)
    return np.asarray(total)


def each_noise(problem: System, h: float, noise: Array) -> Array:
    """The `parts` (1 + m, M) of a step of M paths: the numbers h and c_j ΔW_j."""
    return np.concatenate([np.full((1, noise.shape[1]), float(h)), problem.c[:, None] * noise])


def vector_field(problem: System, y: Array) -> Array:
    """The field f(y) = B(y)∇H(y) of a problem, of shape (d, ...)."""
    return matvec(problem.structure(y), problem.gradient(y))


def field_jacobian(problem: System, y: Array) -> Array | None:
    """The derivative f′(y) of the field f = B∇H, (d, d, ...); None without B′ or H″."""
    if problem.hessian is None or problem.structure_derivative is None:
        return None
    g = problem.gradient(y)
    return matvec(problem.structure_derivative(y), g) + matmul(problem.structure(y), problem.hessian(y))


def hessian(problem: System, y: Array, channel: Any = None) -> Array:
    """H″(y) of a channel, by default the drift, (d, d, ...), by differences of ∇H if not given."""
    own = problem if channel is None else channel
    return own.hessian(y) if own.hessian is not None else differences(problem, own.gradient, y)


def differences(problem: System, function: Function, y: Array) -> Array:
    """The derivative (n, d, ...) of a function of states at y (d, ...), by forward differences."""
    return differences_of_lanes(problem, lambda at, _: function(at), y)


def differences_of_lanes(problem: System, function: OfLanes, y: Array) -> Array:
    """The derivative (n, d, ...) of a function of a problem's states at y, by forward differences.

    `function` gets shifted states (d, M) and M integers: the numbers of their paths.
    """
    flat, domain = y.reshape(len(y), -1), problem.domain
    inside = None if domain is None else lambda at, _: domain(at)
    base = function(flat, np.arange(flat.shape[1]))
    jacobian = forward_differences(function, inside, flat, base, np.abs(flat).max(axis=0))
    return jacobian.reshape(*jacobian.shape[:2], *y.shape[1:])
