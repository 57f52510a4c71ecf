"""Functions of `sepv.simulate._engine.kernels` compiled in a generated module, with the module's own names."""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType
from typing import Any

from numba import njit

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "nogil": True, "cache": True}


def compiled(
    function: Callable[..., Any], names: dict[str, Any], signature: Any = None, inline: bool = False
) -> Any:
    """The function's code over other names; its compiled code is kept beside the generated file.

    Parameters
    ----------
    names : globals of the generated module
    signature : numba signature, optional
        Compiled at once for it; else when it is called.
    """
    code = function.__code__.replace(co_filename=names["__file__"])
    own = FunctionType(code, names, function.__name__)
    options = _OPTIONS | ({"forceinline": True} if inline else {})
    return njit(signature, **options)(own) if signature is not None else njit(**options)(own)
