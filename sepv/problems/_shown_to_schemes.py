"""A problem as the scheme sees it: with its data, as functions, or as bare functions that say nothing of themselves.

A scheme must not be able to tell the suite's problems from a user's. Laws keep the whole problem, for their bounds
and references; `shown` is what a step is given of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from functools import lru_cache
from typing import Any
from weakref import WeakKeyDictionary

from sepv import problems
from sepv.problem import Description, Nambu, Problem

GIVEN = {
    "data": "all that is known of it",
    "functions": "Python functions, with derivatives and the degree of H",
    "bare functions": "Python functions of B, H and ∇H, without derivatives, degree or closed forms",
}
# What no view has, and what bare functions are without.
_NEVER = {"data", "name", "closed_form"}
_DERIVED = {
    "hessian", "structure_derivative", "mean_gradient", "degree", "flows",
    "noise_structure_derivatives", "noise_hessians", "noise_flows",
}  # fmt: skip
_DERIVED_OF_CASIMIR = {"mean_gradient", "degree"}
# What a problem is shown as; those that are shown as they are have no entry.
_VIEWS: WeakKeyDictionary[Problem, Problem] = WeakKeyDictionary()


def shown(problem: Problem) -> Problem:
    """What a scheme is given of a problem."""
    return _VIEWS.get(problem, problem)


@lru_cache(maxsize=1024)
def as_given(data: Description, given: str) -> Problem:
    """The problem that a description means, which `shown` shows in the given way."""
    whole = problems.build(data)
    if given == "data":
        return whole
    # A copy of its own: one description may be given in several ways at once.
    problem = replace(whole, check=False)
    _VIEWS[problem] = _view(whole, bare=given == "bare functions")
    return problem


def _view(problem: Problem, *, bare: bool) -> Problem:
    """The same functions behind plain ones, under another name."""
    hidden = _NEVER | _DERIVED if bare else _NEVER
    names = [f.name for f in fields(problem) if f.init and f.name not in hidden]
    shown = {name: _plain(getattr(problem, name), bare) for name in names}
    return type(problem)(**shown, name="system", check=False)


def _plain(value: Any, bare: bool) -> Any:
    """A Python function that does the same; of a tuple or a record each function so; anything else as it is."""
    if isinstance(value, tuple):
        return tuple(_plain(v, bare) for v in value)
    if isinstance(value, Nambu):
        parts = {k: None if bare and k in _DERIVED_OF_CASIMIR else v for k, v in vars(value).items()}
        return replace(value, **{k: _plain(v, bare) for k, v in parts.items()})
    return _behind(value) if callable(value) else value


def _behind(function: Callable[..., Any]) -> Callable[..., Any]:
    def plain(*states: Any) -> Any:
        return function(*states)

    return plain
