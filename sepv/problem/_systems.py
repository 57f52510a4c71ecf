"""The classes of systems for which schemes are made, each with the facts that its systems have."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from typing import Self

from sepv.core.problem import System
from sepv.problem._facts import (
    damped,
    energy_changes,
    hamiltonian_noises,
    one_field,
    one_hamiltonian,
    same_structure,
    undamped,
    without_friction,
)

# A fact about a system, computed from its channels.
Fact = Callable[[System], bool]
# The facts that laws ask for, in the words of the laws' pages.
FACTS: dict[Fact, str] = {
    one_field: "one field",
    one_hamiltonian: "one H",
    same_structure: "one B",
    hamiltonian_noises: "no noise by vectors",
    energy_changes: "H changes",
    damped: "damping",
    undamped: "no damping",
    without_friction: "no friction",
}
_UNDAMPED = (undamped, without_friction)
_ONE_FIELD = (one_field, one_hamiltonian, same_structure, hamiltonian_noises, *_UNDAMPED)
_HAMILTONIANS = (same_structure, hamiltonian_noises, energy_changes, *_UNDAMPED)


class Systems(StrEnum):
    """The classes of systems for which schemes are made;
    a text such as "single" may stand for a class.

    Attributes
    ----------
    facts : frozenset of functions of a problem
        What holds for all systems of the class, such as `sepv.problem.one_hamiltonian`. Laws ask
        for facts.

    single
        (1.1): dy = B(y)∇H(y)(dt + Σ c_j∘dW_j).
    nambu
        (1.1) in dimension three with B(y)v = g(y)(v × ∇C(y)) for a Casimir C and a factor g:
        `Problem.nambu`.
    several
        A structure G_j for each noise, or Hamiltonians H_j with {H_0, H_j} = ∇H_0ᵀB∇H_j = 0. The
        flow keeps H.
    hamiltonians
        A Hamiltonian H_j for each noise, whether or not {H_0, H_j} = 0.

    Laws draw random systems from narrower classes too:

    canonical-separable
        (1.1) with H = T(p) + V(q), y = (p, q) and B = J⁻¹, where J = [[0, I], [−I, 0]].
    mechanical
        (1.1) with H = ½ pᵀM⁻¹p + V(q), y = (q, p), positions first, and B = J:
        `sepv.problem.mechanics`.
    lie-poisson
        (1.1) with B linear in y.
    rigid-bodies
        The rigid body of the paper's §4.2 with a random inertia tensor, H = ½ yᵀI⁻¹y.
    principal-bodies
        Rigid bodies in their principal axes, H = ½ Σ y_k²/I_k, for schemes that read three moments
        of inertia.
    matrix-hamiltonians
        Several Hamiltonians with B of a Lie algebra of matrices: so(3), so(4) or su(3).
    separable-hamiltonians
        H_0 = ½ Σ w_k p_k² + V(q), and noise that is additive in p.
    additive
        dy = B(y)∇H dt + Σ c_j g_j dW_j with constant g_j, in the image of B or not, and H quadratic
        along them. Some problems give vectors (`sepv.problem.noise_vectors`), others linear H_j
        with g_j = B∇H_j.
    damped
        dy = (B(y)∇H − γy) dt + Σ c_j B(y)∇H ∘dW_j with a homogeneous H
        (`sepv.problem.DampedProblem`).
    friction
        dq = M⁻¹p dt, dp = (−∇V − γp) dt + σ dW, Langevin dynamics at a temperature
        (`sepv.problem.friction`).
    """

    facts: frozenset[Fact]

    def __new__(cls, text: str, *facts: Fact) -> Self:
        """Make a class of systems that have these facts."""
        systems = str.__new__(cls, text)
        systems._value_, systems.facts = text, frozenset(facts)
        return systems

    SINGLE = "single", *_ONE_FIELD
    NAMBU = "nambu", *_ONE_FIELD
    SEVERAL = "several", one_hamiltonian, hamiltonian_noises, *_UNDAMPED
    HAMILTONIANS = "hamiltonians", *_HAMILTONIANS
    CANONICAL_SEPARABLE = "canonical-separable", *_ONE_FIELD
    MECHANICAL = "mechanical", *_ONE_FIELD
    LIE_POISSON = "lie-poisson", *_ONE_FIELD
    RIGID_BODIES = "rigid-bodies", *_ONE_FIELD
    PRINCIPAL_BODIES = "principal-bodies", *_ONE_FIELD
    MATRIX_HAMILTONIANS = "matrix-hamiltonians", *_HAMILTONIANS
    SEPARABLE_HAMILTONIANS = "separable-hamiltonians", *_HAMILTONIANS
    ADDITIVE = "additive", same_structure, energy_changes, *_UNDAMPED
    DAMPED = (
        "damped",
        one_hamiltonian,
        same_structure,
        hamiltonian_noises,
        energy_changes,
        damped,
        without_friction,
    )
    FRICTION = "friction", same_structure, energy_changes, damped

    @property
    def several_fields(self) -> bool:
        """True if different noises have different fields and nothing is damped,
        so that the class has no systems without noise.
        """
        return undamped in self.facts and one_field not in self.facts
