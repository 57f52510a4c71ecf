"""Conversion of users' numbers: arguments to float64 arrays, and JSON,
whose numbers may be hex floats with 0x.

Arguments may not be text, complex numbers or ragged lists. JSON may not contain NaN or repeated
keys.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable
from difflib import get_close_matches
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sepv.errors import UsageError

# The longest time limit in seconds, thirty years, because system clocks count no further.
MAX_SECONDS = 1e9
_HEX = re.compile(
    r"[+-]?(0x[0-9a-f]+(\.[0-9a-f]*)?(p[+-]?[0-9]{1,9})?|nan|inf|infinity)", re.IGNORECASE
).fullmatch
_WORDS_OF_KINDS = {"c": "complex numbers", "U": "text", "S": "text"}
# The largest number of characters of a value that a message quotes.
_QUOTED_MAX_CHARACTERS = 60


def floats(what: str, value: Any) -> NDArray[np.float64]:
    """Convert a value to an array of binary64 numbers, finite or not;
    a UsageError for anything but real numbers.
    """
    try:
        array = np.asarray(value)
        if array.dtype.kind == "O":
            if any(v is None or isinstance(v, (str, bytes)) for v in array.flat):
                raise TypeError("None or text among them")
        elif array.dtype.kind not in "fiub":
            raise TypeError(f"{_WORDS_OF_KINDS.get(array.dtype.kind, array.dtype)}")
        return array.astype(np.float64, copy=False)
    except (TypeError, ValueError) as error:
        raise UsageError(
            expected=f"{what}: real numbers",
            received=f"{value!r:.80} ({error})",
            remedy="give a number, a NumPy array of numbers, or lists of them of equal length",
        ) from error


def is_number(value: Any) -> bool:
    """True for one finite real number."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    return isinstance(value, (int, float, np.integer, np.floating)) and math.isfinite(value)


def is_whole(value: Any) -> bool:
    """True for one integer; False for the truth values True and False, and for anything else."""
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool)


def require_whole(what: str, value: Any, remedy: str, low: int = 1, high: int | None = None) -> int:
    """Convert a value to an int; a UsageError unless it is an integer from `low` to `high`."""
    if not is_whole(value) or value < low or (high is not None and value > high):
        bounds = f"≥ {low}" if high is None else f"from {low} to {high}"
        raise UsageError(expected=f"{what}, an integer {bounds}", received=f"{value!r:.80}", remedy=remedy)
    return int(value)


def require_flag(what: str, value: Any) -> None:
    """Raise a UsageError for anything but True and False,
    because a word such as "no" would count as true.
    """
    if not isinstance(value, (bool, np.bool_)):
        raise UsageError(
            expected=f"{what}, True or False", received=repr(value), remedy=f"{what}=True or {what}=False"
        )


def optional(module: str, expected: str, remedy: str, kind: type[UsageError] = UsageError) -> Any:
    """Import a module that may not be installed; the error for a missing module says what needs it
    (`expected`).
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise kind(expected=expected, received=f"{error}", remedy=remedy) from error


def did_you_mean(word: Any, known: Iterable[str]) -> str:
    """Quote an unknown word for a message, with the closest known word if one is close."""
    near = get_close_matches(str(word).replace("_", "-").lower(), list(known), n=1)
    return f"{word!r} (did you mean {near[0]!r}?)" if near else repr(word)


def parse_json(text: str | bytes) -> Any:
    """Parse a JSON text; bytes are UTF-8.

    Raises
    ------
    ValueError
        For text that is not JSON, the constants NaN and Infinity, numbers beyond binary64, a
        repeated key, a number with more digits than Python reads, or brackets nested too deeply.
    """
    try:
        text = text.decode() if isinstance(text, bytes) else text
        return json.loads(
            text, parse_constant=_refuse, object_pairs_hook=_object,
            parse_float=lambda word: _finite(word, float), parse_int=lambda word: _finite(word, int),
        )  # fmt: skip
    except RecursionError:
        raise ValueError("brackets within brackets, too deep to be read") from None


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is not JSON, which has finite numbers only")


def _finite(word: str, kind: type[Any]) -> Any:
    """Convert the text of a JSON number; a ValueError for a number beyond binary64."""
    if not math.isfinite(float(word)):
        raise ValueError(f"{word:.{_QUOTED_MAX_CHARACTERS}} is beyond binary64")
    return kind(word)


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    record = dict(pairs)
    if len(record) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise ValueError(f"the key {twice!r:.{_QUOTED_MAX_CHARACTERS}} stands twice in one object")
    return record


def hex_float(text: Any) -> float:
    """The double of a text in the format of C's %a, ±inf if it is beyond binary64;
    a ValueError for any other text.
    """
    if not isinstance(text, str) or not _HEX(text):
        raise ValueError(
            f'{text!r:.{_QUOTED_MAX_CHARACTERS}} is no hex float in a string, such as "0x1.8p+1" for 3'
        )
    try:
        return float.fromhex(text)
    except OverflowError:
        return -math.inf if text.startswith("-") else math.inf


def double(value: Any) -> float:
    """The finite double of a JSON number or of a hex float in a string.

    Raises
    ------
    ValueError
        For anything else: decimal text, true and false, numbers beyond binary64.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        kind = {bool: "true or false", type(None): "null", list: "a list", dict: "an object"}
        raise ValueError(f"{kind.get(type(value), type(value).__name__)} where a number was expected")
    try:
        number = hex_float(value) if isinstance(value, str) else float(value)
    except OverflowError:
        number = math.inf
    except ValueError:
        raise ValueError(
            f"{value!r:.{_QUOTED_MAX_CHARACTERS}} is neither a JSON number such as 0.5 "
            'nor a hex float with 0x, such as "0x1p-1"'
        ) from None
    if not math.isfinite(number):
        raise ValueError(
            f"{value!r:.{_QUOTED_MAX_CHARACTERS}} is not finite, or beyond the largest binary64 number"
        )
    return number
