"""Types and calls of functions that are passed by address, so that their callers are compiled once.

numba's own first-class functions are not used, because passing one takes 0.1 ms. This module needs
numba.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

# Options of compiled functions, which allocate no arrays (no references need be counted) and are
# called by address.
OPTIONS: Any = {
    "error_model": "numpy", "nogil": True, "cache": True, "_nrt": False,
    "no_cfunc_wrapper": True, "no_cpython_wrapper": True,
}  # fmt: skip
_vector, _matrix, _block = types.float64[::1], types.float64[:, ::1], types.float64[:, :, ::1]
_integers, _int, _float = types.int64[::1], types.int64, types.float64
# advance(S, I, increments, count, first, h, bound, P, left_over): take `count` steps of a block;
# return 1 if all its paths have failed. `left_over` is an address, see `call_left_over`.
ADVANCE = _int(_vector, _integers, _block, _int, _int, _float, _float, _vector, _int)
# start(S, I, increments, P): compute the invariants at the start of a block whose states are set.
START = types.void(_vector, _integers, _block, _vector)
# Functions of `sepv.simulate._compiled.lanes` and `sepv.simulate._compiled.driver`. Without
# signatures numba would compile a function again if an argument is a constant.
_words = types.uint64[:, ::1]
_streams, _stacks = types.uint64[:, :, :, ::1], types.float64[:, :, :, ::1]
_states = types.uint64[:, :, ::1]
ZIGGURAT = _float(_states, _int, _int, types.uint64)
NORMALS = types.void(_states, _int, _block, _int, _int, _int)
FILL = types.void(_int, _block, _int, _int, _states, _block, _block, _vector, _int)
BEGIN = types.void(_int, _states, _block, _words, _int, _vector, _int, _int)
RUN = types.void(
    _int, _int, _int, _int, _int, _int, _matrix, types.int64[:, ::1], _block, _streams, _stacks, _stacks, _matrix,
    _matrix, types.int64[:, ::1], _integers, _int, _vector, _words, _int, _vector, _int, _int, _block, _int, _float,
    _float, _vector, _vector, _vector, _block, _block,
)  # fmt: skip


def address(function: Any) -> int:
    """The address of the compiled code of a function that has exactly one signature."""
    (arguments,) = function.overloads
    found = function.overloads[arguments]
    return int(found.library.get_pointer_to_function(found.fndesc.llvm_func_name))


def calling(signature: Any) -> Callable[..., Any]:
    """Make f(address, arguments), which calls the function at an address with a tuple of
    arguments.
    """

    @intrinsic
    def call(_typingctx: Any, where: Any, arguments: Any) -> Any:
        if tuple(arguments) != signature.args:
            raise TypeError(f"expected arguments {signature.args}, received {tuple(arguments)}")

        def code(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
            convention, result = context.call_conv, signature.return_type
            kind = convention.get_function_type(result, signature.args)
            pointer = builder.inttoptr(values[0], kind.as_pointer())
            given = cgutils.unpack_tuple(builder, values[1], len(signature.args))
            status, found = convention.call_function(builder, pointer, result, signature.args, given)
            with cgutils.if_unlikely(builder, status.is_error):
                convention.return_status_propagate(builder, status)
            return found

        return signature.return_type(where, arguments), code

    return call


call_start, call_advance, call_begin = calling(START), calling(ADVANCE), calling(BEGIN)
call_fill, call_normals = calling(FILL), calling(NORMALS)


@intrinsic
def call_left_over(typingctx: Any, where: Any, S: Any, I: Any, buffer: Any, n: Any) -> Any:  # noqa: ARG001 - numba's
    """Call the C function at an address with four integers: the addresses of S, I, buffer[n],
    and buffer's row length.

    The function is `Chunk._solve` of `sepv.simulate._compiled.block_run`.
    """

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        kind = ir.FunctionType(ir.IntType(64), [ir.IntType(64)] * 4)
        arrays = [
            make_array(k)(context, builder, v) for k, v in zip(signature.args[1:4], values[1:4], strict=True)
        ]
        rows, width = cgutils.unpack_tuple(builder, arrays[2].shape, 3)[1:]
        step = builder.mul(values[4], builder.mul(rows, width))
        places = [arrays[0].data, arrays[1].data, builder.gep(arrays[2].data, [step])]
        given = [builder.ptrtoint(place, ir.IntType(64)) for place in places]
        return builder.call(builder.inttoptr(values[0], kind.as_pointer()), [*given, width])

    return types.int64(where, S, I, buffer, n), code
