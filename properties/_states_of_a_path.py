"""The contract of schemes that carry a state from step to step:
no call may change a state that exists already.

Such a scheme is a `sepv.schemes._stateful.StatefulStep` with the functions init, step and value.
The state of a path at y may differ from init(y), as in the reversible Heun method, so a path is
never compared with a path begun at y. Instead the path is computed twice, once with steps of
another path in between, and the bits of both are compared.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sepv.errors import SchemeFault, UsageError
from sepv.problem import Array, Problem
from sepv.problems.shown_to_schemes import shown
from sepv.schemes import Scheme, StatefulStep, check_answer, lanes, require_unchanged, translated
from sepv.schemes import answer_of as answer


def keeps_states(scheme: Scheme, problem: Problem, y: Array, h: float, dW: Array, apart: float) -> None:
    """Make two steps from y (d,) or (d, M), alone and between steps of a second path,
    and compare the bits.

    value(init(y)) may differ from y by `apart` times |y|_∞, because a state may use other
    coordinates. A part of a batch may differ by as much if it is stepped alone. If the scheme has
    no `StatefulStep`, nothing is compared.

    Raises
    ------
    SchemeFault
        If a step changes the state that it gets or another path's state, or if value(init(y))
        differs from y.
    """
    rule = scheme.step
    if not isinstance(rule, StatefulStep):
        return
    path = _Path(scheme, rule, problem, h, dW)
    begun = path.begin(y)
    start = path.read(begun, y)
    if np.any(np.abs(start - y) > apart * np.max(np.abs(y))):
        _fault(
            "value(init(problem, y)) equal to y",
            start,
            y,
            "let value read from the state what init put there",
        )
    _same("one state for one y", start, path.read(path.begin(y), y), _REMEMBERS_EARLIER)
    first = path.step(begun, y)
    y1 = path.read(first, y)
    _same("a state that step leaves as it is", start, path.read(begun, y))
    y2 = path.read(path.step(first, y), y)
    _same("a state that step leaves as it is", y1, path.read(first, y))
    beside = path.step(path.begin(y1), y1)
    _same("paths that share nothing", y2, path.read(path.step(first, y), y))
    path.step(beside, y1)
    again = path.step(path.begin(y), y)
    _same("one path for the same increments", y2, path.read(path.step(again, y), y), _REMEMBERS_EARLIER)
    if y.ndim == 2:
        part = list(range(0, y.shape[1], 2))
        fewer = _Path(scheme, rule, problem, h, dW[:, part])
        try:
            chosen = lanes(first, part)
        except (UsageError, IndexError) as error:
            raise SchemeFault(
                expected="a batch's state of arrays with the paths on the last axis",
                received=str(error),
                remedy=_PATHS_APART,
            ) from error
        left = fewer.read(fewer.step(chosen, y[:, part]), y[:, part])
        if np.any(np.abs(left - y2[:, part]) > apart * np.max(np.abs(y2))):
            _fault("paths that go on without others as in a batch", left, y2[:, part], _PATHS_APART)


_PATHS_APART = "give every array of the state the paths on its last axis, or leave out batched=True"


class _Path:
    """Calls of a scheme's init, step and value, with checks.
    Messages about errors name their argument y.
    """

    def __init__(self, scheme: Scheme, rule: StatefulStep, problem: Problem, h: float, dW: Array) -> None:
        self.scheme, self.rule, self.problem, self.h, self.dW = scheme, rule, problem, h, dW

    def begin(self, y: Array) -> Any:
        given = y.copy()
        with translated(self.problem, y, self.h, self.dW):
            state = self.rule.begin(shown(self.problem, self.scheme.needs), given, self.h)
        require_unchanged(y=(y, given))
        return state

    def step(self, state: Any, y: Array) -> Any:
        noise = self.dW.copy()
        with translated(self.problem, y, self.h, self.dW):
            after = answer(
                self.scheme,
                shown(self.problem, self.scheme.needs),
                state,
                self.h,
                noise,
                any_path=True,
                step=self.rule.step,
            )
        require_unchanged(dW=(self.dW, noise))
        return after

    def read(self, state: Any, y: Array) -> Array:
        """Return a copy of value(state), the y (d,) or (d, M)
        that belongs to the scheme's own `state`.
        """
        with translated(self.problem, y, self.h, self.dW):
            value = self.rule.value(state)
        return check_answer(value, y, self.scheme.dtype).copy()


_OWN_STATE = "make a new state in each step; keep nothing of a path outside of its state"
_REMEMBERS_EARLIER = (
    "begin each path anew: init or the scheme remembers an earlier run (a counter, a flag, kept forces)"
)


def _same(expected: str, before: Array, after: Array, remedy: str = _OWN_STATE) -> None:
    if not np.array_equal(before, after):
        _fault(expected, after, before, remedy)


def _fault(expected: str, after: Array, before: Array, remedy: str) -> None:
    raise SchemeFault(
        expected=expected, received=f"{after.tolist()}, and {before.tolist()} before", remedy=remedy
    )
