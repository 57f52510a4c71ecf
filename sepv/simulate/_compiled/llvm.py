"""Straight-line code of a lane (a path of a block), compiled from text to LLVM instructions as one
operation of numba.

For numba a piece of code is one call, which becomes exactly the instructions of the piece's lines,
in their order. The loops around a piece are ordinary functions (`kernels`), and still become SIMD
code. Kernels printed as a whole for numba would not be faster, and would start later: numba's type
inference needs seconds for a thousand statements.

Only straight-line code is printed: R and K = ∂R/∂z of an equation z = R, a correction and its test.
The lines of two lanes may be interleaved. Lines are assignments of +, −, ×, ÷, comparisons, &, |,
`fma`, `select`, `not_`, `abs`, elements of arrays and functions of numbers. This module needs
numba.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

FLOAT64, INT64, _BOOL = ir.DoubleType(), ir.IntType(64), ir.IntType(1)
_FLOATS = {ast.Add: "fadd", ast.Sub: "fsub", ast.Mult: "fmul", ast.Div: "fdiv"}
_INTEGERS = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul", ast.BitAnd: "and_", ast.BitOr: "or_"}
_COMPARISON_SIGNS = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}


class _Lines:
    """An emitter of instructions; `names` has values, numbers and functions,
    `arrays` has pointers with strides.
    """

    def __init__(
        self, context: Any, builder: Any, names: Mapping[str, Any], arrays: Mapping[str, Any]
    ) -> None:
        self.context, self.builder = context, builder
        self.names, self.arrays = dict(names), arrays

    def run(self, lines: Sequence[str], result: str) -> Any:
        """Emit the instructions of the lines; return the total of what they add to the variable
        `result`.
        """
        total = ir.Constant(INT64, 0)
        for statement in ast.parse("\n".join(lines)).body:
            if isinstance(statement, ast.AugAssign):
                assert isinstance(statement.target, ast.Name)
                assert statement.target.id == result
                total = self.builder.add(total, self.value(statement.value))
                continue
            assert isinstance(statement, ast.Assign)
            (target,) = statement.targets
            if isinstance(target, ast.Name):
                self.names[target.id] = self.value(statement.value)
            else:
                self.builder.store(self.value(statement.value), self.place(target))
        return total

    def place(self, node: Any) -> Any:
        """The address of an array's element, whose indices are not negative."""
        pointer, strides = self.arrays[node.value.id]
        indices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        offset = None
        for index, stride in zip(indices, strides, strict=True):
            value = self.value(index)
            value = value if stride is None else self.builder.mul(value, stride, flags=("nsw",))
            offset = value if offset is None else self.builder.add(offset, value, flags=("nsw",))
        return self.builder.gep(pointer, [offset], inbounds=True)

    def value(self, node: Any) -> Any:  # noqa: PLR0911 - a rule a line
        """Emit the instructions of an expression, and return its LLVM value."""
        builder = self.builder
        match node:
            case ast.Constant(value=bool(v)):
                return ir.Constant(_BOOL, int(v))
            case ast.Constant(value=int(v)):
                return ir.Constant(INT64, v)
            case ast.Constant(value=float(v)):
                return ir.Constant(FLOAT64, v)
            case ast.Name(id=name):
                return self.named(name)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                value = self.value(operand)
                return builder.neg(value) if value.type == INT64 else builder.fneg(value)
            case ast.Subscript(value=ast.Name(id=name)) if name in self.arrays:
                return builder.load(self.place(node))
            case ast.Subscript(value=several, slice=ast.Constant(value=int(i))):
                return builder.extract_value(self.value(several), i)
            case ast.BinOp(left=left, op=ast.Pow(), right=right):
                power = builder.module.declare_intrinsic("llvm.pow", [FLOAT64])
                return builder.call(power, (self.value(left), self.value(right)))
            case ast.BinOp(left=left, op=op, right=right):
                a, b = self.alike(self.value(left), self.value(right))
                rule = (_FLOATS if a.type == FLOAT64 else _INTEGERS)[type(op)]
                return getattr(builder, rule)(a, b)
            case ast.Compare(left=left, ops=[op], comparators=[right]):
                return self.compared(_COMPARISON_SIGNS[type(op)], self.value(left), self.value(right))
            case ast.Call(func=ast.Name(id=name), args=arguments):
                return self.called(name, [self.value(a) for a in arguments])
        raise AssertionError(f"no rule for {ast.unparse(node)}")

    def alike(self, a: Any, b: Any) -> tuple[Any, Any]:
        """Convert an integer to a float if the other value is a float."""
        if a.type == b.type:
            return a, b
        as_float = lambda v: v if v.type == FLOAT64 else self.builder.sitofp(v, FLOAT64)  # noqa: E731
        return as_float(a), as_float(b)

    def named(self, name: str) -> Any:
        """The LLVM value of a name; for the name of a Python number it is a constant."""
        found = self.names[name]
        if isinstance(found, (int, np.integer)):
            return ir.Constant(INT64, int(found))
        return ir.Constant(FLOAT64, float(found)) if isinstance(found, float) else found

    def compared(self, sign: str, a: Any, b: Any) -> Any:
        """Compare two values; NaN compares as in IEEE 754."""
        if a.type != FLOAT64:
            return self.builder.icmp_signed(sign, a, b)
        ordered = sign != "!="
        return (self.builder.fcmp_ordered if ordered else self.builder.fcmp_unordered)(sign, a, b)

    def called(self, name: str, arguments: list[Any]) -> Any:
        """Emit an operation without branches, or a call of a function that numba compiles."""
        builder = self.builder
        if name == "select":
            return builder.select(*arguments)
        if name == "not_":
            return builder.not_(arguments[0])
        if name == "fma":
            return builder.fma(*arguments)
        if name == "abs":
            return builder.call(builder.module.declare_intrinsic("llvm.fabs", [FLOAT64]), arguments)
        typing = self.context.typing_context
        function = typing.resolve_value_type(self.names[name])
        signature = function.get_call_type(typing, (types.float64,) * len(arguments), {})
        return self.context.get_function(function, signature)(builder, arguments)


