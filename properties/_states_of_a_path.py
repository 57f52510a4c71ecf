"""The contract of a `sepv.schemes._stateful.StatefulStep`: its states are values, which nothing changes later.

A state that a path has reached may differ from a new one at the same y, as that of reversible Heun does: a path is
never compared with one that begins anew. It is compared with itself, asked again while another path is walked.
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
    """Walk two steps from y (d,) or (d, M), once alone and once with a path from y1 in turn, and compare the bits.

    `apart` is the share by which value(init(y)) may differ from y, for states in other coordinates, and a batch from
    its part. Steps without a `StatefulStep` have nothing to compare.

    Raises
    ------
    SchemeFault
        For a state that changed when it was stepped or when another path was, or that begins elsewhere than at y.
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
    _same("one state for one y", start, path.read(path.begin(y), y))
    first = path.step(begun, y)
    y1 = path.read(first, y)
    _same("a state that step leaves as it is", start, path.read(begun, y))
    y2 = path.read(path.step(first, y), y)
    _same("a state that step leaves as it is", y1, path.read(first, y))
    beside = path.step(path.begin(y1), y1)
    _same("paths that share nothing", y2, path.read(path.step(first, y), y))
    path.step(beside, y1)
    again = path.step(path.begin(y), y)
    _same("one path for the same increments", y2, path.read(path.step(again, y), y))
    if y.ndim == 2:
        part = list(range(0, y.shape[1], 2))
        fewer = _Path(scheme, rule, problem, h, dW[:, part])
        try:
            chosen = lanes(first, part)
        except (UsageError, IndexError) as error:
            raise SchemeFault(
                expected="a batch's state of arrays with the paths on the last axis",
                received=str(error),
                remedy=_APART,
            ) from error
        left = fewer.read(fewer.step(chosen, y[:, part]), y[:, part])
        if np.any(np.abs(left - y2[:, part]) > apart * np.max(np.abs(y2))):
            _fault("paths that go on without others as in a batch", left, y2[:, part], _APART)


_APART = "give every array of the state the paths on its last axis, or leave out batched=True"


class _Path:
    """Guarded calls of the three functions; y names the path in messages."""

    def __init__(self, scheme: Scheme, rule: StatefulStep, problem: Problem, h: float, dW: Array) -> None:
        self.scheme, self.rule, self.problem, self.h, self.dW = scheme, rule, problem, h, dW

    def begin(self, y: Array) -> Any:
        given = y.copy()
        with translated(self.problem, y, self.h, self.dW):
            state = self.rule.init(shown(self.problem), given)
        require_unchanged(y=(y, given))
        return state

    def step(self, state: Any, y: Array) -> Any:
        noise = self.dW.copy()
        with translated(self.problem, y, self.h, self.dW):
            after = answer(
                self.scheme, shown(self.problem), state, self.h, noise, any_path=True, step=self.rule.step
            )
        require_unchanged(dW=(self.dW, noise))
        return after

    def read(self, state: Any, y: Array) -> Array:
        """A copy of value(state)."""
        with translated(self.problem, y, self.h, self.dW):
            value = self.rule.value(state)
        return check_answer(value, y, self.scheme.dtype).copy()


def _same(expected: str, before: Array, after: Array) -> None:
    if not np.array_equal(before, after):
        _fault(
            expected,
            after,
            before,
            "make a new state in each step; keep nothing of a path outside of its state",
        )


def _fault(expected: str, after: Array, before: Array, remedy: str) -> None:
    raise SchemeFault(
        expected=expected, received=f"{after.tolist()}, and {before.tolist()} before", remedy=remedy
    )
