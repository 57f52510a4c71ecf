"""Families of systems that many schemes are made for: what `Scheme.systems` and ``sepv verify -p`` know by name.

A family is a strategy of random systems, from which the laws about one step draw, and problems with an initial state,
for the laws about many steps.
"""

from __future__ import annotations

from collections.abc import Callable

from hypothesis import assume
from hypothesis import strategies as st

from sepv import problems
from sepv.problem import HamiltoniansProblem, PolynomialSystem, Systems
from sepv.problem._problem import Matrix, Structure
from sepv.problems._common import HAT, canonical
from sepv.record import Polynomial
from sepv.record import _polynomial as poly
from sepv.verification.strategies import coefficients, hamiltonians, noises

Constants = tuple[tuple[int, int, int, float], ...]


@st.composite
def canonical_separable(draw: st.DrawFn) -> PolynomialSystem:
    """H = T(p) + V(q) with y = (p_1, …, p_n, q_1, …, q_n) and B = J⁻¹ of (1.3): q̇ = ∇T, ṗ = −∇V.

    Examples shrink towards the harmonic oscillator in one pair.
    """
    n = draw(st.integers(1, 3))
    kinetic = _placed(draw(hamiltonians(n, 4 if draw(st.booleans()) else 2, least=2)), 2 * n, 0)
    potential = _placed(draw(hamiltonians(n, 6)), 2 * n, n)
    return PolynomialSystem(2 * n, poly.add(kinetic, potential), canonical(2 * n), draw(noises()))


def _placed(p: Polynomial, dimension: int, first: int) -> Polynomial:
    """The polynomial in the variables first, first + 1, … of a larger space."""
    left, right = (0,) * first, (0,) * (dimension - first - p.dimension)
    return poly.polynomial(dimension, [((*left, *e, *right), c) for e, c in p.terms])


# Structure constants {y_i, y_j} = Σ_k c y_k as (i, j, k, c), quadratic Casimirs as diagonals or entries, linear ones.
_ALGEBRAS: dict[str, tuple[int, Constants, tuple[dict[tuple[int, int], float], ...], Matrix]] = {
    "so(3)": (3, HAT, ({(0, 0): 1.0, (1, 1): 1.0, (2, 2): 1.0},), ()),
    "sl(2)": (3, ((0, 1, 2, 1.0), (0, 2, 1, 1.0), (1, 2, 0, -1.0)),
              ({(0, 0): 1.0, (1, 1): 1.0, (2, 2): -1.0},), ()),
    "e(2)": (3, ((0, 1, 2, 1.0), (0, 2, 1, -1.0)), ({(1, 1): 1.0, (2, 2): 1.0},), ()),
    "heisenberg": (3, ((0, 1, 2, 1.0),), (), ((0.0, 0.0, 1.0),)),
    "e(3)": (6, ((0, 1, 2, 1.0), (0, 2, 1, -1.0), (1, 2, 0, 1.0), (0, 4, 5, 1.0), (0, 5, 4, -1.0), (1, 3, 5, -1.0),
                 (1, 5, 3, 1.0), (2, 3, 4, 1.0), (2, 4, 3, -1.0)),
             ({(3, 3): 1.0, (4, 4): 1.0, (5, 5): 1.0}, {(0, 3): 0.5, (1, 4): 0.5, (2, 5): 0.5}), ()),
}  # fmt: skip


def algebra(name: str) -> tuple[int, Structure, tuple[Matrix, ...], Matrix]:
    """(d, B(y) linear in y, quadratic Casimirs, linear Casimirs) of a Lie algebra of `_ALGEBRAS`."""
    d, constants, quadratic, linear = _ALGEBRAS[name]
    B = tuple((i, j, poly.scale(c, poly.variable(d, k))) for i, j, k, c in constants)
    matrices = tuple(
        tuple(tuple(entries.get((min(i, j), max(i, j)), 0.0) for j in range(d)) for i in range(d))
        for entries in quadratic
    )
    return d, B, matrices, linear


@st.composite
def lie_poisson(draw: st.DrawFn) -> PolynomialSystem:
    """B(y)_ij = Σ_k c_ij^k y_k of a Lie algebra, any polynomial H. Examples shrink towards so(3), H = ½|y|²."""
    d, B, quadratic, linear = algebra(draw(st.sampled_from(list(_ALGEBRAS))))
    return PolynomialSystem(d, draw(hamiltonians(d, 4)), B, draw(noises()), quadratic, linear)


@st.composite
def rigid_bodies(draw: st.DrawFn) -> PolynomialSystem:
    """§4.2 with random moments of inertia: H = ½ Σ w_k y_k², w_k = 1/I_k in eighths. Examples shrink towards w = 1."""
    d, B, quadratic, linear = algebra("so(3)")
    weights = [draw(st.sampled_from([8, 4, 6, 10, 12, 16, 20, 24])) / 8 for _ in range(d)]
    return PolynomialSystem(d, poly.squares(weights), B, draw(noises()), quadratic, linear)


def general(system: PolynomialSystem) -> bool:
    """Whether some bracket {H_0, H_j} of several Hamiltonians does not vanish."""
    return isinstance(problems.build(system), HamiltoniansProblem)


@st.composite
def so3_hamiltonians(draw: st.DrawFn) -> PolynomialSystem:
    """B of the rigid body, any H_0, …, H_m that do not all commute with H_0. Examples shrink towards ½|y|²."""
    d, B, quadratic, linear = algebra("so(3)")
    c = draw(noises(least=1, most=3).filter(any))
    H, *others = (draw(hamiltonians(d, 4)) for _ in range(1 + len(c)))
    system = PolynomialSystem(d, H, B, c, quadratic, linear, noise_hamiltonians=tuple(others))
    assume(general(system))
    return system


@st.composite
def separable_hamiltonians(draw: st.DrawFn) -> PolynomialSystem:
    """H_0 = ½ Σ w_k p_k² + V(q), B = J⁻¹ and H_j = −Σ_k σ_jk q_k. Examples shrink towards the oscillator, pushed."""
    n = draw(st.integers(1, 2))
    kinetic = poly.squares([draw(st.sampled_from([1.0, 0.5, 2.0])) for _ in range(n)] + [0.0] * n)
    potential = _placed(draw(hamiltonians(n, 4)), 2 * n, n)
    c = draw(noises(least=1, most=2).filter(all))
    pushes = [draw(st.lists(coefficients(), min_size=n, max_size=n)) for _ in c]
    others = tuple(poly.linear([0.0] * n + [-s for s in row]) for row in pushes)
    H = poly.add(kinetic, potential)
    return PolynomialSystem(2 * n, H, canonical(2 * n), c, noise_hamiltonians=others)


# name: (the strategy, problems for the laws about many steps)
FAMILIES: dict[Systems, tuple[Callable[[], st.SearchStrategy[PolynomialSystem]], tuple[str, ...]]] = {
    Systems.CANONICAL_SEPARABLE: (canonical_separable, ("harmonic-oscillator", "pendulum")),
    Systems.LIE_POISSON: (lie_poisson, ("rigid-body",)),
    Systems.RIGID_BODIES: (rigid_bodies, ("rigid-body",)),
    Systems.SO3_HAMILTONIANS: (
        so3_hamiltonians,
        ("random-inertia", "two-spins", "commuting-twists", "twisted-top"),
    ),
    Systems.SEPARABLE_HAMILTONIANS: (separable_hamiltonians, ("noisy-henon-heiles",)),
}
