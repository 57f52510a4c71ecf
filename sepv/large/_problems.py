"""Large problems: chains of any length in which neighbours interact."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from sepv.errors import ProblemError
from sepv.large._problem import LargeProblem, Sparse
from sepv.problem import Array


def _sparse(d: int, rows: Any, cols: Any, data: Array) -> Sparse:
    """The sparse d × d matrix with entries `data` at `rows` and `cols`; repeated entries are added."""
    from scipy.sparse import coo_array

    return coo_array((data, (rows, cols)), shape=(d, d)).tocsr()


def _at_least(name: str, n: int, least: int) -> None:
    """Raise a ProblemError if n, the number of members of a chain, is not an integer ≥ `least`."""
    if not isinstance(n, int) or n < least:
        raise ProblemError(
            expected=f"{name}, an integer ≥ {least}", received=repr(n), remedy="a longer chain"
        )


def volterra_lattice(
    d: int, *, periodic: bool = False, noise: tuple[float, ...] = (1.0,), seed: int = 0
) -> LargeProblem:
    """The Volterra lattice y_i′ = y_i(y_{i+1} − y_{i−1}) for positive y: B_{i,i+1} = y_i y_{i+1} and H = Σ y_i.

    An open chain of odd length has the Casimir Σ ln y_i over odd i; a periodic chain of even length also has the sum
    over even i. Scheme (2.1) keeps H, but not these Casimirs, which are not quadratic. Each y_i starts in [¾, 1¼].
    """
    _at_least("d, the length of the chain", d, 3)
    i = np.arange(d if periodic else d - 1)
    j = (i + 1) % d
    rows, cols = np.concatenate([i, j]), np.concatenate([j, i])
    both = np.concatenate([rows, rows]), np.concatenate([cols, rows])

    def structure(y: Array) -> Sparse:
        w = y[i] * y[j]
        return _sparse(d, rows, cols, np.concatenate([w, -w]))

    def structure_slope(y: Array, v: Array) -> Sparse:
        # Row i of B(y)v is Σ_j ± y_i y_j v_j. Its derivative by y_j is ± y_i v_j, and by y_i it is Σ_j ± y_j v_j.
        sign = np.concatenate([np.ones(i.size), -np.ones(i.size)])
        return _sparse(d, *both, np.concatenate([sign * y[rows] * v[cols], sign * y[cols] * v[cols]]))

    def casimirs(y: Array) -> Array:
        logs = np.log(y)
        return np.array([logs[0::2].sum(), logs[1::2].sum()] if periodic else [logs[0::2].sum()])

    has_casimirs = d % 2 == (0 if periodic else 1)
    return LargeProblem(
        name="volterra-lattice",
        structure=structure,
        structure_slope=structure_slope,
        terms=lambda y: y,
        gradient=np.ones_like,
        hessian=lambda y: _sparse(d, i[:0], i[:0], y[:0]),
        initial=1 + np.random.default_rng(seed).uniform(-0.25, 0.25, d),
        degree=1,
        other_casimirs=casimirs if has_casimirs else None,
        domain=lambda y: bool(np.all(y > 0)),
        noise=noise,
    )


def toda_chain(n: int, *, noise: tuple[float, ...] = (1.0,), seed: int = 0) -> LargeProblem:
    """Toda's chain of n particles with free ends: H = Σ p_i²/2 + Σ exp(q_i − q_{i+1}), d = 2n, y = (q₁, p₁, q₂, …).

    The averaged gradient needs no quadrature: if r = q_i − q_{i+1} grows by δ in a step, eʳ(e^δ − 1)/δ averages eʳ.
    """
    _at_least("n, the number of particles", n, 2)
    d = 2 * n
    q, p = np.arange(0, d, 2), np.arange(1, d, 2)

    def forces(pull: Array) -> Array:
        """∂H/∂q (n,) if `pull` (n − 1,) is exp(q_i − q_{i+1}); the average along a step if `pull` is averaged."""
        total = np.zeros(n)
        total[:-1] += pull
        total[1:] -= pull
        return total

    def gradient(y: Array) -> Array:
        g = np.empty_like(y)
        g[q], g[p] = forces(np.exp(y[q][:-1] - y[q][1:])), y[p]
        return g

    def mean_gradient(y0: Array, y1: Array) -> Array:
        r = y0[q][:-1] - y0[q][1:]
        change = y1 - y0
        delta = change[q][:-1] - change[q][1:]
        safe = np.where(delta == 0, 1.0, delta)
        quotient = np.where(delta == 0, 1.0, np.expm1(safe) / safe)
        g = np.empty_like(y0)
        g[q], g[p] = forces(np.exp(r) * quotient), y0[p] + 0.5 * change[p]
        return g

    def hessian(y: Array) -> Sparse:
        e = np.exp(y[q][:-1] - y[q][1:])
        a, b = q[:-1], q[1:]
        rows, cols = np.concatenate([a, b, a, b, p]), np.concatenate([a, b, b, a, p])
        return _sparse(d, rows, cols, np.concatenate([e, e, -e, -e, np.ones(n)]))

    rng = np.random.default_rng(seed)
    initial = np.empty(d)
    initial[q], initial[p] = rng.uniform(-0.25, 0.25, n), rng.uniform(-0.5, 0.5, n)
    return LargeProblem(
        name="toda-chain",
        structure=_canonical(n),
        structure_slope=None,
        terms=lambda y: np.concatenate([0.5 * y[p] ** 2, np.exp(y[q][:-1] - y[q][1:])]),
        gradient=gradient,
        hessian=hessian,
        initial=initial,
        mean_gradient=mean_gradient,
        noise=noise,
    )


def nonlinear_schroedinger(
    n: int, *, spacing: float = 1.0, strength: float = 1.0, noise: tuple[float, ...] = (0.25,), seed: int = 0
) -> LargeProblem:
    """The discrete nonlinear Schrödinger equation on n points, i u_j′ = −(u_{j−1} − 2u_j + u_{j+1})/Δx² − κ|u_j|²u_j.

    Here Δx = `spacing`, κ = `strength`, u = q + ip, y = (q₁, p₁, q₂, …) and d = 2n; the ends are free. Two Gauss nodes
    are exact: H = ½Σ|u_{j+1} − u_j|²/Δx² − ¼κΣ|u_j|⁴ is quartic. Paths start from a randomly perturbed wave |u_j| = 1.
    The flow keeps the mass Σ|u_j|², as H does not depend on u's phase. Scheme (2.1) does not: the mass is no Casimir.
    """
    _at_least("n, the number of points", n, 2)
    if not (np.isfinite(spacing) and spacing > 0 and np.isfinite(strength)):
        raise ProblemError(
            expected="spacing > 0 and strength, finite",
            received=f"spacing = {spacing!r}, strength = {strength!r}",
            remedy="Δx > 0; a negative strength is the defocusing equation",
        )
    d, w = 2 * n, 1 / spacing**2
    q, p = np.arange(0, d, 2), np.arange(1, d, 2)
    inner = np.full(n, 2 * w)
    inner[[0, -1]] = w

    def squares(y: Array) -> Array:
        return y[q] ** 2 + y[p] ** 2

    def gradient(y: Array) -> Array:
        g = -strength * np.repeat(squares(y), 2) * y
        for part in (q, p):
            stretch = w * np.diff(y[part])
            g[part[:-1]] -= stretch
            g[part[1:]] += stretch
        return g

    def hessian(y: Array) -> Sparse:
        s, cross = squares(y), -2 * strength * y[q] * y[p]
        rows, cols = [q, p, q, p], [q, p, p, q]
        data = [inner - strength * (s + 2 * y[part] ** 2) for part in (q, p)] + [cross, cross]
        for part in (q, p):
            rows += [part[:-1], part[1:]]
            cols += [part[1:], part[:-1]]
            data += [np.full(n - 1, -w)] * 2
        return _sparse(d, np.concatenate(rows), np.concatenate(cols), np.concatenate(data))

    def terms(y: Array) -> Array:
        stretches = [0.5 * w * np.diff(y[part]) ** 2 for part in (q, p)]
        return np.concatenate([*stretches, -0.25 * strength * squares(y) ** 2])

    phase = 2 * np.pi * np.arange(n) / 16
    initial = np.stack([np.cos(phase), np.sin(phase)], axis=1).ravel()
    return LargeProblem(
        name="nonlinear-schroedinger",
        structure=_canonical(n),
        structure_slope=None,
        terms=terms,
        gradient=gradient,
        hessian=hessian,
        initial=initial + 0.1 * np.random.default_rng(seed).standard_normal(d),
        degree=4,
        noise=noise,
    )


def spin_chain(
    n: int, *, anisotropy: float = 0.5, noise: tuple[float, ...] = (0.5,), seed: int = 0
) -> LargeProblem:
    """The Landau-Lifshitz chain S_i′ = S_i × ∇_iH of n spins, d = 3n: H = −Σ S_i·S_{i+1} − ¼a Σ (S_i)₃⁴.

    Here a = `anisotropy`. Block i of B(y)v is S_i × v_i. Scheme (2.1) keeps all n quadratic Casimirs |S_i|².
    """
    _at_least("n, the number of spins", n, 2)
    d = 3 * n
    base = 3 * np.arange(n)
    z = base + 2

    def hat(v: Array) -> Sparse:
        """The block diagonal matrix whose product with b is v_i × b_i in block i."""
        a, b, c = v[base], v[base + 1], v[base + 2]
        rows = np.concatenate([base, base, base + 1, base + 1, base + 2, base + 2])
        cols = np.concatenate([base + 1, base + 2, base, base + 2, base, base + 1])
        return _sparse(d, rows, cols, np.concatenate([-c, b, c, -a, -b, a]))

    def gradient(y: Array) -> Array:
        g = np.zeros_like(y)
        g[:-3] -= y[3:]
        g[3:] -= y[:-3]
        g[z] -= anisotropy * y[z] ** 3
        return g

    def hessian(y: Array) -> Sparse:
        left = np.arange(d - 3)
        rows = np.concatenate([left, left + 3, z])
        cols = np.concatenate([left + 3, left, z])
        return _sparse(d, rows, cols, np.concatenate([-np.ones(2 * (d - 3)), -3 * anisotropy * y[z] ** 2]))

    spins = np.random.default_rng(seed).standard_normal((n, 3)) + np.array([0.0, 0.0, 2.0])
    return LargeProblem(
        name="spin-chain",
        structure=hat,
        structure_slope=lambda _y, v: -hat(v),
        terms=lambda y: np.concatenate([-y[:-3] * y[3:], -0.25 * anisotropy * y[z] ** 4]),
        gradient=gradient,
        hessian=hessian,
        initial=(spins / np.linalg.norm(spins, axis=1, keepdims=True)).ravel(),
        degree=4,
        casimirs=lambda y: np.sum(y.reshape(n, 3) ** 2, axis=1),
        noise=noise,
    )


def _canonical(n: int) -> Callable[[Array], Sparse]:
    """The function B(y) of a canonical system q_i′ = ∂H/∂p_i, p_i′ = −∂H/∂q_i, y = (q₁, p₁, q₂, …); B is constant."""

    @cache
    def matrix() -> Sparse:
        q = np.arange(0, 2 * n, 2)
        rows, cols = np.concatenate([q, q + 1]), np.concatenate([q + 1, q])
        return _sparse(2 * n, rows, cols, np.concatenate([np.ones(n), -np.ones(n)]))

    return lambda _y: matrix()
