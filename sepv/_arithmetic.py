"""The arithmetic mode of the process: the rounding direction,
and whether subnormal numbers are flushed to zero.

Code that is compiled with ``-ffast-math`` sets flush-to-zero for every program that loads it, and
``fesetround`` changes the rounding of all that follows. Every bound of sepv is derived for IEEE
754's default: rounding to nearest, with subnormal numbers. The mode is read by four operations,
because Python has no function for it.
"""

from __future__ import annotations

import ctypes
from contextlib import suppress

# Variables, because a compiler of Python computes an expression of constants once.
_one, _small, _least = 1.0, 2.0**-60, 2.0**-1022
# The result of `mode` by default: 1 ± 2⁻⁶⁰ and −1 − 2⁻⁶⁰ round to ±1, and a half of the least
# normal number is not 0.
_DEFAULT = (True, True, True, True)
# Room for the environment of any C library: glibc's has 32 bytes on x86-64, musl's and Apple's
# fewer than 64.
_ENVIRONMENT_BYTES = 512


def mode() -> tuple[bool, ...]:
    """Four facts that together are True only in the default mode;
    the last one is about subnormal numbers.
    """
    return (
        _one + _small == _one, _one - _small == _one, -_one - _small == -_one, _least * 0.5 != 0.0,
    )  # fmt: skip


def is_default() -> bool:
    """True if the process rounds to nearest and keeps subnormal numbers."""
    return mode() == _DEFAULT


def in_words() -> str:
    """The changed parts of the mode: "the rounding mode", "subnormal numbers, which become 0",
    both, or no words.
    """
    found = mode()
    words = [] if all(found[:3]) else ["the rounding mode"]
    return " and ".join([*words, *([] if found[3] else ["subnormal numbers, which become 0"])])


def _environment() -> ctypes.Array[ctypes.c_char] | None:
    """The floating-point environment at import, which `restore` sets again;
    None where C's library has no fegetenv.
    """
    room = ctypes.create_string_buffer(_ENVIRONMENT_BYTES)
    with suppress(OSError, AttributeError, TypeError):
        return room if ctypes.CDLL(None).fegetenv(room) == 0 else None
    return None


_AT_IMPORT = _environment() if is_default() else None


def restore() -> None:
    """Set the default mode again, if the process has another one and C's library can set it."""
    if _AT_IMPORT is not None and not is_default():
        ctypes.CDLL(None).fesetenv(_AT_IMPORT)
