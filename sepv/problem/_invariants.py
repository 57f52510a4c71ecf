"""Functions I of the state that a user states as invariants,
and what the exact flow makes of each of them.

With the drift F_0 and the fields F_j of the noises, dy = F_0 dt + Σ_j c_j F_j ∘dW_j has the
generator

    L = X_0 + ½ Σ_j c_j² X_j²,      X_j I = ∇Iᵀ F_j.

If LI = σ − λI with constants σ and λ, E[I] solves dE[I]/dt = σ − λE[I] (Itô's formula), so that

    E[I(y(h))] = e^(−λh) I(y(0)) + σ (1 − e^(−λh))/λ.                                            (E)

If no noise moves I, X_j I = 0 for all c_j ≠ 0, then dI = X_0 I dt = (σ − λI) dt on each path, and
(E) holds without the mean. I is kept if σ = λ = 0. A function I for which LI is not σ − λI has no
such formula, and is refused.

LI and the X_j I are recorded, and evaluated with GENERATOR_DIGITS digits at a few states in general
position.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from sepv.core.arrays import Array
from sepv.core.problem import Channel, Function
from sepv.errors import ProblemError
from sepv.problem._checks import sample_states
from sepv.problem._derived import recorded_as
from sepv.problem._facts import damping_matrix
from sepv.problem._stated import Stated
from sepv.record import EPS, CannotRecord, Tape, gradient, replay

# Decimal digits of LI: a cancellation of half of them leaves more than those of binary64.
GENERATOR_DIGITS = 40
# A constant in a user's code is a rounded number, so LI may differ from σ − λI by a few roundings
# of its terms. Twice the residual of a step is at least 64 eps of these terms
# (`sepv.law.tolerance`), so the law's bound, which has this residual, covers the difference.
RECORDED_TOLERANCE = 64 * EPS


@dataclass(frozen=True)
class Relation:
    """The relation LI = σ − λI of a stated function I.

    Attributes
    ----------
    sigma, decay : float
        The constants σ and λ.
    moved : tuple of int
        The numbers j = 0, …, m − 1 of the noises that move I; (E) is pathwise if there are none.
    drifts : bool
        True if the drift F_0 moves I.
    """

    sigma: float
    decay: float
    moved: tuple[int, ...]
    drifts: bool

    @property
    def words(self) -> str:
        """The relation in words."""
        if not (self.sigma or self.decay):
            law = "LI = 0"
        else:
            parts = [f"{self.sigma:.6g}"] * bool(self.sigma) + [f"−{self.decay:.6g} I"] * bool(self.decay)
            law = f"LI = {' '.join(parts)}".replace("−-", "")
        noises = ", ".join(str(j + 1) for j in self.moved)
        return f"{law}, {f'in the mean: noise {noises} moves I' if noises else 'on each path'}"


def relation(problem: Stated, name: str) -> Relation:
    """The relation LI = σ − λI of the function I = `problem.invariants[name]`.

    Raises
    ------
    ProblemError
        If there are no such constants, with a state that shows it, or if I, B or ∇H cannot be
        recorded.
    """
    return _relation(problem, name, problem.c.tobytes())


def require_invariants(problem: Stated) -> None:
    """Raise a ProblemError unless every function in `problem.invariants` has a relation LI = σ
    − λI.
    """
    for name in problem.invariants:
        relation(problem, name)


@lru_cache(maxsize=256)
def _relation(problem: Stated, name: str, _noise: bytes) -> Relation:
    y, outputs = _generator(problem, name)
    states = list(sample_states(problem))
    rows = [_values(outputs, y, state) for state in states]
    fields = 1 + problem.noises
    moved = [
        any(abs(row[1 + k]) > RECORDED_TOLERANCE * row[1 + fields + k] for row in rows) for k in range(fields)
    ]  # X_k I, and the terms of X_k I
    sigma, decay = _constants(name, states, rows)
    noises = tuple(j for j in range(problem.noises) if problem.c[j] and moved[1 + j])
    return Relation(float(sigma), float(decay), noises, moved[0])


def _constants(name: str, states: list[Array], rows: list[list[Any]]) -> tuple[Any, Any]:
    """σ and λ by the states (rows begin with I and end with LI and the size of its terms);
    0 where 0 will do.
    """
    I, L, allowed = ([row[k] for row in rows] for k in (0, -2, -1))
    allowed = [RECORDED_TOLERANCE * size for size in allowed]
    largest = max(range(len(I)), key=lambda s: abs(I[s]))
    far = max(range(len(I)), key=lambda s: abs(I[s] - I[largest]))
    tried: list[tuple[Any, Any]] = [(0, 0), (L[largest], 0)]
    if I[largest]:
        tried.append((0, -L[largest] / I[largest]))
    if I[far] != I[largest]:
        decay = (L[largest] - L[far]) / (I[far] - I[largest])
        tried.append((L[largest] + decay * I[largest], decay))

    def wrong(sigma: Any, decay: Any, s: int) -> bool:
        size = allowed[s] + allowed[largest] + allowed[far]
        return bool(abs(L[s] - sigma + decay * I[s]) > size)

    for sigma, decay in tried:
        off = [s for s in range(len(I)) if wrong(sigma, decay, s)]
        if not off:
            return sigma, decay
    s = off[0]
    raise ProblemError(
        expected=f"invariants[{name!r}]: a function I with LI = σ − λI for constants σ and λ, where LI = ∇IᵀF_0 + "
        "½ Σ c_j² ∇(∇IᵀF_j)ᵀF_j for the drift F_0 and the noises F_j",
        received=f"LI = {float(L[s])!r} and I = {float(I[s])!r} at y = {states[s].tolist()}, where two other states "
        f"give σ − λI = {float(sigma - decay * I[s])!r}",
        remedy="state a function that the exact flow keeps, or whose mean grows or decays at a constant rate; or "
        "leave it out",
    )


def _generator(problem: Stated, name: str) -> tuple[Any, Any]:
    """Symbols of y, and of I, X_0 I, …, X_m I, the sizes of their terms,
    LI and the size of its terms.
    """
    d = problem.dimension
    tape = Tape()
    y = tape.vector(d)
    I = recorded_as(tape, f"invariants[{name!r}]", problem.invariants[name], y, ())
    drift, noises = _fields(problem, tape, y)
    slope = gradient(I, y)
    along = [_along(slope, F) for F in (drift, *noises)]
    total, size = along[0]
    for c, F, (moves, _) in zip(problem.c, noises, along[1:], strict=False):
        twice, terms = _along(gradient(tape.symbol(moves), y), F)
        total, size = total + 0.5 * c * c * twice, size + 0.5 * c * c * terms
    rows = [I, *(value for value, _ in along), *(terms for _, terms in along), total, size]
    return y, [tape.symbol(v) for v in rows]


def _along(slope: Any, F: Any) -> tuple[Any, Any]:
    """The derivative Σ_i slope_i F_i along a field, and the sum of the absolute values of its
    terms.
    """
    terms = [a * b for a, b in zip(slope, F, strict=True)]
    return sum(terms[1:], start=terms[0]), sum((abs(t) for t in terms[1:]), start=abs(terms[0]))


def _fields(problem: Stated, tape: Any, y: Any) -> tuple[Any, list[Any]]:
    """Symbols of the drift F_0 (d,) and of the fields F_1, …, F_m of the noises, without their
    c_j.
    """
    drift, *noises = problem.channels
    flow = _field(problem, tape, y, drift, "", "hamiltonian")
    fields = [
        flow if F is drift else _field(problem, tape, y, F, "a noise ", "a noise Hamiltonian") for F in noises
    ]
    return flow - damping_matrix(problem) @ y if drift.damping else flow, fields


def _field(problem: Stated, tape: Any, y: Any, F: Channel, of: str, potential: str) -> Any:
    """Symbols of S∇H or of the constant vector of a channel; messages have the other two texts."""
    d = problem.dimension
    if F.structure is None or F.gradient is None:
        return list(F.vector)
    S = recorded_as(tape, f"{of}structure", F.structure, y, (d, d))
    if F.hamiltonian is None:
        return S @ recorded_as(tape, f"{of}gradient", F.gradient, y, (d,))
    return S @ _gradient(tape, potential, F.gradient, F.hamiltonian, y)


def _gradient(tape: Any, key: str, given: Function | None, potential: Function, y: Any) -> Any:
    """The gradient (d,) in symbols, of the recorded `potential`,
    or as `given` where that one cannot be recorded.
    """
    try:
        return gradient(recorded_as(tape, key, potential, y, ()), y)
    except (ProblemError, CannotRecord):
        if given is None:
            raise
        return recorded_as(tape, "gradient", given, y, y.shape)


def _values(outputs: Any, y: Any, state: Array) -> list[Any]:
    """The recorded outputs at a state (d,), as numbers of GENERATOR_DIGITS digits."""
    import mpmath

    ctx = mpmath.MPContext()
    ctx.dps = GENERATOR_DIGITS
    values = {x.index: ctx.mpf(float(v)) for x, v in zip(y, state, strict=True)}
    return replay(outputs, values, lambda f, x: getattr(ctx, _MPMATH_NAMES.get(f, f))(x), ctx.mpf)


# mpmath's names of recorded functions, where they differ.
_MPMATH_NAMES = {"arctan": "atan"}
