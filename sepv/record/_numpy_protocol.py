"""NumPy's functions on symbols, by the protocols `__array_ufunc__` and `__array_function__`.

NumPy's arithmetic on arrays of plain objects calls the arithmetic of the elements, but its
comparisons and `np.where` need values. `SymbolArray` records comparisons and `np.where` too.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import numpy as np

from sepv.record._functions import FUNCTIONS


class CannotRecord(TypeError):
    """Raised if a function cannot be recorded, because it needs the value of a symbol,
    or calls an unknown function.
    """

    def __init__(self, reason: str) -> None:
        super().__init__(
            f"{reason}. A function is recorded where it consists of arithmetic, indexing, NumPy's elementwise "
            "functions and np.where; what branches on values or calls into other libraries runs on NumPy as it is"
        )


class Element:
    """The base class of `sepv.record._symbols.Symbol`,
    with the two attributes that this module uses.
    """

    __slots__ = ()
    tape: Any

    @property
    def number(self) -> float | None:
        """The value of a constant; None for any other symbol."""
        raise NotImplementedError


def select(condition: Any, a: Any, b: Any) -> Any:
    """The symbol of a choice: a if a recorded condition holds, else b. Both a and b are
    evaluated.
    """
    if not isinstance(condition, Element):
        return a if condition else b
    if condition.number is not None:
        return a if condition.number else b
    tape = condition.tape
    first, second = tape.symbol(a), tape.symbol(b)
    return first if first.index == second.index else tape.write("select", condition, first, second)


def _elementary(name: str) -> Callable[[Any], Any]:
    value = FUNCTIONS[name].value
    return lambda x: value(x) if isinstance(x, (int, float)) else getattr(x, name)()


_UFUNCS: dict[Any, Callable[..., Any]] = {
    np.add: operator.add,
    np.subtract: operator.sub,
    np.multiply: operator.mul,
    np.divide: operator.truediv,
    np.power: operator.pow,
    np.negative: operator.neg,
    np.positive: operator.pos,
    np.absolute: abs,
    np.square: lambda x: x * x,
    np.reciprocal: lambda x: 1 / x,
    np.greater: operator.gt,
    np.greater_equal: operator.ge,
    np.less: operator.lt,
    np.less_equal: operator.le,
    np.equal: operator.eq,
    np.not_equal: operator.ne,
    np.logical_and: operator.and_,
    np.logical_or: operator.or_,
    np.bitwise_and: operator.and_,
    np.bitwise_or: operator.or_,
    np.logical_not: operator.invert,
    np.invert: operator.invert,
    np.maximum: lambda a, b: select(a >= b, a, b),
    np.minimum: lambda a, b: select(a <= b, a, b),
    **{
        getattr(np, name): _elementary(name)
        for name in FUNCTIONS
        if isinstance(getattr(np, name, None), np.ufunc)
    },
}
# NumPy's functions that need no replacement, because they use products and sums of the elements.
_AS_THEY_ARE = {np.matmul}
_REDUCTIONS: dict[Any, Any] = {
    np.all: np.logical_and, np.any: np.logical_or, np.max: np.maximum, np.min: np.minimum
}  # fmt: skip


def _plain(value: Any) -> Any:
    """Convert a number, a list or an array to a plain array of objects."""
    if isinstance(value, SymbolArray):
        return value.view(np.ndarray)
    if isinstance(value, np.ndarray):
        return value.astype(object)
    cell = np.empty((), dtype=object)
    if isinstance(value, (list, tuple)):
        return np.array(value, dtype=object)
    # A NumPy scalar would call this function again.
    cell[()] = value.item() if isinstance(value, np.generic) else value
    return cell


def _wrapped(value: Any) -> Any:
    """The result of a NumPy function as a `SymbolArray`; an array of shape ()
    becomes its only element.
    """
    if isinstance(value, np.ndarray):
        return value.view(SymbolArray) if value.ndim else value[()]
    return value


def array_ufunc(self: Any, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:  # noqa: ARG001 - NumPy's
    """NumPy's hook for elementwise functions and their reductions."""
    out = options.pop("out", None)
    options.pop("dtype", None)
    plain = [_plain(value) for value in inputs]
    if ufunc in _AS_THEY_ARE and method == "__call__":
        result = ufunc(*plain, **options)
    elif ufunc in _UFUNCS and method in ("__call__", "reduce"):
        elementwise = np.frompyfunc(_UFUNCS[ufunc], ufunc.nin, 1)
        result = getattr(elementwise, method)(*plain, **options)
    else:
        raise CannotRecord(f"it calls np.{ufunc.__name__}" + ("" if method == "__call__" else f".{method}"))
    if out is not None:
        out[0][...] = result
        return out[0]
    return _wrapped(result)


def array_function(self: Any, function: Any, types: Any, arguments: Any, options: Any) -> Any:  # noqa: ARG001 - NumPy's
    """NumPy's hook for other functions: `np.where`, `np.sinc`, reductions,
    and functions that only move elements.
    """
    if function is np.where and len(arguments) == 3:
        return _wrapped(np.frompyfunc(select, 3, 1)(*map(_plain, arguments)))
    if function is np.sinc:  # sin(πx)/(πx)
        return _wrapped(np.frompyfunc(lambda v: (np.pi * v).sinc(), 1, 1)(_plain(arguments[0])))
    if function in _REDUCTIONS:
        axis = options.pop("axis", arguments[1] if len(arguments) > 1 else None)
        values = _plain(arguments[0]).view(SymbolArray)
        return _REDUCTIONS[function].reduce(
            values.ravel() if axis is None else values, axis=axis or 0, **options
        )
    return _wrapped(function(*_unwrapped(arguments), **{k: _unwrapped(v) for k, v in options.items()}))


def _unwrapped(value: Any) -> Any:
    """The arguments of a NumPy function, with each symbol or `SymbolArray` as a plain array of
    objects.
    """
    if isinstance(value, (SymbolArray, Element)):
        return _plain(value)
    if isinstance(value, (list, tuple)):
        return type(value)(_unwrapped(v) for v in value)
    return value


class SymbolArray(np.ndarray):
    """An array of symbols and numbers."""

    __array_ufunc__ = array_ufunc
    __array_function__ = array_function  # type: ignore[assignment]  # other names of the same arguments
