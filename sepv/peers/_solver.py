"""One solver of a library for general noise: what its documentation says of it by kind of noise, and its step.

The problems are systems of several Hamiltonians, one for each kind. A solver of Itô equations is given Itô's form of
them, whose solution is the same. What a solver wants beside the increments it gets from the same rough path as the
reference: space-time Lévy areas, or the areas A_ij (`sepv.simulate._areas`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

from sepv.peers._multistep import Path
from sepv.problem import PolynomialSystem, Problem
from sepv.problems import noisy_henon_heiles, polynomial_problem, random_inertia
from sepv.problems._spins import spin_system
from sepv.record import Polynomial
from sepv.record import _polynomial as poly
from sepv.record._polynomial import Exponents
from sepv.schemes import Scheme
from sepv.schemes._scheme import Step

# One system for each kind of noise: polynomial, so that the generator knows its means, and without a symmetry by which
# an error would vanish that other systems show. Noise fields are not linear, additive noise moves p and q.
KINDS = {
    "general": "rigid body, H_1 = y_1²/2, H_2 = y_2² (`random-inertia`)",
    "commutative": "the same H_0 and B, H_1 = y_3²/2, H_2 = y_3 + y_3³/6: fields along one rotation",
    "one": "the same H_0 and B, H_1 = y_1²/2 + y_2y_3/2 + y_3",
    "additive": "Hénon and Heiles, H_1 = p_1 − q_1/2, H_2 = p_2/2 − q_2",
}


@lru_cache(maxsize=8)
def problem_of(kind: str) -> Problem:
    """The system for this kind of noise, made once."""
    if kind == "general":
        return random_inertia()
    if kind == "additive":
        data = noisy_henon_heiles().data
        others = (
            _sum(4, {(1, 0, 0, 0): 1.0, (0, 0, 1, 0): -0.5}),
            _sum(4, {(0, 1, 0, 0): 0.5, (0, 0, 0, 1): -1.0}),
        )
        assert isinstance(data, PolynomialSystem)
        pushed = replace(data, noise_hamiltonians=others, noise=(0.5, 0.5))
        return _named(pushed, (0.2, -0.1, 0.3, 0.2), "pushed-henon-heiles")
    data, start = random_inertia().data, (0.8, 0.6, 0.3)
    assert isinstance(data, PolynomialSystem)
    noises = {
        "commutative": (_sum(3, {(0, 0, 2): 0.5}), _sum(3, {(0, 0, 1): 1.0, (0, 0, 3): 1 / 6})),
        "one": (_sum(3, {(2, 0, 0): 0.5, (0, 1, 1): 0.5, (0, 0, 1): 1.0}),),
    }[kind]
    system = spin_system(1, data.hamiltonian, (0.5,) * len(noises), noises)
    return _named(system, start, {"commutative": "one-axis", "one": "one-noise"}[kind])


def _sum(dimension: int, terms: Mapping[Exponents, float]) -> Polynomial:
    return poly.polynomial(dimension, terms)


def _named(data: PolynomialSystem, start: tuple[float, ...], name: str) -> Problem:
    return replace(polynomial_problem(data), initial=start, name=name, check=False)


@dataclass(frozen=True)
class Solver:
    """A solver and its documentation.

    Attributes
    ----------
    name : str
        "library name".
    documented : {kind of noise: (strong order, weak order)}
        None where the documentation names no order; kinds that the solver does not take are left out.
    source : str
        Where that is said.
    step : callable (kind of noise) -> step
    ito : bool
        Whether it is documented for Itô's form.
    asks : str
        As of `Scheme`.
    path : callable (kind of noise) -> path, optional
        For a solver that hands state from step to step: (problem, y0, h, dW (N, m + k, M)) -> states (N + 1, d, M).
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
        """Its step as a scheme for the problem of this kind, with the orders that are documented for it."""
        strong, weak = self.documented[kind]
        return Scheme(
            name=f"{self.name}, {kind}",
            step=self.step(kind),
            mean_square_order=strong,
            weak_order=weak,
            source=self.source,
            truncation=None,
            batched=self.batched,
            systems="hamiltonians",
            asks=self.asks,
            problems=(problem_of(kind),),
        )
