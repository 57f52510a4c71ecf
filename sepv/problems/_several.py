"""Examples with a structure or a Hamiltonian for each noise,
and with the exact solution if all flows commute.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from sepv.problem import (
    Array,
    ClosedForm,
    HamiltoniansProblem,
    PolynomialSystem,
    Problem,
    StructuresProblem,
    matvec,
)
from sepv.problems._common import HAT, planes
from sepv.problems._polynomial_system import started
from sepv.record import Polynomial, PolynomialMap, poly

_IN_PLANES = (0.8, 0.3, 0.2, 0.5)


def _started(
    data: PolynomialSystem, name: str, initial: Sequence[float], closed_form: ClosedForm | None = None
) -> StructuresProblem:
    more = {} if closed_form is None else {"closed_form": closed_form}
    problem = started(data, name, initial, **more)
    assert isinstance(problem, StructuresProblem)
    return problem


def action(dimension: int, k: int) -> Polynomial:
    """The action ½(y_{2k+1}² + y_{2k+2}²) of plane k = 0, 1, … as a polynomial."""
    return poly.squares([int(i // 2 == k) for i in range(dimension)])


def in_actions(p: Polynomial) -> Polynomial:
    """The polynomial p(I_1, …, I_n) in n actions as a polynomial in the 2n components of y."""
    d = 2 * p.dimension
    terms = []
    for exponents, coefficient in p.terms:
        term = poly.constant(d, coefficient)
        for k, exponent in enumerate(exponents):
            for _ in range(exponent):
                term = poly.multiply(term, action(d, k))
        terms.append(term)
    return poly.add(poly.polynomial(d, {}), *terms)


def rotating_planes(
    hamiltonian: Polynomial,
    frequencies: Sequence[Sequence[Polynomial]],
    noise: tuple[float, ...] | None = None,
) -> PolynomialSystem:
    """A system of n planes with H = H(I_1, …, I_n), B = J in each plane and G_j = α_jk(I)
    J in plane k.

    The flow keeps every action I_k (half the squared radius in plane k), and turns plane k by the
    angle ∂H/∂I_k (T + Σ_j c_j α_jk W_j(T)). `frequencies` has the α_jk as m rows of n polynomials
    in the actions.
    """
    d = 2 * hamiltonian.dimension
    structures = tuple(
        tuple((2 * k, 2 * k + 1, poly.scale(-1.0, in_actions(a))) for k, a in enumerate(row) if a.terms)
        for row in frequencies
    )
    c = noise or (1.0,) * len(structures)
    return PolynomialSystem(d, in_actions(hamiltonian), planes(d), c, noise_structures=structures)


def commuting_actions(
    hamiltonian: Polynomial, others: Sequence[Polynomial], noise: tuple[float, ...] | None = None
) -> PolynomialSystem:
    """A system of n planes with Hamiltonians H(I_1, …, I_n) and H_j(I_1, …, I_n),
    all of which commute.

    I_k is half the squared radius in plane k. The flow turns this plane by ∂H/∂I_k T + Σ_j c_j
    ∂H_j/∂I_k W_j(T).
    """
    d, c = 2 * hamiltonian.dimension, noise or (1.0,) * len(others)
    posed = tuple(in_actions(H) for H in others)
    return PolynomialSystem(d, in_actions(hamiltonian), planes(d), c, noise_hamiltonians=posed)


def closed_form(
    hamiltonian: Polynomial, noise: Sequence[float], rates: Sequence[Sequence[Polynomial]]
) -> ClosedForm:
    """The exact solution (y0, T, W) -> y(T): plane k turns by the angle ∂H/∂I_k T + Σ_j c_j
    rates[j][k] W_j(T).

    All rates are evaluated at the actions of y0, which do not change along the solution.
    """
    n = hamiltonian.dimension
    drift = PolynomialMap((n,), poly.gradient(hamiltonian))
    turns = PolynomialMap((len(rates), n), tuple(p for row in rates for p in row)) if rates else None

    def exact(y0: Array, T: float, W: Array) -> Array:
        I = 0.5 * (y0[0::2] ** 2 + y0[1::2] ** 2)
        angle = drift(I)[:, None] * T + np.zeros((n, W.shape[1]))
        if turns is not None:
            angle = angle + matvec((turns(I) * np.asarray(noise)[:, None]).T[..., None], W)
        p, q = y0[0::2, None], y0[1::2, None]
        y = np.empty((2 * n, W.shape[1]))
        y[0::2] = p * np.cos(angle) - q * np.sin(angle)
        y[1::2] = p * np.sin(angle) + q * np.cos(angle)
        return y

    return exact


def commuting_rotations() -> StructuresProblem:
    """Rotations of two planes, H = I1 + 2 I2 + I1 I2, with two noises of different structures,
    whose flows commute.
    """
    H = poly.polynomial(2, {(1, 0): 1.0, (0, 1): 2.0, (1, 1): 1.0})
    one, I1 = poly.constant(2, 1.0), poly.variable(2, 0)
    alpha = ((one, poly.scale(-0.5, one)), (poly.scale(0.5, I1), one))
    slopes = poly.gradient(H)
    rates = [[poly.multiply(a, s) for a, s in zip(row, slopes, strict=True)] for row in alpha]
    c = (1.0, 0.5)
    data, exact = rotating_planes(H, alpha, c), closed_form(H, c, rates)
    return _started(data, "commuting-rotations", _IN_PLANES, closed_form=exact)


def commuting_oscillators() -> StructuresProblem:
    """Rotations of two planes by H_0 = I1 + 2 I2 + I1 I2, H_1 = I1 − I2²/2 and H_2 = I2,
    which commute.
    """
    H = poly.polynomial(2, {(1, 0): 1.0, (0, 1): 2.0, (1, 1): 1.0})
    others = [poly.polynomial(2, {(1, 0): 1.0, (0, 2): -0.5}), poly.variable(2, 1)]
    c = (1.0, 0.5)
    exact = closed_form(H, c, [list(poly.gradient(p)) for p in others])
    data = commuting_actions(H, others, c)
    return _started(data, "commuting-oscillators", _IN_PLANES, closed_form=exact)


def kubo_oscillator(a: float = 2.0, sigma: float = 0.5) -> StructuresProblem:
    """Kubo's oscillator: H_0 = ½a(p² + q²) and σH_1 = ½σ(p² + q²);
    the exact solution is a rotation by aT + σW(T).

    The initial state is (1, 0). Source: R. Kubo, M. Toda, N. Hashitsume, Statistical Physics II
    (1991), §2.1. G. N. Milstein, Yu. M. Repin and M. V. Tretyakov (SIAM J. Numer. Anal. 40, 2002),
    §5.1, use it for symplectic methods with multiplicative noise.
    """
    H, one = poly.scale(a, poly.variable(1, 0)), poly.variable(1, 0)
    exact = closed_form(H, (sigma,), [list(poly.gradient(one))])
    data = commuting_actions(H, [one], (sigma,))
    return _started(data, "kubo-oscillator", (1.0, 0.0), closed_form=exact)


@lru_cache(maxsize=1)
def kubo_by_hamiltonians() -> Problem:
    """Kubo's oscillator as a `HamiltoniansProblem` with H_0 and H_1, for schemes that need ∇H_1."""
    problem = kubo_oscillator()
    H = poly.polynomial(2, [((2, 0), 0.5), ((0, 2), 0.5)])
    return HamiltoniansProblem(
        2, problem.structure, problem.hamiltonian, problem.gradient,
        noise=tuple(problem.c.tolist()), hessian=problem.hessian, structure_derivative=problem.structure_derivative,
        initial=problem.initial, name=problem.name, closed_form=problem.closed_form,
        noise_hamiltonians=(PolynomialMap((), (H,)),), check=False,
    )  # fmt: skip


def noncommuting_tops() -> StructuresProblem:
    """Noises that do not commute: H = ½(y1² + 2 y2² + 3 y3²), Bv = e3 × v,
    G_1 v = e1 × v and G_2 v = e2 × v.
    """
    H = poly.squares((1, 2, 3))
    B, G2, G1 = (((i, j, poly.constant(3, sign)),) for i, j, _, sign in HAT)
    system = PolynomialSystem(3, H, B, (0.5, 0.5), noise_structures=(G1, G2))
    return _started(system, "noncommuting-tops", (0.6, 0.5, 0.4))


def noncommuting_drift() -> StructuresProblem:
    """Rotations of two planes as two noises, which commute with each other,
    and a drift that commutes with neither.

    B has the entry −7/10 between the planes, so that B∇H turns one plane into the other, and keeps
    neither action.
    """
    base = commuting_rotations().data
    assert isinstance(base, PolynomialSystem)
    B = (*base.structure, (0, 2, poly.constant(4, -0.7)))
    system = replace(base, structure=B, casimirs=(), linear_casimirs=())
    return _started(system, "noncommuting-drift", _IN_PLANES)