def _array(context: Any, builder: Any, kind: Any, value: Any) -> tuple[Any, list[Any]]:
    """The data pointer of a contiguous array, and its strides in elements,
    with None for the stride 1.
    """
    if kind.layout != "C":
        raise TypeError(f"expected a contiguous array, received {kind}")
    found = context.make_array(kind)(context, builder, value)
    shape = cgutils.unpack_tuple(builder, found.shape, kind.ndim)
    strides: list[Any] = [None]
    for n in reversed(shape[1:]):
        strides.insert(0, n if strides[0] is None else builder.mul(n, strides[0]))
    return found.data, strides


def _codegen(lines: Sequence[str], result: str, arguments: Sequence[str], known: Mapping[str, Any]) -> Any:
    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        names, arrays = dict(known), {}
        for name, kind, value in zip(arguments, signature.args, values, strict=True):
            if isinstance(kind, types.Array):
                arrays[name] = _array(context, builder, kind, value)
            elif isinstance(kind, types.BaseTuple):  # tuples c0, c1, …, p0, p1, … and the weights of a node
                several = (
                    *known["PARAMETERS"],
                    *(f"{w}{i}" for w in "ab" for i in range(known.get("STAGES", 0))),
                )
                names.update(zip(several, cgutils.unpack_tuple(builder, value, kind.count), strict=False))
            else:
                names[name] = value
        return _Lines(context, builder, names, arrays).run(lines, result)

    return code


def lane_piece(lines: Sequence[str], result: str, known: Mapping[str, Any]) -> Callable[..., Any]:
    """Make f(S, I, buffer, n, k, first, h, bound, q), which runs the lines for lane k in step n and
    returns `result`.

    `known` has the numbers and functions that the lines use, and under PARAMETERS the names of the
    numbers in q.
    """
    code = _codegen(lines, result, ("S", "I", "buffer", "n", "k", "first", "h", "bound", "q"), known)

    @intrinsic
    def piece(
        _typingctx: Any, S: Any, I: Any, buffer: Any, n: Any, k: Any, first: Any, h: Any, bound: Any, q: Any
    ) -> Any:
        return types.int64(S, I, buffer, n, k, first, h, bound, q), code

    return piece


def loaded(count: int) -> Callable[..., Any]:
    """Make f(P), which returns the first `count` numbers of an array as a tuple,
    so that they stay in registers.
    """

    @intrinsic
    def piece(typingctx: Any, P: Any) -> Any:  # noqa: ARG001 - numba's signature
        kind = types.UniTuple(types.float64, count)

        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            data, _ = _array(context, builder, signature.args[0], values[0])
            found = [
                builder.load(builder.gep(data, [ir.Constant(INT64, i)], inbounds=True)) for i in range(count)
            ]
            return context.make_tuple(builder, kind, found)

        return kind(P), code

    return piece
