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
from sepv.problem import Description, Problem

GIVEN = {
    "data": "all that is known of it",
    "functions": "Python functions, with derivatives and the degree of H",
    "bare functions": "Python functions of B, H and ∇H, without derivatives, degree or closed forms",
}
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
    functions = {"structure", "hamiltonian", "gradient", "domain"}
    functions |= {"noise_structures", "noise_hamiltonians", "noise_gradients"}
    derived = {"hessian", "structure_derivative", "mean_gradient", "flows"}
    derived |= {"noise_structure_derivatives", "noise_hessians", "noise_flows"}
    kept: dict[str, Any] = {}
    for entry in fields(problem):
        value = getattr(problem, entry.name)
        if not entry.init or entry.name in ("data", "name", "closed_form") or value is None:
            continue
        if entry.name in functions or (entry.name in derived and not bare):
            kept[entry.name] = _plain(value)
        elif entry.name == "nambu":
            kept[entry.name] = _plain_record(value, bare=bare)
        elif entry.name not in derived and not (bare and entry.name == "degree"):
            kept[entry.name] = value
    return type(problem)(**kept, name="system", check=False)


def _plain(value: Any) -> Any:
    """A Python function that does the same, for one function or a tuple of them."""
    if isinstance(value, tuple):
        return tuple(_plain(f) for f in value)
    function: Callable[..., Any] = value

    def plain(*states: Any) -> Any:
        return function(*states)

    return plain


def _plain_record(record: Any, *, bare: bool) -> Any:
    """A record of functions, each behind a plain one; bare ones lose closed forms and degree."""
    values = {f.name: getattr(record, f.name) for f in fields(record)}
    hidden = {"mean_gradient", "degree"} if bare else set()
    return replace(
        record,
        **{k: None if k in hidden else _plain(v) if callable(v) else v for k, v in values.items()},
    )
