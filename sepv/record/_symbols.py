"""Symbols and the tape, the list of operations on symbols.

Each operation on symbols is a line of the tape. If an operation is repeated on the same arguments,
its line is used again. Operations on constants are evaluated, and x + 0, 0·x and ±1·x are
simplified. A division by a constant becomes a product with its reciprocal. Signs move outward, so
that −a + b, b − a and b + (−1)a are one line. Apart from 0, ±1 and powers of two no rule depends on
the value of a constant. So systems that differ only in coefficients have the same lines, and share
one compiled kernel. Replacing 0·x by 0 assumes that x is finite.
"""

from __future__ import annotations

import math
import operator
import warnings
from collections.abc import Callable, Iterable, Mapping
from functools import partial, partialmethod
from typing import Any, NamedTuple

import numpy as np

from sepv.errors import SlowDerivation
from sepv.record._functions import FUNCTIONS
from sepv.record._numpy_protocol import (
    CannotRecord,
    Element,
    SymbolArray,
    array_function,
    array_ufunc,
    select,
)

# The largest exponent of a power that is written as products. Such a power is a line "whole":
# xⁿ⁻¹·x is evaluated like a product, and differentiated as xⁿ, with the derivative n xⁿ⁻¹.
LARGEST_POWER = 32
# Operations after which a tape warns that it takes long: five seconds or so.
SLOW_TAPE_OPERATIONS = 2**20


class Operation(NamedTuple):
    """A line of a tape: the operation's name, the lines of its arguments,
    and a constant's value or an exponent.
    """

    name: str
    arguments: tuple[int, ...]
    value: float = 0.0


class Tape:
    """The list of all operations done to symbols: each is listed once,
    and after the operations that it depends on.
    """

    def __init__(self) -> None:
        self.lines: list[Operation] = []
        # Derivatives of some lines, by the line's number, that are shorter than those of the chain
        # rule (`declare`).
        self.declared: dict[int, tuple[set[int], dict[int, Symbol]]] = {}
        self._known: dict[Any, Symbol] = {}
        # The number of calls of `write`, a measure of the time taken: one takes some microseconds.
        self.asked = self.inputs = 0

    def write(self, name: str, *arguments: Symbol, value: float = 0.0) -> Symbol:
        """Append an operation, unless the tape has an equal one already,
        and return the symbol of its result.
        """
        self.asked += 1
        if self.asked == SLOW_TAPE_OPERATIONS:
            warnings.warn(
                f"The derivatives of a function of {self.inputs} numbers take more than "
                f"{SLOW_TAPE_OPERATIONS} operations by symbols: this goes on, for minutes perhaps. Remedy: give "
                "gradient=, and hessian= and structure_derivative= where you have them; then nothing is derived.",
                SlowDerivation,
                stacklevel=2,
            )
        line = Operation(name, tuple(a.index for a in arguments), value)
        symbol = self._known.get(line)
        if symbol is None:
            symbol = self._known[line] = Symbol(self, len(self.lines))
            self.lines.append(line)
        return symbol

    def constant(self, value: float) -> Symbol:
        """The symbol of a number.

        NaN raises CannotRecord: NaN ≠ NaN, so that equal operations would not be found.
        """
        if math.isnan(value):
            raise CannotRecord("a constant is NaN")
        return self.write("constant", value=float(value) + 0.0)

    def declare(self, value: Symbol, fixed: Iterable[Symbol], slopes: Mapping[Symbol, Symbol]) -> None:
        """Declare the derivatives `slopes` of `value` by other symbols.

        `jacobian` uses them, not the chain rule.

        The declaration applies only if no symbol in `fixed` depends on the inputs of `jacobian`.
        """
        if value.line.arguments:
            by = {x.index: slope for x, slope in slopes.items()}
            self.declared[value.index] = ({x.index for x in fixed}, by)

    def vector(self, size: int) -> Any:
        """Create a new input with `size` components, as an array of symbols."""
        first = len(self.lines)
        self.inputs += size
        return array(self.write("input", value=float(first + i)) for i in range(size))

    def symbols(self, values: Any) -> Any:
        """Convert an array of symbols and numbers to symbols of this tape."""
        values = np.asarray(values, dtype=object)
        return array((self.symbol(v) for v in values.ravel()), values.shape)

    def symbol(self, value: Any) -> Symbol:
        """Convert a number to a constant; a symbol is returned unchanged."""
        symbol = _as_symbol(self, value)
        if symbol is None:
            raise CannotRecord(f"{type(value).__name__} is neither a symbol nor a number: {value!r:.60}")
        return symbol


def array(symbols: Iterable[Any], shape: tuple[int, ...] | None = None) -> Any:
    """An array of symbols as a `SymbolArray`, which NumPy's functions accept; for shape ()
    the symbol itself.
    """
    values = list(symbols)
    entries = np.empty(len(values), dtype=object)
    entries[:] = values
    return entries.reshape(shape or entries.shape).view(SymbolArray) if shape != () else values[0]


