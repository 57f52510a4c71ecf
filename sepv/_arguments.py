"""Arguments that are numbers, as arrays of float64: text, complex numbers and ragged lists are refused."""

from __future__ import annotations

import math
from collections.abc import Iterable
from difflib import get_close_matches
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sepv.errors import UsageError


def floats(what: str, value: Any) -> NDArray[np.float64]:
    """The value as an array of binary64 numbers, finite or not; a UsageError for what is not real numbers."""
    try:
        if np.iscomplexobj(value):
            raise TypeError("complex numbers")
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise UsageError(
            expected=f"{what}: real numbers",
            received=f"{value!r:.80} ({error})",
            remedy="give a number, a NumPy array of numbers, or lists of them of equal length",
        ) from error


def is_number(value: Any) -> bool:
    """Whether this is one finite real number."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    return isinstance(value, (int, float, np.integer, np.floating)) and math.isfinite(value)


def require_whole(what: str, value: Any, remedy: str, low: int = 1, high: int | None = None) -> int:
    """The value as an int; a UsageError for what is not an integer within these bounds."""
    whole = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not whole or value < low or (high is not None and value > high):
        bounds = f"≥ {low}" if high is None else f"from {low} to {high}"
        raise UsageError(expected=f"{what}, an integer {bounds}", received=repr(value), remedy=remedy)
    return int(value)


def require_flag(what: str, value: Any) -> None:
    """Refuse anything but True and False, by a UsageError: a word such as "no" would count as true."""
    if not isinstance(value, (bool, np.bool_)):
        raise UsageError(
            expected=f"{what}, True or False", received=repr(value), remedy=f"{what}=True or {what}=False"
        )


def optional(module: str, expected: str, remedy: str, kind: type[UsageError] = UsageError) -> Any:
    """A module that need not be installed, or an error that says what it is needed for."""
    try:
        return import_module(module)
    except ImportError as error:
        raise kind(expected=expected, received=f"{error}", remedy=remedy) from error


def did_you_mean(word: Any, known: Iterable[str]) -> str:
    """The word as it came, and the known one it is closest to, if any is close."""
    near = get_close_matches(str(word).replace("_", "-").lower(), list(known), n=1)
    return f"{word!r} (did you mean {near[0]!r}?)" if near else repr(word)
