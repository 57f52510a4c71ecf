"""Built-in mechanical systems, H = ½ pᵀM⁻¹p + V(q) with y = (q, p), positions first, and B = J."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from sepv.errors import ProblemError
from sepv.problem import Array, Function, PolynomialSystem, Problem, coefficients, dot
from sepv.problems._common import canonical, flows, named, skew, whole_number
from sepv.problems._polynomial_system import started
from sepv.record import PolynomialMap, poly

# The largest number of degrees of freedom. It is bounded because B and H″ are dense matrices.
MAX_DEGREES_OF_FREEDOM = 32


def positions_first(y: Array) -> Array:
    """The canonical B = ((0, I), (−I, 0)) at states y = (q, p), (d, d, ...)."""
    n = len(y) // 2
    return skew(y, ((i, n + i, 1.0) for i in range(n)))


def henon_heiles(coupling: float = 1.0, noise: ArrayLike = 1.0) -> Problem:
    """The system of Hénon and Heiles, H = ½|p|² + ½|q|² + κ(q_1²q_2 − q_2³/3), from q = (0, 0.2),
    p = (0.4, −0.1).

    For `coupling` κ = 1, orbits are bounded below H = 1/6, and chaos begins at about H = 1/12
    (Astron. J. 69, 1964).
    """
    cubic = poly.polynomial(4, {(2, 1, 0, 0): coupling, (0, 3, 0, 0): -coupling / 3})
    parts = [poly.squares((0, 0, 1, 1)), poly.add(poly.squares((1, 1, 0, 0)), cubic)]
    c = tuple(coefficients(noise).tolist())
    data = PolynomialSystem(4, poly.add(*parts), canonical(4, 1.0), c)
    exact = flows(4, positions_first, [PolynomialMap((), (p,)) for p in parts])
    return started(data, "henon-heiles", (0.0, 0.2, 0.4, -0.1), flows=exact)


def harmonic_trap(frequencies: ArrayLike = (1.0, 10.0, 100.0), noise: ArrayLike = ()) -> Problem:
    """A harmonic trap with frequencies of different size: H = ½Σ (p_k² + ω_k²q_k²),
    from q_k = 1/ω_k and p = 0.

    The solution without noise, the default, is q_k = cos(ω_k t)/ω_k.
    """
    w = np.atleast_1d(np.asarray(frequencies, dtype=np.float64))
    if w.ndim > 1 or not 1 <= w.size <= MAX_DEGREES_OF_FREEDOM or not np.all((w > 0) & np.isfinite(w)):
        raise ProblemError(
            expected=f"one to {MAX_DEGREES_OF_FREEDOM} frequencies > 0",
            received=f"{frequencies!r:.80}",
            remedy="frequencies=(1.0, 10.0)",
        )
    H = poly.squares((*(w * w).tolist(), *np.ones(w.size).tolist()))
    data = PolynomialSystem(2 * w.size, H, canonical(2 * w.size, 1.0), tuple(coefficients(noise).tolist()))
    return started(data, "harmonic-trap", (*(1 / w).tolist(), *np.zeros(w.size).tolist()))


def pendulum_chain(links: float = 3, coupling: float = 0.5, noise: ArrayLike = 1.0) -> Problem:
    """Pendula coupled by springs: H = ½|p|² − Σ cos q_k + (κ/2) Σ (q_{k+1} − q_k)², from q_k = 1,
    −1, 1, … and p_k = ½.

    This is a discrete sine-Gordon equation with free ends (Y. Frenkel and T. Kontorova, 1938).
    """
    n = whole_number("links", links, 1, MAX_DEGREES_OF_FREEDOM)

    def hamiltonian(y: Array) -> Array:
        q, p = y[:n], y[n:]
        bent = sum((q[k + 1] - q[k]) ** 2 for k in range(n - 1))
        total: Array = 0.5 * dot(p, p) - sum(np.cos(q[k]) for k in range(n)) + 0.5 * coupling * bent
        return total

    return _mechanical(
        hamiltonian, "pendulum-chain", noise, {"links": (n,), "coupling": (coupling,)},
        [1.0 - 2.0 * (k % 2) for k in range(n)] + [0.5] * n,
    )  # fmt: skip


def lennard_jones(atoms: float = 3, noise: ArrayLike = 1.0) -> Problem:
    """Atoms in the plane, H = ½|p|² + Σ_{i<j} 4(r⁻¹² − r⁻⁶), in the units of J. E.
    Lennard-Jones (1924); all r_ij > 0.

    The state is y = (x_1, y_1, x_2, …, p). The atoms start on a circle, neighbours 1.2 apart, with
    total momentum zero.
    """
    n = whole_number("atoms", atoms, 2, MAX_DEGREES_OF_FREEDOM)
    pairs = list(combinations(range(n), 2))

    def squared(y: Array, i: int, j: int) -> Array:
        distance: Array = (y[2 * i] - y[2 * j]) ** 2 + (y[2 * i + 1] - y[2 * j + 1]) ** 2
        return distance

    def hamiltonian(y: Array) -> Array:
        p, sixth = y[2 * n :], [squared(y, i, j) ** -3 for i, j in pairs]
        return 0.5 * dot(p, p) + sum(4 * (s * s - s) for s in sixth)

    angle = 2 * np.pi * np.arange(n) / n
    radius = 0.6 / np.sin(np.pi / n)
    q = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1).ravel()
    turning = 0.3 * np.stack([np.cos(2 * angle), -np.sin(angle)], axis=1).ravel()
    p = turning if n > 2 else np.array([0, 0.3, 0, -0.3])
    return _mechanical(
        hamiltonian, "lennard-jones", noise, {"atoms": (n,)}, np.concatenate([q, p]).tolist(),
        lambda y: np.min([squared(y, i, j) for i, j in pairs], axis=0) > 0,
    )  # fmt: skip


def _mechanical(
    hamiltonian: Function, name: str, noise: ArrayLike, parameters: dict[str, Sequence[float]], initial: list[float],
    domain: Function | None = None,
) -> Problem:  # fmt: skip
    return named(
        name, noise, parameters, dimension=len(initial), structure=positions_first, hamiltonian=hamiltonian,
        initial=initial, domain=domain,
    )  # fmt: skip
