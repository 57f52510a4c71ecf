"""The problems, states and cases with which laws may call a scheme that is not for every system of
its class.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from sepv.errors import Skipped
from sepv.law.cases.case import Case, quiet, quiet_problem
from sepv.law.cases.users_problems import sources
from sepv.law.units import Units, units_of
from sepv.problem import Array, Problem, one_field
from sepv.schemes import Scheme

NO_START = "the problems have no initial state: name one that has, or give initial= when making it"


def may_ask(scheme: Any, problem: Problem, states: Array) -> bool:
    """True if a law may call a scheme at `states` (d, ...) that the law made,
    for example near a drawn state.

    If the problem has a domain, the states must lie in it. Otherwise every state is allowed, unless
    a user named the problems: a user's problem may be meant for positive states or for a ball, so
    only drawn states are surely valid.
    """
    if problem.domain is not None:
        return bool(np.all(problem.domain(states)))
    return not scheme.problems


def problems_of(scheme: Any) -> tuple[Problem, ...] | None:
    """The scheme's problems with an initial state, for laws about many steps;
    None if the scheme is for a wide class.

    A problem that is named and also belongs to a named family is listed once, because a name always
    gives the same object. A scheme without noise gets the problems of (1.1) with c = ().

    Raises Skipped if none of the problems has an initial state.
    """
    own = sources(scheme)
    if not own:
        return None
    found = {id(problem): problem for item in own for problem in item.problems}
    if not found:
        raise Skipped(NO_START)
    return as_taken(scheme, found.values())


def as_taken(scheme: Any, listed: Iterable[Problem]) -> tuple[Problem, ...]:
    """The problems as the scheme accepts them: without noise, c = (),
    if the scheme is only for systems without noise.

    Raises Skipped if a scheme without noise gets only problems whose noises have other vector
    fields than B∇H.
    """
    found = tuple(listed)
    if not scheme.deterministic:
        return found
    if single := tuple(quiet_problem(problem) for problem in found if one_field(problem)):
        return single
    raise Skipped("the scheme is for c = (), and each noise of the problems has a field of its own")


def taken_by(scheme: Scheme, cases: Iterable[Case]) -> Iterator[Case]:
    """The cases as a scheme accepts them. If it is only for c = (),
    `quiet` removes their noise or omits them.
    """
    for case in cases:
        taken = quiet(case) if scheme.deterministic else case
        if taken is not None:
            yield taken


def units_for(scheme: Scheme, problem: Problem) -> Units:
    """The units of a problem that a user named, or units 1 for one of the suite's own problems."""
    return units_of(problem) if scheme.problems else Units()