def _as_symbol(tape: Tape, value: Any) -> Symbol | None:
    if isinstance(value, Symbol):
        if value.tape is not tape:
            raise CannotRecord("symbols of two records meet: a function kept one from an earlier call")
        return value
    if isinstance(value, np.ndarray) and value.ndim == 0:
        return _as_symbol(tape, value[()])
    if isinstance(value, (int, float, np.integer, np.floating, np.bool_)):
        return tape.constant(float(value))
    return None


def _negated(a: Symbol) -> Symbol | None:
    return a.arguments[0] if a.line.name == "negative" else None


def _ordered(name: str, a: Symbol, b: Symbol) -> Symbol:
    return a.tape.write(name, a, b) if a.index <= b.index else a.tape.write(name, b, a)


def _add(a: Symbol, b: Symbol) -> Symbol:
    x, y = a.number, b.number
    if x is not None and y is not None:
        return a.tape.constant(x + y)
    if x == 0 or y == 0:
        return b if x == 0 else a
    if a.index == b.index:
        return _multiply(a.tape.constant(2.0), a)
    minus_a, minus_b = _negated(a), _negated(b)
    if minus_b is not None:
        return _subtract(a, minus_b)
    if minus_a is not None:
        return _subtract(b, minus_a)
    return _ordered("add", a, b)


def _subtract(a: Symbol, b: Symbol) -> Symbol:  # noqa: PLR0911 - a rule a line
    x, y = a.number, b.number
    if x is not None and y is not None:
        return a.tape.constant(x - y)
    if a.index == b.index:
        return a.tape.constant(0.0)
    if x == 0:
        return -b
    if y is not None:
        return _add(a, a.tape.constant(-y))
    minus_a, minus_b = _negated(a), _negated(b)
    if minus_b is not None:
        return _add(a, minus_b)
    if minus_a is not None:
        return -_add(minus_a, b)
    return a.tape.write("subtract", a, b)


def _multiply(a: Symbol, b: Symbol) -> Symbol:  # noqa: PLR0911 - a rule a line
    x, y = a.number, b.number
    if x is not None and y is not None:
        return a.tape.constant(x * y)
    if y is not None:
        a, b, x, y = b, a, y, x
    if x == 0:
        return a
    if x is not None and abs(x) == 1:
        return b if x > 0 else -b
    minus_a, minus_b = _negated(a), _negated(b)
    if minus_a is not None:
        return -_multiply(minus_a, b)
    if minus_b is not None:
        return -_multiply(a, minus_b)
    if x is not None and b.line.name == "multiply":
        # A product with a power of two is exact.
        first, second = b.arguments
        inner = first.number
        if inner is not None and (math.frexp(x)[0] == 0.5 or math.frexp(inner)[0] == 0.5):
            return _multiply(a.tape.constant(x * inner), second)
    (base, m), (other, n) = _as_power(a), _as_power(b)
    if base.index == other.index:
        return _whole_power(base, m + n)
    # Constants come first.
    return _ordered("multiply", a, b) if x is None else a.tape.write("multiply", a, b)


def _divide(a: Symbol, b: Symbol) -> Symbol:
    x, y = a.number, b.number
    if y is not None and y != 0 and math.isfinite(1 / y):
        return a.tape.constant(x / y) if x is not None else _multiply(a.tape.constant(1 / y), a)
    if y is not None:
        raise CannotRecord(f"it divides by the constant {y!r}")
    if x == 0:
        return a
    minus_a, minus_b = _negated(a), _negated(b)
    if minus_a is not None:
        return -_divide(minus_a, b)
    if minus_b is not None:
        return -_divide(a, minus_b)
    return a.tape.write("divide", a, b)


def _power(a: Symbol, b: Symbol) -> Symbol:
    exponent = b.number
    if exponent is None:
        raise CannotRecord("an exponent is not a number")
    if a.number is not None:
        with np.errstate(all="ignore"):
            return a.tape.constant(float(np.power(a.number, exponent)))
    if exponent == 0.5:
        return a.apply("sqrt")
    if exponent == int(exponent) and abs(exponent) <= LARGEST_POWER:
        sign, base = (-1, a.arguments[0]) if a.line.name == "negative" else (1, a)
        base, m = _as_power(base)
        power = _whole_power(base, m * abs(int(exponent)))
        power = -power if sign < 0 and exponent % 2 else power
        return power if exponent >= 0 else _divide(a.tape.constant(1.0), power)
    return a.tape.write("power", a, value=exponent)


def _whole_power(base: Symbol, n: int) -> Symbol:
    """The power xⁿ of a symbol by n − 1 products, so that the tape has the lower power for the
    derivative nxⁿ⁻¹.
    """
    power = base if n else base.tape.constant(1.0)
    for k in range(2, n + 1):
        power = base.tape.write("whole", power, base, value=float(k))
    return power


