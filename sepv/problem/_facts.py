"""Facts about a system, from its channels alone: which fields have one H, one B, or all of both.

A channel F_k = S_k∇H_k + g_k − Γ_k y may have two forms. In a system with one H each S_k∇H_k is a
structure times ∇H (`Channel.keeping`), so that the flow without damping keeps H. In a system with
one B each S_k is B, and the flow keeps Casimirs of B. In (1.1) all fields are the same.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sepv.core.arrays import Array
from sepv.core.problem import Channel, Function, System
from sepv.errors import Skipped, SystemsError, UsageError


def one_field(problem: System) -> bool:
    """True for (1.1), dy = B∇H(dt + Σ c_j∘dW_j), where no noise is given a field of its own.

    Then a step has a random length Δ = h + Σ c_jΔW_j.
    """
    drift, *noises = problem.channels
    return not drift.damping and all(F is drift for F in noises)


def one_hamiltonian(problem: System) -> bool:
    """True if the fields are S_k∇H with one H, apart from damping, so that the noises keep H."""
    return all(F.keeping is not None for F in problem.channels)


def hamiltonian_noises(problem: System) -> bool:
    """True if no noise is given by a constant vector."""
    return all(F.gradient is not None for F in problem.channels)


def same_structure(problem: System) -> bool:
    """True if all structures are B, whatever vectors and damping there are."""
    return all(F.structure is problem.structure for F in problem.channels if F.gradient is not None)


def one_structure(problem: System) -> bool:
    """True if the fields are B∇H_k with one B, apart from damping."""
    return hamiltonian_noises(problem) and same_structure(problem)


def structures_of(problem: System) -> list[Function]:
    """The structures of the fields, B and those of noises that differ from it: S_k where there is
    one H, else B alone.
    """
    B = problem.structure
    return [B, *(F.keeping for F in problem.channels[1:] if F.keeping is not None and F.keeping is not B)]


def structures_with_derivatives(problem: System) -> list[Channel]:
    """The drift, and the noises whose structure differs from B and has a derivative."""
    drift, *noises = problem.channels
    return [drift, *(F for F in noises if F.structure is not drift.structure and F.structure_derivative)]


def hamiltonians_of(problem: System) -> list[Channel]:
    """The drift, and the noises with Hamiltonians of their own: the drift alone where there is one
    H.
    """
    drift, *noises = problem.channels
    return [drift, *(F for F in noises if F.keeping is None and F.gradient is not None)]


def noise_vectors(problem: System) -> Array:
    """The constant vectors g_j of additive noise, as rows (m, d); shape (0, d)
    if the noise is not given by vectors.
    """
    rows = [F.vector for F in problem.channels[1:] if F.vector is not None]
    return np.reshape(rows, (-1, problem.dimension))


def damping_matrix(problem: System) -> Array:
    """The matrix Γ (d, d) of the drift B∇H − Γy: γ times the unit matrix for −γy,
    zero without damping.
    """
    damping = np.asarray(problem.channels[0].damping, dtype=np.float64)
    return damping if damping.ndim else damping * np.eye(problem.dimension)


def damping_of(problem: System) -> float:
    """The rate of a problem's damping: γ for −γy, the largest row sum of |Γ| for −Γy,
    zero without damping.
    """
    damping = np.asarray(problem.channels[0].damping, dtype=np.float64)
    return float(np.max(np.sum(np.abs(damping), axis=1)) if damping.ndim else damping)


def damped(problem: System) -> bool:
    """True if the drift has damping or friction."""
    return bool(damping_of(problem))


def undamped(problem: System) -> bool:
    """True without damping and friction."""
    return not damped(problem)


def energy_changes(problem: System) -> bool:
    """True unless the exact flow keeps H of each system of this form."""
    return damped(problem) or not one_hamiltonian(problem)


def without_friction(problem: System) -> bool:
    """True without damping, or with −γy beside noises that have the field of the drift."""
    return undamped(problem) or uniform_damping(problem) is not None


def uniform_damping(problem: System) -> float | None:
    """The rate γ of dy = (B∇H − γy) dt + Σ c_j B∇H ∘dW_j, 0 for (1.1); None for other systems."""
    drift, *noises = problem.channels
    Gamma = damping_matrix(problem)
    alike = all(F.gradient is drift.gradient and F.structure is drift.structure for F in noises)
    uniform = np.array_equal(Gamma, Gamma[0, 0] * np.eye(problem.dimension))
    return float(Gamma[0, 0]) if alike and uniform else None


def require_one_field(problem: Any) -> None:
    """Raise UsageError or SystemsError unless a step has a random length, by the reason why it has
    none.
    """
    if one_field(problem):
        return
    if uniform_damping(problem):
        raise SystemsError(
            expected="a scheme for damped systems, such as conformal",
            received=f"a scheme for (1.1), which would leave out the damping of {problem.name}",
            remedy="use a scheme with systems='damped'",
        )
    if damping_of(problem):
        raise SystemsError(
            expected="a scheme for friction, such as baoab",
            received=f"a scheme for (1.1), which would leave out the friction of {problem.name}",
            remedy="use a scheme with systems='friction'",
        )
    if one_hamiltonian(problem):
        raise UsageError(
            expected="a scheme for several structures, such as several-structures",
            received=f"a scheme that reduces the noise of {problem.name} to one random step",
            remedy="use sepv.schemes.several_structures: with several structures there is no such step",
        )
    raise SystemsError(
        expected="a scheme for several Hamiltonians, such as stochastic-midpoint",
        received=f"a scheme that reduces the noise of {problem.name} to one random step",
        remedy="use a scheme with systems='hamiltonians': with several Hamiltonians there is no such step",
    )


def require_one_hamiltonian(problem: Any) -> None:
    """Raise UsageError unless the fields are S_k∇H with one H."""
    if not one_hamiltonian(problem):
        raise UsageError(
            expected="a scheme for several Hamiltonians, such as stochastic-midpoint",
            received=f"a scheme that takes the structures of noises, which {problem.name} does not have",
            remedy="use a scheme with systems='hamiltonians': with {H_0, H_j} ≠ 0 no scheme keeps H_0",
        )


def require_one_structure(problem: Any) -> None:
    """Raise Skipped unless the fields are B∇H_k with one B."""
    if any(F.gradient is None for F in problem.channels):
        raise Skipped(f"the noise of {problem.name} has vectors, and no Hamiltonians")
    if not one_structure(problem):
        raise Skipped(f"{problem.name} has several structures, and not several Hamiltonians")
