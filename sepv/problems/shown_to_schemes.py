"""Views of problems, which hide from a scheme what a user's problem might lack: data, derivatives,
the degree of H.

A scheme must not be able to distinguish sepv's own problems from a user's. Its steps therefore get
the view `shown(problem)`, while the tests of a scheme use the whole problem for their bounds and
references.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import fields, replace
from functools import lru_cache
from typing import Any
from weakref import WeakKeyDictionary

from sepv import problems
from sepv.errors import Skipped
from sepv.problem import Description, Nambu, Problem

# Kinds of views, with the words by which reports describe them.
WORDS_OF_VIEWS = {
    "data": "all that is known of it",
    "functions": "Python functions, with derivatives and the degree of H",
    "bare functions": "Python functions of B, H and ∇H, without derivatives, degree or closed forms",
}
# The attributes that a scheme may need (`Scheme.needs`).
NEEDABLE = ("hessian", "structure_derivative", "mean_gradient")
# The attributes of a problem that every view lacks, and those that the view "bare functions" lacks
# in addition.
_NEVER_SHOWN = {"data", "name", "closed_form"}
_DERIVED_ATTRIBUTES = {
    "hessian", "structure_derivative", "mean_gradient", "degree", "flows",
    "noise_structure_derivatives", "noise_hessians", "noise_flows",
}  # fmt: skip
_DERIVED_OF_CASIMIR = {"mean_gradient", "degree"}
# The view of each problem for schemes. A problem without an entry is shown unchanged.
_VIEWS: WeakKeyDictionary[Problem, Problem] = WeakKeyDictionary()


def shown(problem: Problem, needs: Iterable[str] = ()) -> Problem:
    """The view of a problem for schemes: the whole problem,
    or functions with or without derivatives (`WORDS_OF_VIEWS`).

    `needs` names attributes that the scheme cannot do without (`Scheme.needs`); a view that hides
    them gets them.

    Raises
    ------
    Skipped
        If the whole problem lacks one of them too: the scheme is not for this problem.
    """
    view = _VIEWS.get(problem, problem)
    needed = [name for name in needs if getattr(view, name, None) is None]
    return _with_needed(problem, view, tuple(needed)) if needed else view


@lru_cache(maxsize=1024)
def _with_needed(problem: Problem, view: Problem, needed: tuple[str, ...]) -> Problem:
    if lacking := [name for name in needed if getattr(problem, name, None) is None]:
        raise Skipped(f"the problem has no {', '.join(lacking)}, which the scheme needs")
    return replace(view, **{name: _plain(getattr(problem, name), True) for name in needed}, check=False)


@lru_cache(maxsize=1024)
def as_given(data: Description, given: str) -> Problem:
    """The problem that `data` describe, for which `shown` returns the view `given`,
    a key of `WORDS_OF_VIEWS`.
    """
    whole = problems.build(data)
    if given == "data":
        return whole
    # The problem is copied, because the same description may be shown in several views at once.
    problem = replace(whole, check=False)
    _VIEWS[problem] = _view(whole, bare=given == "bare functions")
    return problem


def _view(problem: Problem, *, bare: bool) -> Problem:
    """The problem named "system", with plain functions as parts;
    `bare` also removes derivatives and closed forms.
    """
    hidden = _NEVER_SHOWN | _DERIVED_ATTRIBUTES if bare else _NEVER_SHOWN
    names = [f.name for f in fields(problem) if f.init and f.name not in hidden]
    shown = {name: _plain(getattr(problem, name), bare) for name in names}
    return type(problem)(**shown, name="system", check=False)


def _plain(value: Any, bare: bool) -> Any:
    """A function in a wrapper that hides its attributes; for a tuple or `Nambu`,
    its functions in such wrappers.
    """
    if isinstance(value, tuple):
        return tuple(_plain(v, bare) for v in value)
    if isinstance(value, Nambu):
        parts = {k: None if bare and k in _DERIVED_OF_CASIMIR else v for k, v in vars(value).items()}
        return replace(value, **{k: _plain(v, bare) for k, v in parts.items()})
    return _without_attributes(value) if callable(value) else value


def _without_attributes(function: Callable[..., Any]) -> Callable[..., Any]:
    def plain(*states: Any) -> Any:
        return function(*states)

    return plain
