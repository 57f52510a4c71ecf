"""Systems on n copies of so(3)*: the rigid body with random inertia,
and two spins with noise at their sites.

In each block of three components B(y)v = y × v, as for the rigid body, so that |y|² of each block
is a Casimir.

- Random inertia: H_0 = ½ Σ y_i²/I_i and H_j = ½ y_j²/Î_j for the first m axes. The fields do not
  commute. See C.-E. Bréhier, D. Cohen and T. Jahnke, Splitting integrators for stochastic
  Lie-Poisson systems (Math. Comp. 92, 2023).
- A push: the free rigid body under additive noise in directions that leave the sphere |y| = const.
  This problem is of the kind that D. Cohen and G. Vilmart treat (arXiv 2005.13991); its numbers are
  not theirs.
- Twists: the rigid body's H_0 with one noise whose field is nonlinear in y, or with two such noises
  that commute.
- Two spins: Heisenberg's H_0 = −J s_1·s_2 + ½ D (s_1z² + s_2z²), and a random field at each site,
  H_j = b_j·s_j. The fields of the two noises commute with each other, because they turn different
  spins, but not with the drift.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sepv.problem import PolynomialSystem, Problem
from sepv.problems._common import hat
from sepv.problems._polynomial_system import started
from sepv.problems._rigid_body import rigid_body
from sepv.record import poly


def spin_system(
    spins: int, hamiltonian: poly.Polynomial, noise: Sequence[float], others: Sequence[poly.Polynomial]
) -> PolynomialSystem:
    """The system of n = `spins` spins with H_0 = `hamiltonian` and the H_j in `others`,
    polynomials in 3n variables.
    """
    blocks = np.eye(spins).repeat(3, axis=1)
    casimirs = tuple(tuple(map(tuple, np.diag(block).tolist())) for block in blocks)
    B, H = hat(spins=spins), tuple(others)
    return PolynomialSystem(3 * spins, hamiltonian, B, tuple(noise), casimirs, noise_hamiltonians=H)


def random_inertia(
    inertia: Sequence[float] = (0.345, 0.653, 1.0),
    noise_inertia: Sequence[float] = (1.0, 0.5),
    noise: Sequence[float] = (0.5, 0.5),
) -> Problem:
    """The rigid body with random inertia: each noise j has the Hamiltonian H_j = ½y_j²/Î_j,
    with j = 1, 2, 3 at most.

    The initial state is (0.8, 0.6, 0). The flow of each H_j is a rotation at a rate that depends
    on y.
    """
    count = len(noise_inertia)
    weights = np.diag([1 / I for I in noise_inertia] + [0.0] * (3 - count))
    others = [poly.squares(row) for row in weights[:count]]
    data = spin_system(1, poly.squares([1 / I for I in inertia]), noise, others)
    flows, padded = rigid_body(inertia).flows, rigid_body((*noise_inertia, *(1.0,) * (3 - count))).flows
    return started(data, "random-inertia", (0.8, 0.6, 0.0), flows=flows, noise_flows=padded[:count])


def pushed_rigid_body(
    inertia: Sequence[float] = (0.345, 0.653, 1.0),
    noise: Sequence[float] = (0.5, 0.25),
    vectors: Sequence[Sequence[float]] = ((1.0, 0.5, 0.0), (0.0, 0.5, 1.0)),
) -> Problem:
    """The rigid body with additive noise Σ c_j g_j dW_j,
    whose vectors g_j are not in the image of B.

    The initial state is (0.8, 0.6, 0). E[H] grows at the rate ½ Σ c_j² Σ_i g_ji²/I_i, E|y|² at the
    rate Σ c_j²|g_j|².
    """
    data = spin_system(1, poly.squares([1 / I for I in inertia]), noise, ())
    data = replace(data, noise_vectors=tuple(tuple(map(float, g)) for g in vectors))
    return started(data, "pushed-rigid-body", (0.8, 0.6, 0.0), flows=rigid_body(inertia).flows)


def two_spins(
    coupling: float = 1.0,
    anisotropy: float = 0.5,
    fields: Sequence[Sequence[float]] = ((1.0, 0.0, 0.0), (0.0, 0.6, 0.8)),
    noise: Sequence[float] = (0.5, 0.25),
) -> Problem:
    """Two coupled spins, each driven by its own noise through a magnetic field at its site.

    The initial states of the two spins are (0.8, 0.6, 0) and (0, 0.6, −0.8).
    """
    terms = [(tuple(int(n in (k, 3 + k)) for n in range(6)), -coupling) for k in range(3)]
    H = poly.add(poly.polynomial(6, terms), poly.squares((0, 0, anisotropy) * 2))
    others = [poly.linear((*(0,) * 3 * n, *field, *(0,) * 3 * (1 - n))) for n, field in enumerate(fields)]
    return started(spin_system(2, H, noise, others), "two-spins", (0.8, 0.6, 0.0, 0.0, 0.6, -0.8))


def twisted_top(noise: Sequence[float] = (0.5,)) -> Problem:
    """The rigid body with one noise, H_1 = ½y_1² + ½y_2y_3 + y_3, whose field g has g″(g, g) ≠ 0.

    The initial state is (0.8, 0.6, 0.3). A linear noise field, such as those of `two_spins`, has
    g″ = 0. It would hide the errors of schemes that difference g over a length of √h.
    """
    twist = poly.polynomial(3, [((2, 0, 0), 0.5), ((0, 1, 1), 0.5), ((0, 0, 1), 1.0)])
    return _twisted((twist,), noise, "twisted-top")


def commuting_twists(noise: Sequence[float] = (0.5, 0.5)) -> Problem:
    """The rigid body with two noises that commute, H_1 = ½y_3² and H_2 = y_3 + y_3³/6:
    rotations about one axis.

    The initial state is (0.8, 0.6, 0.3). The rates of the rotations depend on y_3. The noise fields
    g_1 and g_2 have g_2′g_1 ≠ 0; in `two_spins`, g_2′g_1 = 0, because g_1 and g_2 turn different
    spins.
    """
    second = poly.polynomial(3, [((0, 0, 1), 1.0), ((0, 0, 3), 1 / 6)])
    return _twisted((poly.squares((0, 0, 1)), second), noise, "commuting-twists")


def _twisted(others: Sequence[poly.Polynomial], noise: Sequence[float], name: str) -> Problem:
    data = random_inertia().data
    assert isinstance(data, PolynomialSystem)
    return started(spin_system(1, data.hamiltonian, noise, others), name, (0.8, 0.6, 0.3))