def _as_power(a: Symbol) -> tuple[Symbol, int]:
    """The base and the exponent of a whole power; for any other symbol the symbol itself and 1."""
    return (a.arguments[1], int(a.line.value)) if a.line.name == "whole" else (a, 1)


_COMPARE = {"greater": operator.gt, "greater_equal": operator.ge, "equal": operator.eq}


def _compare(name: str, a: Symbol, b: Symbol) -> Symbol:
    x, y = a.number, b.number
    if x is not None and y is not None:
        return a.tape.constant(float(_COMPARE[name](x, y)))
    return a.tape.write(name, a, b)


_greater, _greater_equal = partial(_compare, "greater"), partial(_compare, "greater_equal")


def _logical(name: str, a: Symbol, b: Symbol) -> Symbol:
    for condition, other in ((a, b), (b, a)):
        if condition.number is not None:
            decided = bool(condition.number) == (name == "or")
            return condition if decided else other
    return a if a.index == b.index else _ordered(name, a, b)


def _operator(rule: Callable[[Symbol, Symbol], Any], *, swapped: bool = False) -> Any:
    """Make a method for an operator of `Symbol` from a rule for two symbols;
    the other operand may be a number.
    """

    def method(self: Symbol, other: Any) -> Any:
        symbol = None if isinstance(other, np.ndarray) and other.ndim else _as_symbol(self.tape, other)
        if symbol is None:
            return NotImplemented
        return rule(symbol, self) if swapped else rule(self, symbol)

    return method


class Symbol(Element):
    """A symbol stands for the result of one recorded operation,
    and takes part in arithmetic like a number.
    """

    __slots__ = ("index", "tape")
    tape: Tape

    def __init__(self, tape: Tape, index: int) -> None:
        self.tape, self.index = tape, index

    def __repr__(self) -> str:
        return f"{self.line.name}[{self.index}]"

    def __hash__(self) -> int:
        return self.index

    @property
    def line(self) -> Operation:
        """The recorded operation whose result the symbol is."""
        return self.tape.lines[self.index]

    @property
    def arguments(self) -> tuple[Symbol, ...]:
        """The symbols of the operation's arguments."""
        return tuple(Symbol(self.tape, i) for i in self.line.arguments)

    @property
    def number(self) -> float | None:
        """The value of a constant; None for any other symbol."""
        return self.line.value if self.line.name == "constant" else None

    __array_ufunc__ = array_ufunc
    __array_function__ = array_function

    def __neg__(self) -> Symbol:
        if self.number is not None:
            return self.tape.constant(-self.number)
        if self.line.name == "negative":
            return self.arguments[0]
        return self.tape.write("negative", self)

    def __pos__(self) -> Symbol:
        return self

    def conjugate(self) -> Symbol:
        """The symbol itself, because states are real: `np.vdot` asks for it."""
        return self

    __add__ = __radd__ = _operator(_add)
    __sub__, __rsub__ = _operator(_subtract), _operator(_subtract, swapped=True)
    __mul__ = __rmul__ = _operator(_multiply)
    __truediv__, __rtruediv__ = _operator(_divide), _operator(_divide, swapped=True)
    __pow__ = _operator(_power)
    __gt__, __lt__ = _operator(_greater), _operator(_greater, swapped=True)
    __ge__, __le__ = _operator(_greater_equal), _operator(_greater_equal, swapped=True)
    __eq__ = _operator(partial(_compare, "equal"))
    __and__ = __rand__ = _operator(partial(_logical, "and"))
    __or__ = __ror__ = _operator(partial(_logical, "or"))

    def __ne__(self, other: Any) -> Any:
        return ~(self == other)

    def __abs__(self) -> Any:
        return select(self >= 0, self, -self)

    def __invert__(self) -> Any:
        if self.number is not None:
            return self.tape.constant(float(not self.number))
        return self.tape.write("not", self)

    def __bool__(self) -> bool:
        if self.number is not None:
            return bool(self.number)
        raise CannotRecord("it branches on a value")

    def __float__(self) -> float:
        if self.number is not None:
            return self.number
        raise CannotRecord(
            "it wants the value of a symbol (functions of `math` do: those of NumPy are recorded)"
        )

    def apply(self, name: str) -> Symbol:
        """Apply an elementary function by its name, such as "sin"."""
        if self.number is not None:
            with np.errstate(all="ignore"):
                return self.tape.constant(float(FUNCTIONS[name].value(self.number)))
        return self.tape.write(name, self)


# Methods such as `sin` of symbols, because np.sin on an array of objects calls the method `sin` of
# each element.
for _name in FUNCTIONS:
    setattr(Symbol, _name, partialmethod(Symbol.apply, _name))
