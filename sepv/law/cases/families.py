"""Random systems of narrow classes for which many schemes are made,
such as the systems with H = T(p) + V(q).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from itertools import combinations
from random import Random

import numpy as np

from sepv.law.cases import random_parts as some
from sepv.law.cases import strata
from sepv.law.cases.case import Case
from sepv.law.cases.random_cases import Parts, general, maker
from sepv.law.cases.strata import Levels, monomials
from sepv.problem import Matrix, PolynomialSystem, Problem, Structure, mechanics
from sepv.problem import friction as langevin_of
from sepv.problems import HAT, canonical, matrix_system, polynomial_problem, started
from sepv.record import Polynomial, poly

Constants = tuple[tuple[int, int, int, float], ...]


def canonical_separable(parts: Parts) -> PolynomialSystem:
    """H = T(p) + V(q) with y = (p_1, …, p_n, q_1, …, q_n) and B = J⁻¹ of (1.3): q̇ = ∇T, ṗ
    = −∇V.
    """
    n = parts.d // 2
    kinetic = _of(range(n), parts, parts.random.choice([2, 2, 3, 4]), least=2)
    potential = _of(range(n, 2 * n), parts, parts.degree)
    H = poly.add(kinetic, potential)
    return PolynomialSystem(parts.d, H, canonical(parts.d), parts.noise())


def mechanical(parts: Parts) -> PolynomialSystem:
    """H = ½ pᵀM⁻¹p + V(q) with y = (q, p) and B = J: q̇ = M⁻¹p, ṗ = −∇V.

    M⁻¹ = LᵀDL with powers of two in D and halves in L, so that M and M⁻¹ are exact. Momenta have
    few bits, so that M⁻¹p is exact. A library that stores velocities computes p = M(M⁻¹p) in each
    step. The row sums of |M||M⁻¹| bound the roundings of p in this product, so they are kept at
    most 16 for a full M. If the potential is to be bounded below, it has only even powers of the
    positions, with positive coefficients.
    """
    n, random, scale = parts.d // 2, parts.random, parts.unit**-2
    full = parts.levels["mass"].name == "full"
    sizes = [1.0, 0.5, 2.0] if full else [1.0, 0.5, 2.0, 0.25, 4.0]
    weights = [scale * random.choice(sizes) for _ in range(n)]
    rows = np.eye(n)
    if full:
        for i, j in combinations(range(n), 2):
            rows[i, j] = random.choice([0.5, -0.5] if j == i + 1 else [0.0, 0.5, -0.5])
    forms = [poly.linear([0.0] * n + row) for row in rows.tolist()]
    kinetic = [poly.scale(w / 2, poly.multiply(v, v)) for w, v in zip(weights, forms, strict=True)]
    if parts.levels["V"].name == "any":
        potential = _of(range(n), parts, parts.degree)
    else:
        half = -(-parts.degree // 2)
        found = some.hamiltonian(n, half, min(parts.terms, monomials(n, half)), 1.0, random)
        even = {tuple(2 * k for k in e): abs(c) * scale ** sum(e) for e, c in found.terms}
        potential = some.embedded(poly.polynomial(n, even), parts.d, range(n))
    parts.y = (*parts.y[:n], *(_short(p, parts.y) for p in parts.y[n:]))
    return PolynomialSystem(parts.d, poly.add(*kinetic, potential), canonical(parts.d, 1.0), parts.noise())


def _short(p: float, y: tuple[float, ...]) -> float:
    """Round a momentum p to twenty bits, so that a library can compute the velocity M⁻¹p from p
    without rounding.
    """
    unit = 2.0 ** (math.floor(math.log2(max(map(abs, y)) or 1.0)) - 20)
    return unit * round(p / unit)


def _of(places: range, parts: Parts, degree: int, least: int = 1) -> Polynomial:
    """A random polynomial of this degree in the variables whose numbers are `places`."""
    k = len(places)
    count = min(parts.terms, monomials(k, degree) - monomials(k, least - 1))
    found = some.hamiltonian(k, degree, count, parts.unit, parts.random, least=least)
    return some.embedded(found, parts.d, places)


# For each algebra: d, the structure constants (i, j, k, c) of {y_i, y_j} = Σ_k c y_k, quadratic and
# linear Casimirs.
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
    """The tuple (d, B(y) linear in y, quadratic Casimirs, linear Casimirs)
    of the Lie algebra `name` of `_ALGEBRAS`.
    """
    d, constants, quadratic, linear = _ALGEBRAS[name]
    B = tuple((i, j, poly.scale(c, poly.variable(d, k))) for i, j, k, c in constants)
    matrices = tuple(
        tuple(tuple(entries.get((min(i, j), max(i, j)), 0.0) for j in range(d)) for i in range(d))
        for entries in quadratic
    )
    return d, B, matrices, linear


def lie_poisson(parts: Parts) -> PolynomialSystem:
    """A Lie-Poisson system with any H: B(y)_ij = Σ_k c_ij^k y_k with the structure constants c_ij^k
    of an algebra.
    """
    d, B, quadratic, linear = algebra(parts.levels["algebra"].name)
    return PolynomialSystem(d, parts.hamiltonian(), B, parts.noise(), quadratic, linear)


def rigid_body(parts: Parts) -> PolynomialSystem:
    """The rigid body of §4.2 with a random inertia tensor I, H = ½ yᵀI⁻¹y,
    in its principal axes or in any others.

    The principal moments are I_k = Σ_j s_j − s_k for second moments s_j of the mass, from 1/16 to
    1, so that no moment exceeds the sum of the others: I is the tensor of some body. Its axes are
    turned by a random rotation.
    """
    spread = [2.0 ** -parts.random.uniform(0, 4) for _ in range(parts.d)]
    turned = (
        "inertia" in parts.levels and (strata.INERTIA.name, parts.levels["inertia"].name) != strata.IN_AXES
    )
    # 5v_k is no v_i v_j, so that no entry of the rotation is 0 off the diagonal, and no axis of the
    # body stays.
    v = [float(parts.random.choice([-3, -2, -1, 1, 2, 3])) if turned else 0.0 for _ in range(3)]
    return body(spread, (5.0, *v), parts.noise())


def body(spread: Sequence[float], quaternion: Sequence[float], c: tuple[float, ...]) -> PolynomialSystem:
    """The rigid body with second moments `spread` of its mass along axes that a quaternion (w, v)
    turns.

    The rotation is [(w² − |v|²)1 + 2vvᵀ + 2w v×]/(w² + |v|²).
    """
    d, B, quadratic, linear = algebra("so(3)")
    w, v = quaternion[0], np.array(quaternion[1:])
    cross = np.cross(np.eye(d), -v)
    Q = ((w * w - v @ v) * np.eye(d) + 2 * np.outer(v, v) + 2 * w * cross) / (w * w + v @ v)
    inverse = (Q / (sum(spread) - np.array(spread))) @ Q.T
    forms = [poly.multiply(poly.variable(d, i), poly.linear(inverse[i])) for i in range(d)]
    return PolynomialSystem(d, poly.scale(0.5, poly.add(*forms)), B, c, quadratic, linear)


@cache
def small_body(quaternion: tuple[float, ...]) -> Problem:
    """A body with moments of inertia near 1e-4, as a phone has in kg m²,
    which turns once in about six seconds.
    """
    unit = 2.0**-13
    data = body([unit * s for s in (1.0, 0.5, 0.125)], quaternion, (0.5,))
    return started(data, "small-body", tuple(unit * y for y in (0.75, 0.5, -0.25)))


def matrix_hamiltonians(parts: Parts) -> PolynomialSystem | None:
    """A system with the Lie-Poisson B of so(3), so(4) or su(3) and random H_0, H_j;
    None if all {H_0, H_j} vanish.
    """
    H, c = parts.hamiltonian(), parts.noise()
    others = tuple(parts.further() for _ in c)
    return general(matrix_system(parts.levels["matrices"].name, H, c, others))


def separable_hamiltonians(parts: Parts) -> PolynomialSystem:
    """A system with H_0 = ½ Σ w_k p_k² + V(q), B = J⁻¹ of (1.3)
    and linear H_j = −Σ_k σ_jk q_k for the noises.
    """
    n, random = parts.d // 2, parts.random
    kinetic = poly.squares([random.choice([1.0, 0.5, 2.0]) for _ in range(n)] + [0.0] * n)
    H = poly.add(kinetic, _of(range(n, 2 * n), parts, parts.degree))
    c = tuple(v or 0.5 for v in parts.noise())
    pushes = [[-some.coefficient(random) for _ in range(n)] for _ in c]
    others = tuple(poly.linear([0.0] * n + row) for row in pushes)
    return PolynomialSystem(2 * n, H, canonical(2 * n), c, noise_hamiltonians=others)


def _homogeneous(parts: Parts) -> PolynomialSystem:
    """A system with a random B, with or without Casimirs,
    and an H whose terms all have the same degree.
    """
    d, n = parts.d, parts.degree
    B, quadratic, linear = parts.structure()
    count = min(parts.terms, monomials(d, n) - monomials(d, n - 1))
    H = some.hamiltonian(d, n, count, parts.unit, parts.random, least=n)
    return PolynomialSystem(d, H, B, parts.noise(), quadratic, linear)


_HOMOGENEOUS = maker(_homogeneous, shows=False)


def damped(levels: Levels, random: Random, attempt: int | None) -> Case | None:
    """A step of a system with damping −γy dt, homogeneous H and |γh| from 1/16 to 1/8:
    e^{−2γh} is far from 1 − 2γh.

    For γh < 0 half a step of damping makes the state larger by 7 % at most, so that the step is
    less than twice as long as the contraction radius.
    """
    case = _HOMOGENEOUS(levels, random, attempt)
    if case is None or not isinstance(case.problem, PolynomialSystem) or not case.h:
        return None
    gamma = random.choice([1.0, 1.0, -1.0]) * 2.0 ** math.floor(math.log2(0.125 / abs(case.h)))
    return replace(case, problem=replace(case.problem, damping=gamma))


_WITHOUT_FRICTION = maker(mechanical, (2, 4, 6), shows=False)
# The size of the noise of a step in p, relative to |y|: inside the ball of the contraction radius
# of most cases.
THERMAL_SHARE = 0.125


def friction(levels: Levels, random: Random, attempt: int | None) -> Case | None:
    """A step of Langevin dynamics with a mechanical H, γ|h| from 1/16 to 1/8,
    and a noise of THERMAL_SHARE |y| at most.

    There is one noise for each degree of freedom, because the noise of a temperature has the rank
    of M.
    """
    case = _WITHOUT_FRICTION(levels, random, attempt)
    if case is None or not isinstance(case.problem, PolynomialSystem) or not case.h:
        return None
    bare = polynomial_problem(replace(case.problem, noise=()))
    gamma = 2.0 ** math.floor(math.log2(0.125 / abs(case.h)))
    largest = max(map(abs, case.y)) or 1.0
    kT = (THERMAL_SHARE * largest) ** 2 / (2 * gamma * abs(case.h) * float(np.max(mechanics(bare).mass)))
    made = langevin_of(bare, gamma, kT).data
    assert isinstance(made, PolynomialSystem)
    share = math.sqrt(abs(case.h)) / len(made.noise)
    dW = tuple(random.choice([1.0, -1.0]) * random.uniform(0.125, 1) * share for _ in made.noise)
    return replace(case, problem=made, dW=dW)


def additive(parts: Parts) -> PolynomialSystem:
    """A system with additive noise Σ c_j g_j∘dW_j: a random B,
    and H = ½ Σ w_k p_k² + p_1 q_1 + V(q) with y = (p, q).

    The g_j have nonzero components in p alone. Sometimes y has no part q: then H = ½ Σ w_k p_k².
    """
    d, random = parts.d, parts.random
    B, quadratic, linear = parts.structure()
    n = random.choice([d, random.randint(1, d - 1)])
    H = poly.squares([random.choice([1.0, 0.5, 2.0]) for _ in range(n)] + [0.0] * (d - n))
    if n < d:
        H = poly.add(H, _of(range(n, d), parts, parts.degree))
        H = poly.add(H, poly.multiply(poly.variable(d, 0), poly.variable(d, n)))
    c = tuple(v or 0.5 for v in parts.noise())
    pushes = [[some.coefficient(random) / parts.unit for _ in range(n)] + [0.0] * (d - n) for _ in c]
    return PolynomialSystem(d, H, B, c, quadratic, linear, noise_vectors=tuple(map(tuple, pushes)))
