"""The classes of systems: what a problem may be, and what a scheme may be for."""

from __future__ import annotations

from enum import StrEnum


class Systems(StrEnum):
    """A class of systems; its text is what users type, and is taken in its place.

    single
        (1.1): dy = B(y)∇H(y)(dt + Σ c_j∘dW_j).
    nambu
        (1.1) in dimension three with a Casimir and a factor, B(y)v = g(y)(v × ∇C(y)): `Problem.nambu`.
    several
        A structure G_j for each noise, or Hamiltonians H_j with {H_0, H_j} = 0: H is kept.
    hamiltonians
        A Hamiltonian H_j for each noise, whether or not {H_0, H_j} = 0.

    Narrower classes, of which laws draw random systems (`sepv.verification._cases.families`):

    canonical-separable
        (1.1) with H = T(p) + V(q), y = (p, q) and B = J⁻¹.
    lie-poisson
        (1.1) with B linear in y.
    rigid-bodies
        §4.2 with random moments of inertia.
    so3-hamiltonians
        Several Hamiltonians with B of the rigid body.
    separable-hamiltonians
        H_0 = ½|p|² + V(q), and noise that is additive in p.
    """

    SINGLE = "single"
    NAMBU = "nambu"
    SEVERAL = "several"
    HAMILTONIANS = "hamiltonians"
    CANONICAL_SEPARABLE = "canonical-separable"
    LIE_POISSON = "lie-poisson"
    RIGID_BODIES = "rigid-bodies"
    SO3_HAMILTONIANS = "so3-hamiltonians"
    SEPARABLE_HAMILTONIANS = "separable-hamiltonians"
