"""One solver of a library for general noise: its documented orders by kind of noise, and its step.

The problems are systems with several Hamiltonians, one system for each kind of noise. A solver of
Itô equations gets the system in Itô's form, which has the same solution. If a solver needs
space-time Lévy areas or the areas A_ij besides increments, it gets them from the path that the
reference solution uses (`sepv.simulate._areas`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache

from sepv import problems
from sepv.posing import Path
from sepv.problem import Problem
from sepv.schemes import Scheme, Step, Systems

# One system for each kind of noise. The systems are polynomial, so that the generator gives exact
# means. They have no symmetry that would make errors vanish.
PROBLEMS: dict[str, Callable[[], Problem]] = {
    "general": problems.random_inertia,
    "commutative": problems.commuting_twists,
    "one": problems.twisted_top,
    "additive": problems.pushed_henon_heiles,
}
KINDS = {
    "general": "rigid body, H_1 = y_1²/2, H_2 = y_2²",
    "commutative": "rigid body, H_1 = y_3²/2, H_2 = y_3 + y_3³/6: both noises rotate about the third axis",
    "one": "rigid body, a single H_1 = y_1²/2 + y_2y_3/2 + y_3",
    "additive": "Hénon and Heiles, H_1 = p_1 − q_1/2, H_2 = p_2/2 − q_2",
}


@lru_cache(maxsize=8)
def problem_of(kind: str) -> Problem:
    """The system for this kind of noise, made once."""
    return PROBLEMS[kind]()


@dataclass(frozen=True)
class Solver:
    """A solver and its documentation.

    Attributes
    ----------
    name : str
        "library name".
    documented : {kind of noise: (strong order, weak order)}
        None if the documentation names no order; kinds that the solver does not take are left out.
    source : str
        The place in the documentation.
    step : callable (kind of noise) -> step
    ito : bool
        True if the solver is documented for Itô's form.
    asks : str
        The areas that it needs, as for `Scheme`.
    path : callable (kind of noise) -> path, optional
        For a solver with a state of its own: (problem, y0, h, dW (N, m + k, M)) -> states (N + 1,
        d, M).
    """

    name: str
    documented: Mapping[str, tuple[float | None, float | None]]
    source: str
    step: Callable[[str], Step]
    ito: bool = False
    asks: str = ""
    batched: bool = True
    path: Callable[[str], Path] | None = None

    def scheme(self, kind: str) -> Scheme:
        """The solver's step as a scheme for the problem with this kind of noise;
        it claims the documented orders.
        """
        strong, weak = self.documented[kind]
        return Scheme(
            name=f"{self.name}, {kind}",
            step=self.step(kind),
            mean_square_order=strong,
            weak_order=weak,
            source=self.source,
            truncation=None,
            batched=self.batched,
            systems=Systems.HAMILTONIANS,
            asks=self.asks,
            problems=(problem_of(kind),),
        )
