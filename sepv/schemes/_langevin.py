"""Splitting methods for Langevin dynamics, named by the order of their parts: BAOAB,
OBABO and others.

The letters of a name stand for exact flows of parts of dq = M⁻¹p dt, dp = (−∇V − γp) dt + σ dW over
the time h, shared evenly by equal letters (B. Leimkuhler and C. Matthews, Appl. Math. Res. Express
2013; Molecular Dynamics, 2015, §7.3):

    A: q ← q + tM⁻¹p,    B: p ← p − t∇V(q),
    O: p ← e^{−γt}p + √((1 − e^{−2γt})/(2γt)) σΔW,    ΔW ~ N(0, t).

A method with one O takes the increment ΔW of the step. One with two O's takes those of the two
halves of the step. With constant noise in p each of these methods has mean-square order 1, and a
palindrome has weak order 2. A and B are symplectic, and O multiplies each momentum by e^{−γt}, so
that Φ′BΦ′ᵀ = e^{−γh}B. For V = ½ω²q² BAOAB and ABOBA have the exact ⟨q²⟩ for every stable h, and
OBABO has the exact ⟨p²⟩.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sepv.errors import Skipped, UsageError
from sepv.problem import Array, Langevin, Problem, Systems, langevin
from sepv.schemes._one_step import CLAIMS_OF_ALL, one_step
from sepv.schemes._scheme import Scheme

LANGEVIN_CLAIMS = CLAIMS_OF_ALL | {"symmetry", "poisson-map:conformal", "equilibrium"}


def parts_of(problem: Problem) -> Langevin:
    """The `Langevin` of a problem. Raises Skipped for a problem that is none."""
    try:
        return langevin(problem)
    except UsageError as error:
        raise Skipped(f"{problem.name} has no friction −γp with constant noise in p") from error


@dataclass(frozen=True)
class Splitting:
    """The step of the method with the given letters, (problem, y, h, dW)
    or with `first` (problem, y, h, dW, first).
    """

    letters: str

    def __call__(self, problem: Problem, y: Array, h: float, dW: Array, first: Array | None = None) -> Array:
        """y1 from y (d,) or (d, M); `dW` and `first`, (m,) or (m, M),
        belong to the step and to its first half.
        """
        own, noise = parts_of(problem), np.asarray(dW)
        increments = iter((noise,) if first is None else (first, noise - first))
        q, p = own.mechanics.split(y)
        for letter in self.letters:
            t = h / self.letters.count(letter)
            if letter == "A":
                q = q + t * own.mechanics.velocity(p)
            elif letter == "B":
                p = p + t * own.mechanics.force(q)
            else:
                p = own.refreshed(p, t, next(increments))
        return own.mechanics.join(q, p)


def splitting(
    letters: str, claims: Any = LANGEVIN_CLAIMS, source: str = "Leimkuhler and Matthews (2013)"
) -> Scheme:
    """The splitting method with these letters A, B and O, of which one or two are O."""
    asks = "halves" if letters.count("O") == 2 else ""
    return of_friction(letters.lower(), Splitting(letters), claims, source, asks=asks)


def of_friction(name: str, step: Any, claims: Any, source: str, weak: float = 2.0, **facts: Any) -> Scheme:
    """A scheme for friction of mean-square order 1, and of order `weak` in the mean and without
    noise.
    """
    usual: dict[str, Any] = {"truncation": None, "systems": Systems.FRICTION, "weak_order": weak}
    return replace(one_step(name, step, claims, source, **usual | facts), order=weak)


scheme = baoab = splitting("BAOAB", LANGEVIN_CLAIMS | {"equilibrium:positions"})
obabo = splitting("OBABO", source="G. Bussi and M. Parrinello, Phys. Rev. E 75 (2007)")
