"""The problems, end times and numbers of steps for laws about sampled paths."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from sepv.properties._orders.local_errors import three_inertias, two_noises
from sepv.properties._problems_of import problems_of
from sepv.properties._sampled import sparing

from sepv import problems
from sepv.law import Effort
from sepv.law.units import units_of
from sepv.problem import NamedProblem, Problem, Systems, one_hamiltonian, same_structure
from sepv.schemes import Scheme, order_of

# The claimed order from which on the mean square error depends on increments too rare for plain
# sampling.
TILTED_ORDER = 1.5
# Pairs (p, numbers of steps) for claimed orders of p or more. At such orders finer steps have
# errors of rounding size.
FEW_STEPS_AT_ORDER = ((6, (8, 12, 16)), (5, (8, 16, 32)))
# Problems with several structures without a closed form. In the first the noises commute, but not
# with the drift, in the second not even the noises. Increments alone allow the orders 1 and ½ (§1):
# commutators of the drift and a noise are multiplied by ∫W∘dt, of the order of h^(3/2), those of
# noises by ∫W_i∘dW_j, of the order of h.
NONCOMMUTING = ("noncommuting-drift", "noncommuting-tops")


@dataclass(frozen=True)
class Setup:
    """A problem, an end time T, and increasing numbers of steps over [0, T]."""

    problem: str
    T: float
    steps: tuple[int, ...]
    given: Problem | None = None
    unit: float = 1.0  # the unit of time, for A_h of Remark 2.1

    def build(self) -> Problem:
        """Return the given problem, or build the problem of this name."""
        return problems.by_name(self.problem) if self.given is None else self.given


def setups(
    systems: Systems = Systems.SINGLE, truncation: int | None = 2, order: float | None = None
) -> tuple[Setup, ...]:
    """Return the problems, end times and numbers of steps on which schemes for a class of systems
    are judged.

    For (1.1) one problem has a non-constant B and one noise, the other problem a non-quadratic H
    and two noises. All their large steps have solutions. If increments are not truncated or
    `sepv.properties._orders.tilting` draws them, the coarsest step is halved, because a random step
    may then be more than 1, far from any asymptotics.
    """
    names = {
        Systems.NAMBU: ("rigid-body", "lotka-volterra"),
        Systems.SEVERAL: ("commuting-rotations", "commuting-oscillators"),
        Systems.HAMILTONIANS: ("random-inertia", "kubo-oscillator"),
    }.get(systems, ("rigid-body", "pendulum"))
    return tuple(_setup(name, truncation, order) for name in names)


def _setup(name: str, truncation: int | None, order: float | None) -> Setup:
    if name == "lotka-volterra":  # step sizes at which all steps have solutions
        return Setup(name, 0.25, (32, 64, 128))
    if name == "kubo-oscillator":  # schemes for several Hamiltonians need their gradients
        return replace(_setup("", truncation, order), problem=name, given=problems.kubo_by_hamiltonians())
    if name == "random-inertia":  # T is so long that means exceed the noise of paths of a scheme of order ½
        return Setup(name, 1.0, (4, 16, 64), given=three_inertias())
    if order is not None and order >= TILTED_ORDER:
        return Setup(
            name, 0.5, next((steps for least, steps in FEW_STEPS_AT_ORDER if order >= least), (8, 16, 64))
        )
    return Setup(name, 0.5, (8, 16, 64) if truncation is None else (4, 16, 64))


def setups_for(scheme: Scheme, effort: Effort | None = None) -> tuple[Setup, ...]:
    """Return the setups for a scheme: for its class and claims, or for the user's problems.

    For class (1.1) a third problem has B(y), a quartic H and two noises. A run that must spare
    steps uses only this. For several Hamiltonians a third problem has two noises that commute, if
    the order claimed for such noises differs.
    """
    facts = (scheme.truncation, scheme.mean_square_order)
    users = problems_of(scheme)
    if users is not None:
        return tuple(_given(p, *facts) for p in users)
    usual = setups(scheme.systems, *facts)
    if one_hamiltonian not in scheme.systems.facts and _differs(scheme.mean_square_order):
        return *usual, _setup("commuting-twists", *facts)
    if scheme.systems != Systems.SINGLE:
        return usual
    top = two_noises()
    both = replace(_setup(top.name, *facts), given=top)
    return (both,) if effort and sparing(scheme, effort) else (*usual, both)


def noncommuting(scheme: Scheme) -> tuple[Setup, ...]:
    """The setups of NONCOMMUTING, for a scheme for several structures whose user states no
    problems.

    They are left out for a claim above 1, which is about problems in which all flows commute.
    """
    several = same_structure not in scheme.systems.facts and problems_of(scheme) is None
    if not several or order_of(scheme.mean_square_order, "commutative") > 1:
        return ()
    facts = (scheme.truncation, scheme.mean_square_order)
    return tuple(_setup(name, *facts) for name in NONCOMMUTING)


def _differs(order: float | None) -> bool:
    """True if the claim `order` states different orders for two commuting noises and for noises in
    general.
    """
    return order is not None and order_of(order, "commutative") != order_of(order, "general")


def _given(problem: Problem, truncation: int | None, order: float | None) -> Setup:
    """Return a user's problem's setup: that of an equal built-in problem, if any,
    or one with T in its unit of time.
    """
    if problem.data in [known.data for known in map(problems.by_name, problems.PAPER)]:
        assert isinstance(problem.data, NamedProblem)
        return replace(_setup(problem.data.name, truncation, order), given=problem)
    if problem.name in problems.HAMILTONIANS and _built_in(problem):
        return replace(_setup(problem.name, truncation, order), given=problem)
    usual, time = _setup("", truncation, order), units_of(problem).time
    return replace(usual, problem=problem.name, T=usual.T * time / 2, unit=time, given=problem)


def _built_in(problem: Problem) -> bool:
    """True if a problem has the dimension, noise and initial state of the built-in problem of the
    same name.
    """
    known = problems.by_name(problem.name)
    return problem.dimension == known.dimension and all(
        np.array_equal(getattr(problem, key), getattr(known, key)) for key in ("c", "initial")
    )
