"""Störmer-Verlet and its compositions for H = ½ pᵀM⁻¹p + V(q): kicks p −= bΔ∇V(q)
and drifts q += aΔM⁻¹p in turn.

    kick b_1, drift a_1, kick b_2, …, drift a_s, kick b_{s+1},   Σa = Σb = 1,   Δ = h + Σ_j c_j ΔŴ_j

The leapfrog has b = (½, ½), a = (1) (L. Verlet, Phys. Rev. 159, 1967). Every kick and drift is the
exact flow of a part of H, so that the map is symplectic. It is symmetric if the coefficients read
the same from both ends. H is not kept, but its error stays bounded if the step is small. With the
random step Δ a method of even order p has mean-square and weak order p/2
(`sepv.schemes._explicit`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from sepv.core.formula import Fields, Values
from sepv.errors import Skipped, UsageError
from sepv.problem import Systems, mechanics
from sepv.schemes._one_step import CLAIMS_OF_ALL, Explicit, one_step
from sepv.schemes._scheme import Scheme

LEAPFROG_CLAIMS = CLAIMS_OF_ALL | {
    "identity", "noise-sum", "random-step", "poisson-map", "poisson-map:constant", "symmetry", "reversibility",
    "volume", "long-time-energy",
}  # fmt: skip


@dataclass(frozen=True)
class KicksAndDrifts:
    """The formula of a step of s + 1 kicks p −= bΔ∇V(q) and s drifts q += aΔM⁻¹p,
    for given numbers b and a.
    """

    kicks: tuple[float, ...]
    drifts: tuple[float, ...]

    def __call__(self, fields: Fields, y: Values, z: Values, step: Values) -> Values:  # noqa: ARG002 - explicit
        """The increment y1 − y of a step with Δ = step[0].
        Raises Skipped for a problem that is not mechanical.
        """
        try:
            system = mechanics(fields.problem)
        except UsageError as error:
            raise Skipped(f"{fields.problem.name} is not mechanical, H = ½ pᵀM⁻¹p + V(q)") from error
        q, p = system.split(y)
        first, *others = self.kicks

        def kick(b: float, q: Values, p: Values) -> Values:
            return -b * step[0] * system.split(fields.gradient(system.join(q, p)))[0]

        moved: Values = 0.0
        pushed = kick(first, q, p)
        for a, b in zip(self.drifts, others, strict=True):
            moved = moved + a * step[0] * system.velocity(p + pushed)
            pushed = pushed + kick(b, q + moved, p)
        return system.join(moved, pushed)


def composed_leapfrogs(shares: Sequence[float]) -> KicksAndDrifts:
    """Leapfrog steps of the lengths `shares`·Δ, one after the other,
    as one sequence of kicks and drifts.

    The last kick of each leapfrog step and the first kick of the next form one kick.
    """
    kicks = [0.5 * (a + b) for a, b in zip((0.0, *shares), (*shares, 0.0), strict=True)]
    return KicksAndDrifts(tuple(kicks), tuple(shares))


def palindrome(kicks: Sequence[float], drifts: Sequence[float]) -> KicksAndDrifts:
    """The symmetric sequence of kicks and drifts whose first half is given.

    The middle kick and the two middle drifts follow, because the kicks b add up to 1, and so do the
    drifts a.
    """
    b, a = (*kicks, 1 - 2 * sum(kicks)), (*drifts, 0.5 - sum(drifts))
    return KicksAndDrifts((*b, *b[-2::-1]), (*a, *a[::-1]))


def _scheme(name: str, formula: KicksAndDrifts, order: int, source: str) -> Scheme:
    made = one_step(
        name,
        Explicit(formula),
        LEAPFROG_CLAIMS,
        f"{source}, with the random step of (2.1)",
        order / 2,
        systems=Systems.MECHANICAL,
    )
    return replace(made, order=float(order))


_TRIPLE_JUMP = 1 / (2 - 2 ** (1 / 3))
scheme = _scheme("leapfrog", composed_leapfrogs((1.0,)), 2, "Störmer-Verlet, kick-drift-kick")
yoshida = _scheme(
    "yoshida-4",
    composed_leapfrogs((_TRIPLE_JUMP, 1 - 2 * _TRIPLE_JUMP, _TRIPLE_JUMP)),
    4,
    "triple jump of H. Yoshida (Phys. Lett. A 150, 1990)",
)
blanes_moan = _scheme(
    "blanes-moan-4",
    palindrome(
        (0.0829844064174052, 0.396309801498368, -0.0390563049223486), (0.245298957184271, 0.604872665711080)
    ),
    4,
    "SRKN6 of S. Blanes and P. C. Moan (J. Comput. Appl. Math. 142, 2002)",
)
