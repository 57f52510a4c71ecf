"""Hashes of the code that makes the steps of a store's paths,
so that a store is not continued by other code.

Followed are Python functions with their constants, defaults, closures and the globals that they
name; records and bound methods with their parts; libraries that `ctypes` loaded, extension modules,
and files on the command line of a program, by the bytes of the file. sepv, NumPy, SciPy, numba and
mpmath are known by their versions alone. Lists, dicts and arrays that can be written are left out,
because they may be caches. Steps from drawn states see most of the rest, but no hash sees data that
a step reads from files or the network, or code that it makes while it runs.
"""

from __future__ import annotations

import hashlib
import shutil
import sys
from collections.abc import Iterable
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

_PLAIN_TYPES = (bool, int, float, complex, str, bytes, type(None), type(Ellipsis), np.generic)
# Packages whose code is known by their versions.
_INSTALLED = {"sepv", "numpy", "scipy", "numba", "mpmath"} | sys.stdlib_module_names


def code_of(*objects: Any) -> dict[str, str]:
    """A hash (16 hex digits) by name for each function and file that these objects reach."""
    found: dict[str, str] = {}
    _follow(objects, "", found, {})
    return dict(sorted(found.items()))


def _follow(  # noqa: PLR0911, PLR0912 - a kind of value a line
    value: Any, name: str, found: dict[str, str], seen: dict[int, Any]
) -> bytes:
    """Note the functions and files that a value reaches,
    and return the bytes of the plain data in it.
    """
    if isinstance(value, _PLAIN_TYPES):
        return repr(value).encode()
    if id(value) in seen:
        return b"seen"
    seen[id(value)] = value  # kept, so that no other object gets this id
    if isinstance(value, np.ndarray):
        return b"array" if value.flags.writeable or value.dtype == object else value.tobytes()
    if isinstance(value, tuple):
        return b"(" + b",".join(_follow(v, name, found, seen) for v in value) + b")"
    if isinstance(value, frozenset):  # its order differs from process to process
        return b"(" + b",".join(sorted(_follow(v, name, found, seen) for v in value)) + b")"
    if isinstance(value, (list, dict, set)):
        return b"mutable"
    if isinstance(value, MethodType):
        return _follow((value.__func__, value.__self__), name, found, seen)
    if isinstance(value, FunctionType):
        return _function(value, found, seen)
    if isinstance(value, (ModuleType, type, BuiltinFunctionType)):
        _file(getattr(sys.modules.get(getattr(value, "__module__", None) or ""), "__file__", None), found)
        return getattr(value, "__qualname__", getattr(value, "__name__", "")).encode()
    library = getattr(value, "_name", None)  # of ctypes.CDLL
    if isinstance(library, str) and hasattr(value, "_handle"):
        _file(library, found)
    command = getattr(value, "argv", None)
    if isinstance(command, (list, tuple)):
        for word in map(str, command):
            _file(shutil.which(word) or word, found)
    parts: tuple[Any, ...]
    if is_dataclass(value):
        parts = tuple(getattr(value, f.name, None) for f in fields(value))
    else:  # functions alone: other attributes may be caches
        parts = (
            tuple(v for _, v in sorted(vars(value).items()) if callable(v))
            if hasattr(value, "__dict__")
            else ()
        )
    parts += tuple(getattr(value, key) for key in ("func", "args", "py_func") if hasattr(value, key))
    call = vars(type(value)).get("__call__")
    own = _follow(call, name, found, seen) if isinstance(call, FunctionType) else b""
    return type(value).__qualname__.encode() + own + _follow(parts, name, found, seen)


def _function(function: FunctionType, found: dict[str, str], seen: dict[int, Any]) -> bytes:
    name = f"{function.__module__}.{function.__qualname__}"
    cells = tuple(cell.cell_contents for cell in function.__closure__ or () if _is_filled(cell))
    parts = (function.__defaults__, tuple(sorted((function.__kwdefaults__ or {}).items(), key=str)), cells)
    if (function.__module__ or "").partition(".")[0] in _INSTALLED:
        return name.encode() + _follow(parts, name, found, seen)
    codes = list(_codes(function.__code__))
    names = sorted({n for code in codes for n in code.co_names} & function.__globals__.keys())
    text = b"".join(code.co_code + repr(code.co_names).encode() for code in codes)
    constants = tuple(c for code in codes for c in code.co_consts if not isinstance(c, CodeType))
    reached = tuple(function.__globals__[n] for n in names)
    text += _follow((constants, parts, reached), name, found, seen)
    text += found.get(name, "").encode()  # two functions of one name
    found[name] = hashlib.sha256(text).hexdigest()[:16]
    return name.encode()


def _codes(code: CodeType) -> Iterable[CodeType]:
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def _is_filled(cell: Any) -> bool:
    try:
        return cell.cell_contents is not cell
    except ValueError:
        return False


def _file(path: Any, found: dict[str, str]) -> None:
    """Note the hash of a file that is no source text of Python, whose functions are followed."""
    if path and not str(path).endswith((".py", ".pyc")) and Path(path).is_file():
        found[str(path)] = hashlib.sha256(Path(path).read_bytes()).hexdigest()[:16]
