"""Bounds of recorded functions over boxes: no value inside a box exceeds them,
and exact where nothing is lost.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from sepv.record import Tape, magnitudes
from sepv.record._functions import FUNCTIONS

# Functions of two variables with all recorded operations, on boxes inside their domains.
FORMULAS: dict[str, Callable[[Any], Any]] = {
    "sums and products": lambda y: y[0] * y[1] - 3 * y[0] + y[1] * y[1] * y[1] - 2,
    "quotient": lambda y: y[0] / (2 + y[1] * y[1]) - 1 / y[0],
    "powers": lambda y: y[0] ** 5 - y[1] ** 4 + y[0] ** -2 + y[0] ** 1.5 + y[1] ** 40,
    "waves": lambda y: np.sin(3 * y[0]) * np.cos(y[1] - y[0]),
    "exponentials": lambda y: np.exp(-y[0]) * np.log(1 + y[0] * y[0]) + np.sqrt(y[0]) * np.sinh(y[1]),
    "choices": lambda y: np.where(y[1] > 0, y[0], -2 * y[1]) + abs(y[1]) + np.maximum(y[0], y[1] + 1),
    "conditions": lambda y: np.where(~((y[0] >= 1) & (y[1] > 0)) | (y[1] == y[0]), np.tanh(y[1]), np.arctan(y[0])),
}  # fmt: skip


def bound(function: Callable[[Any], Any], low: np.ndarray, high: np.ndarray) -> np.ndarray:
    tape = Tape()
    y = tape.vector(len(low))
    return magnitudes([tape.symbol(function(y))], y, low, high)[0]


@pytest.mark.parametrize("name", FORMULAS)
def test_no_value_inside_the_box_exceeds_the_bound(name: str) -> None:
    """The boxes of a batch are bounded as each alone is,
    and small boxes by little more than the largest value.
    """
    rng, function = np.random.default_rng(5), FORMULAS[name]
    centres = np.stack([rng.uniform(0.5, 2, 40), rng.uniform(-1.5, 1.5, 40)])
    for width in (0.4, 1e-3):
        low, high = centres - width * rng.random(centres.shape), centres + width * rng.random(centres.shape)
        found = bound(function, low, high)
        inside = low + (high - low) * np.moveaxis(rng.random((200, 40, 2)), 2, 1)[:, :, :]
        largest = np.max([np.abs(function(y)) for y in inside], axis=0)
        assert np.all(largest <= found * (1 + 1e-14))
        assert np.all(np.isfinite(found))
        for k in range(5):
            assert bound(function, low[:, k], high[:, k]) == found[k]
    if name != "conditions":  # a jump is inside some boxes
        assert np.all(found - largest <= 1 + 0.5 * largest)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_each_elementary_function_is_bounded_on_intervals_of_every_length(name: str) -> None:
    rng, value = np.random.default_rng(1), FUNCTIONS[name].value
    least = {"log": 0.01, "sqrt": 0.0, "log1p": -0.9, "log1p_ratio": -0.9, "log1p_ratio_slope": -0.9}.get(
        name, -4.0
    )
    ends = np.sort(rng.uniform(least, 4.0, (2, 300)), axis=0)
    ends[1, :100] = ends[0, :100] + 1e-3 * (ends[1, :100] - ends[0, :100])
    found = bound(lambda y: y[0].apply(name), ends[:1], ends[1:])
    for share in np.linspace(0, 1, 65):
        assert np.all(np.abs(value(ends[0] + share * (ends[1] - ends[0]))) <= found * (1 + 1e-13))


def test_bounds_are_attained_where_each_variable_occurs_once() -> None:
    box = np.array([-2.0, 1.0]), np.array([1.0, 3.0])
    for function, exact in (
        (lambda y: y[0] * y[0] + y[1], 7.0),
        (lambda y: y[0] * y[1], 6.0),
        (lambda y: 1 / (y[0] * y[0] + y[1]), 1.0),  # a square is not negative
        (lambda y: np.cos(y[0]) + y[1], 4.0),
        (lambda y: y[1] ** -3.0 + y[0] ** 4, 17.0),
        (lambda y: np.cosh(y[0]), np.cosh(2.0)),
    ):
        assert bound(function, *box) == pytest.approx(exact, rel=1e-15, abs=0)


def test_outside_the_domain_there_is_no_bound() -> None:
    box = np.array([-2.0, 1.0]), np.array([1.0, 3.0])
    for function in (
        lambda y: 1 / y[0], lambda y: np.log(y[0]), lambda y: y[0] ** 0.5, lambda y: y[0] ** -2.0,
        lambda y: np.tan(y[1]), lambda y: 0 * y[1] + 1 / (y[0] - y[0] * y[1]),
    ):  # fmt: skip
        assert bound(function, *box) == np.inf


def test_intervals_that_touch_may_hold_equal_numbers() -> None:
    """y1 ∈ [0, 1] and y2 ∈ [1, 2] are equal at 1, where the chosen value is 5, and else 1."""
    low, high = np.array([0.0, 1.0]), np.array([1.0, 2.0])
    for first, second in ((0, 1), (1, 0)):
        found = bound(lambda y, a=first, b=second: np.where(y[a] == y[b], 5.0 + 0 * y[0], 1.0), low, high)  # type: ignore[misc]
        assert found == 5.0
