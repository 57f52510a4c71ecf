"""A step that carries more than y along a path, such as a stored force,
a cached gradient or a second copy of y.

Along a path each step gets the state of the step before (`sepv.schemes.carry`). Laws about a step
are measured on the first step of a path, y1 = value(step(init(y0))), and on steps in the middle of
one (`sepv.law.middle`).
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from operator import itemgetter
from typing import Any

import numpy as np

from sepv.errors import Skipped, UsageError
from sepv.problem import Array, Problem

# A scheme refuses a step by raising one of these exceptions; `sepv.StepFailure` is an
# ArithmeticError.
REFUSAL_ERRORS = (ArithmeticError, np.linalg.LinAlgError)


@dataclass(frozen=True)
class StatefulStep:
    """A step on states, from which y can be read:
    ``Scheme(name, StatefulStep(init, step, value))``.

    Attributes
    ----------
    init : callable (problem, y) -> state, or (problem, y, h) -> state
        The state at the beginning of a path at y, of shape (d,). A function with a third argument
        gets the step size.
    step : callable (problem, state, h, dW) -> state
        The state after one step. The function changes nothing in place, not even the given state.
    value : callable (state) -> y
        The y of a state, of shape (d,).
    reverse : callable (state) -> state, or (state, rho) -> state, optional
        The state at the same y from which steps with −h and −ΔW go back along the path. A function
        with two arguments also gets rho (d,), the signs of y if momenta are reversed, or None. With
        rho, steps with h and ΔW go back, and the y of the reversed state is rho·y. A function of
        the state alone may serve either way. The laws *symmetry* and *reversibility* need it,
        unless y alone determines the path, as with a stored force.

    A state may be any object. For a scheme with `batched` it is an array, or a tuple, list or dict
    of arrays, each with the paths on its last axis. A number in it is the same for all paths.

    Examples
    --------
    Leapfrog that keeps its force, for H = ½p² + V(q) and y = (q, p):

    >>> import numpy as np, sepv
    >>> def force(problem, q):
    ...     return -problem.gradient(np.array([q, 0.0]))[0]
    >>> def init(problem, y):
    ...     return y[0], y[1], force(problem, y[0])
    >>> def step(problem, state, h, dW):
    ...     (q, p, f), delta = state, problem.random_step(h, dW)
    ...     half = p + delta / 2 * f
    ...     q1 = q + delta * half
    ...     f1 = force(problem, q1)
    ...     return q1, half + delta / 2 * f1, f1
    >>> stateful = sepv.StatefulStep(init, step, lambda state: np.array(state[:2]))
    >>> leapfrog = sepv.Scheme("kept-force", stateful)
    >>> sepv.integrate(leapfrog, "pendulum", h=0.125, T=1.0).y.shape
    (2, 9)
    """

    init: Callable[..., Any]
    step: Callable[..., Any]
    value: Callable[[Any], Array]
    reverse: Callable[..., Any] | None = None

    def __post_init__(self) -> None:
        for name, function in vars(self).items():
            if not callable(function) and not (name == "reverse" and function is None):
                raise UsageError(
                    expected=f"StatefulStep(init, step, value), {name} a function",
                    received=f"{type(function).__name__}: {function!r:.80}",
                    remedy="init(problem, y) -> state, step(problem, state, h, dW) -> state, value(state) -> y, and "
                    "optionally reverse(state) -> state",
                )

    def __call__(self, problem: Problem, y: Array, h: float, dW: Array, *further: Array) -> Array:
        """y1 of the first step of a path from y."""
        return self.value(self.step(problem, self.begin(problem, y, h), h, dW, *further))

    def begin(self, problem: Problem, y: Array, h: float) -> Any:
        """The state at the beginning of a path at y with steps of size h."""
        return self.init(problem, y, h) if _takes(self.init, 3, "h") else self.init(problem, y)

    def turned(self, state: Any, rho: Array | None = None) -> Any:
        """The state that leads back along the path, as described for `reverse`,
        which must be given.
        """
        assert self.reverse is not None
        return self.reverse(state, rho) if _takes(self.reverse, 2, "rho") else self.reverse(state)


def _takes(function: Callable[..., Any], count: int, name: str) -> bool:
    """True if a function takes `count` arguments by position,
    the last of them required or called `name`.
    """
    try:
        parameters = list(inspect.signature(function).parameters.values())
    except (TypeError, ValueError):  # a function written in C may have no signature
        return False
    by_position = [p for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    if len(by_position) < count:
        return False
    last = by_position[count - 1]
    return last.default is last.empty or last.name == name


class PathSolver(StatefulStep):
    """A step made from a solver of whole paths, such as a multistep method:
    ``Scheme(name, PathSolver(path))``.

    `path(problem, y0, h, dW)` takes y0 (d,) and the increments dW (N, m, M) of M paths, and returns
    their states (N + 1, d, M). It is called with M = 1. The laws of orders compute each path once.
    Other laws make steps: the state of a path is y0 with the increments so far, and each step
    computes the path anew from y0. So N steps with noise cost N(N + 1)/2 steps of the solver.
    """

    path: Callable[[Problem, Array, float, Array], Array]

    def __init__(self, path: Callable[[Problem, Array, float, Array], Array]) -> None:
        super().__init__(_begun, partial(_from_the_start, path), itemgetter("y"))
        object.__setattr__(self, "path", path)

    def states(self, problem: Problem, y0: Array, h: float, dW: Array) -> Array:
        """The states (N + 1, d) of one path with the increments dW (N, m).

        They are NaN from the first step that the solver refuses by an exception of
        `REFUSAL_ERRORS`.
        """
        states = np.full((len(dW) + 1, y0.size), np.nan)
        states[0] = y0
        for n in range(len(dW), 0, -1):  # the longest beginning of the path that the solver takes
            with suppress(*REFUSAL_ERRORS):
                states[: n + 1] = whole(self.path, problem, y0, h, dW[:n])
                break
        return states


def _begun(_problem: Problem, y: Array) -> dict[str, Any]:
    return {"y0": y.copy(), "h": None, "increments": (), "states": y.copy()[None], "y": y.copy()}


def _from_the_start(
    path: Callable[..., Array], problem: Problem, state: dict[str, Any], h: float, dW: Array
) -> dict[str, Any]:
    y0, states, increments = state["y0"], state["states"], (*state["increments"], dW.copy())
    if state["h"] not in (None, h):
        raise Skipped("a solver of whole paths has one step size a path")
    n = len(increments)
    if n >= len(states):
        # Without noise the increments to come are known (empty), and the path is computed to twice
        # its length at once.
        states = whole(path, problem, y0, h, np.array([*increments, *([] if dW.size else increments)]))
    return {"y0": y0, "h": h, "increments": increments, "states": states, "y": states[n].copy()}


def whole(path: Callable[..., Array], problem: Problem, y0: Array, h: float, dW: Array) -> Array:
    """The states (N + 1, d) that `path` returns for increments (N, m).
    Raises UsageError for any other shape.
    """
    answer, wanted = path(problem, y0.copy(), h, dW[:, :, None].copy()), (len(dW) + 1, y0.size, 1)
    if np.shape(answer) != wanted:
        raise UsageError(
            expected=f"PathSolver(path), path returning states (N + 1, d, M) = {wanted}",
            received=f"{type(answer).__name__} of shape {np.shape(answer)}",
            remedy="the first axis has the times, y0 among them, and the last axis the paths",
        )
    return np.array(answer)[:, :, 0]


def lanes(state: Any, index: Any) -> Any:
    """The state of some paths of a batch, chosen by a list of their numbers or a mask.

    Raises UsageError for a state with parts other than numbers and arrays.
    """
    return _mapped(lambda a: a if np.ndim(a) == 0 else a[..., index], state)


def joined_lanes(states: list[Any]) -> Any:
    """The state of a batch from the states of its parts, joined along the axis of paths."""
    return _mapped(lambda a, *more: a if np.ndim(a) == 0 else np.concatenate([a, *more], axis=-1), *states)


def _mapped(function: Callable[..., Any], *trees: Any) -> Any:
    """Apply a function to the arrays at the same place of several nested tuples, lists or dicts;
    None stays None.
    """
    first = trees[0]
    if first is None or hasattr(first, "shape") or isinstance(first, (bool, int, float)):
        return first if first is None else function(*trees)
    if isinstance(first, dict):
        return {key: _mapped(function, *(tree[key] for tree in trees)) for key in first}
    if isinstance(first, (tuple, list)):
        parts = [_mapped(function, *part) for part in zip(*trees, strict=True)]
        return type(first)(*parts) if hasattr(first, "_fields") else type(first)(parts)
    raise UsageError(
        expected="a batch's state made of arrays, with the paths on the last axis, in tuples, lists and dicts",
        received=f"{type(first).__name__}: {first!r:.80}",
        remedy="leave out batched=True: then each path has its own state, which may be any object",
    )
