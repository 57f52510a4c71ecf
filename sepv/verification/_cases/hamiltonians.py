"""Hypothesis strategies for several Hamiltonians, and from which of them each law draws its cases.

B is any skew B(y), one with Casimirs by construction, or a Poisson structure; H_0 and the H_j are any polynomials. All
f_j have one B, so that its Casimirs are common. Systems whose brackets {H_0, H_j} all vanish are left out: they keep
H_0 and are a class of their own (`sepv.verification._cases.structures`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from hypothesis import assume
from hypothesis import strategies as st

from sepv import problems
from sepv.problem import Array, NamedProblem, PolynomialSystem, vector_field
from sepv.problem._hamiltonians import noise_field
from sepv.record import _polynomial as poly
from sepv.schemes._stochastic_splitting import scheme as stochastic_splitting
from sepv.verification import strategies as some
from sepv.verification._cases.case import Case
from sepv.verification._cases.families import general, separable_hamiltonians
from sepv.verification._cases.poisson import constant_structures, poisson_structures
from sepv.verification._cases.structures import from_origin, still

Cases = Callable[[], st.SearchStrategy[Case]]


@st.composite
def with_hamiltonians(
    draw: st.DrawFn, systems: st.SearchStrategy[PolynomialSystem], degree: int = 4, least: int = 1, most: int = 3
) -> PolynomialSystem:  # fmt: skip
    """A system with H_1, …, H_m of degree ≤ `degree` in place of its noise. Examples shrink towards H_1 = ½|y|²."""
    system = draw(systems)
    c = draw(some.noises(least=least, most=most).filter(any))
    others = tuple(draw(some.hamiltonians(system.dimension, degree)) for _ in c)
    return replace(system, noise=c, nambu=None, noise_hamiltonians=others)


def any_hamiltonians(*, degree: int = 4, least: int = 1) -> st.SearchStrategy[PolynomialSystem]:
    """Any B, with and without Casimirs."""
    kinds = st.one_of(some.poisson_systems(degree=5, largest=5), some.casimir_systems(degree=4, largest=5))
    return with_hamiltonians(kinds, degree=degree, least=least).filter(general)


def hamiltonian_steps() -> st.SearchStrategy[Case]:
    """Steps of systems with several Hamiltonians."""
    return some.steps(any_hamiltonians())


@st.composite
def _at_origin(draw: st.DrawFn) -> Case:
    """y0 = 0 with all terms that the fields and their slopes need there."""
    d, m = draw(st.integers(2, 4)), draw(st.integers(1, 2))

    def hamiltonian() -> poly.Polynomial:
        linear, square = poly.linear([draw(some.coefficients()) for _ in range(d)]), poly.squares((1.0,) * d)
        return poly.add(poly.add(linear, square), draw(some.polynomials(d, 3, least=2, terms=2)))

    B = draw(some.skew_structures(d, 2).filter(bool))
    B = tuple((i, j, poly.add(poly.constant(d, draw(some.coefficients())), entry)) for i, j, entry in B)
    others = tuple(hamiltonian() for _ in range(m))
    return from_origin(draw, PolynomialSystem(d, hamiltonian(), B, (1.0,) * m, noise_hamiltonians=others))


@st.composite
def additive_steps(draw: st.DrawFn) -> Case:
    """Additive noise along which H_0 is quadratic, and a length h for which all likely increments have a solution."""
    system = draw(separable_hamiltonians())
    y = tuple(draw(st.lists(some.components(), min_size=system.dimension, max_size=system.dimension)))
    return some.in_the_mean(Case(system, y))


@st.composite
def species_steps(draw: st.DrawFn) -> Case:
    """Lotka-Volterra with any parameters and noises at its species, which has a domain: all components positive.

    States from 2⁻¹⁰ to 6, and steps that move a logarithm by up to 4 with each of the fields. A case is left out where
    the splitting with exact flows leaves 2^±64, and another right scheme might overflow or underflow.
    """
    c = draw(some.noises(least=1, most=3).filter(any))
    beta = tuple(draw(some.coefficients()) for _ in range(3))
    others = tuple((name, (draw(some.coefficients()),)) for name in ("a", "b", "d", "nu", "mu"))
    data = NamedProblem("random-lotka-volterra", (("beta", beta), ("noise", c), *others))
    y = tuple(draw(st.sampled_from([1.0, 1.5])) * 2.0 ** draw(st.integers(-10, 2)) for _ in range(3))
    problem, state = problems.build(data), np.array(y)
    length = draw(st.sampled_from([4.0, 2.0, 1.0, 0.25]))
    h = length * draw(st.sampled_from([0.5, 0.0625])) / _rate(vector_field(problem, state), state)
    shares = [draw(st.sampled_from([1.0, -1.0, 0.5, -0.25])) for _ in c]
    rates = [_rate(v * noise_field(problem, j, state), state) for j, v in enumerate(c)]
    dW = tuple(length * share / rate for share, rate in zip(shares, rates, strict=True))
    with np.errstate(all="ignore"):
        end = stochastic_splitting.step(problem, state, h, np.array(dW))
    assume(bool(np.all((end > 2.0**-64) & (end < 2.0**64))))
    return Case(data, y, h, dW)


def _rate(field: Array, y: Array) -> float:
    """How fast logarithms move, 1 at least."""
    return max(1.0, float(np.max(np.abs(field) / y)))


def _of(systems: st.SearchStrategy[PolynomialSystem], **more: int) -> st.SearchStrategy[Case]:
    return some.steps(with_hamiltonians(systems, **more).filter(general))


HAMILTONIANS: dict[str, Cases] = {
    "positivity": species_steps,
    "energy-drift": additive_steps,
    **dict.fromkeys(("contract", "reproducibility", "symmetry"), hamiltonian_steps),
    "casimir": lambda: _of(some.casimir_systems(degree=4)),
    "poisson-map": lambda: _of(poisson_structures()).map(some.halved),
    "symplecticity": lambda: _of(constant_structures()).map(some.halved),
    "identity": lambda: still(any_hamiltonians()),
    "noise-sum": lambda: some.steps(any_hamiltonians(least=2)),
    "expansion": lambda: _at_origin().filter(lambda case: general(case.problem)),  # type: ignore[arg-type]
    "equivariance": lambda: _of(
        some.poisson_systems(degree=4, largest=4, structure_degree=2), degree=3, most=2
    ),
}
