"""Sine, cosine and logarithm without branches or calls,
so that a loop over lanes becomes SIMD code.

The polynomials are those of fdlibm (k_sin.c, k_cos.c, e_log.c; errors below 1 ulp on reduced
arguments). This module needs numba, and is imported only by other code that needs numba. Its
compiled functions call no functions of other modules of sepv, because numba compiles a function
anew only if the function's own file has changed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from sepv._patches import add_attribute
from sepv.simulate._compiled.llvm import FLOAT64, INT64

_inline: Any = njit(error_model="numpy", forceinline=True, cache=True, _nrt=False)

# π/2 in three parts of 22, 22 and 53 bits: k times one of the first two parts is exact for |k|
# < 2³¹.
_PART_1 = float.fromhex("0x1.921fb0p+0")
_PART_2 = float.fromhex("0x1.5110bp-22")
_PART_3 = float.fromhex("0x1.18469898cc517p-44")
_TWO_OVER_PI = 2 / math.pi
# The largest angle. Beyond it the result is NaN: the angle's own rounding is 1e-7, and the
# reduction is not exact.
_LARGEST_ANGLE = 1e9
_INT8 = ir.IntType(8)
# The number of lanes whose increments are added up together: four registers of eight.
SUMMED_LANES = 32
_TO_INTEGER = 1.5 * 2.0**52  # adding it rounds to the nearest integer
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10


def _emits(instruction: Callable[[Any, Any], Any]) -> Callable[..., Any]:
    """Make the code of an intrinsic that is a single instruction,
    which the builder emits from the arguments.
    """
    return lambda context, builder, signature, arguments: instruction(builder, arguments)  # noqa: ARG005 - numba's


@intrinsic
def float_bits(typingctx: Any, x: Any) -> Any:  # noqa: ARG001 - numba's signature
    """The 64 bits of a float64 as an int64."""
    return types.int64(types.float64), _emits(lambda builder, a: builder.bitcast(a[0], INT64))


@intrinsic
def bits_float(typingctx: Any, x: Any) -> Any:  # noqa: ARG001 - numba's signature
    """The float64 whose 64 bits are those of an int64."""
    return types.float64(types.int64), _emits(lambda builder, a: builder.bitcast(a[0], FLOAT64))


@intrinsic
def select(typingctx: Any, condition: Any, a: Any, b: Any) -> Any:  # noqa: ARG001 - numba's signature
    """a if the condition holds, else b; both are evaluated,
    because a branch would prevent SIMD code of a loop.
    """
    kind = types.float64 if types.float64 in (a, b) else types.int64
    return kind(types.boolean, kind, kind), _emits(lambda builder, found: builder.select(*found))


@intrinsic
def fma(typingctx: Any, a: Any, b: Any, c: Any) -> Any:  # noqa: ARG001 - numba's signature
    """a·b + c with one rounding, explicitly, so that SIMD and scalar code agree."""
    return types.float64(*[types.float64] * 3), _emits(lambda builder, a: builder.fma(*a))


@intrinsic
def for_simd(typingctx: Any) -> Any:  # noqa: ARG001 - numba's signature
    """Ask LLVM for good SIMD code of the function's loops: registers of 512 bits,
    and arrays that do not overlap.

    By default LLVM uses registers of 256 bits on Intel's processors, which makes pure arithmetic
    1.4 times slower.
    """

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ARG001 - numba's
        add_attribute(builder.function.attributes, '"prefer-vector-width"="512"')
        for argument in builder.function.args:
            if isinstance(argument.type, ir.PointerType):
                argument.add_attribute("noalias")
        return context.get_dummy_value()

    return types.void(), code


def place(context: Any, builder: Any, kind: Any, array: Any, *indices: Any, lanes: int = 1) -> Any:
    """The address of an element of an array, or of the vector of `lanes` elements that begins with
    it.
    """
    found = cgutils.get_item_pointer(
        context, builder, kind, make_array(kind)(context, builder, array), indices
    )
    vector = ir.VectorType(found.type.pointee, lanes)
    return builder.bitcast(found, vector.as_pointer()) if lanes > 1 else found


@intrinsic
def part(typingctx: Any, array: Any, first: Any, lane: Any) -> Any:  # noqa: ARG001 - numba's signature
    """A view of an array (N, m, M) from [first, 0, lane] on with the same strides;
    a row continues into the next.
    """

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind, (whole, first, lane) = signature.return_type, arguments
        found = make_array(kind)(context, builder, whole)
        found.data = place(context, builder, kind, whole, first, INT64(0), lane)
        return found._getvalue()

    return array(array, types.int64, types.int64), code


@intrinsic
def prefetch(typingctx: Any, array: Any, n: Any, j: Any, k: Any) -> Any:  # noqa: ARG001 - numba's signature
    """Prefetch the cache line of array[n, j, k], which need not exist."""

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        byte = builder.bitcast(place(context, builder, signature.args[0], *arguments), _INT8.as_pointer())
        kinds = [byte.type, *[ir.IntType(32)] * 3]
        function = builder.module.declare_intrinsic(
            "llvm.prefetch", [byte.type], ir.FunctionType(ir.VoidType(), kinds)
        )
        builder.call(function, [byte, *(ir.Constant(ir.IntType(32), v) for v in (0, 3, 1))])
        return context.get_dummy_value()

    return types.void(array, types.int64, types.int64, types.int64), code


def _on_rows(rows: int, emit: Callable[..., Any], whole: bool = False) -> Any:
    """Make an intrinsic f(count, (array, indices, …, number, …))
    that loops over `count` elements of `rows` array rows.

    Each row begins at the given indices of its array. `emit` gets the addresses of one element of
    each row. If `whole`, `emit` is called once, with the addresses of the first elements and the
    count. A loop of numba's own would take a tenth of a second longer to compile.
    """

    @intrinsic
    def operation(_typingctx: Any, count: Any, arguments: Any) -> Any:  # noqa: ARG001 - numba's signature
        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            kinds, given = signature.args[1], cgutils.unpack_tuple(builder, values[1])
            starts = [
                place(context, builder, kinds[i], given[i], *cgutils.unpack_tuple(builder, given[i + 1]))
                for i in range(0, 2 * rows, 2)
            ]
            if whole:
                emit(builder, *starts, values[0], *given[2 * rows :])
                return context.get_dummy_value()
            with cgutils.for_range(builder, values[0]) as loop:
                emit(builder, *(builder.gep(v, [loop.index]) for v in starts), *given[2 * rows :])
            return context.get_dummy_value()

        return types.void(types.int64, arguments), code

    return operation


def _halve(builder: Any, left: Any, right: Any, factor: Any) -> None:
    whole = builder.load(left)
    half = builder.fadd(builder.fmul(FLOAT64(0.5), whole), builder.fmul(factor, builder.load(right)))
    builder.store(half, left)
    builder.store(builder.fsub(whole, half), right)


def _raise(builder: Any, u: Any, v: Any, threshold: Any, value: Any) -> None:
    reached = builder.fcmp_ordered(">=", builder.load(u), threshold)
    builder.store(builder.select(reached, value, builder.load(v)), v)


# Copy a row to another; set all bits of a row to those of 0 or −1; set a row to a number; multiply
# a row by a number.
copy_row = _on_rows(2, lambda builder, a, b, count: cgutils.raw_memcpy(builder, b, a, count, 8), whole=True)
set_bits = _on_rows(1, lambda builder, a, count, bits: cgutils.memset(
    builder, a, builder.mul(count, INT64(8)), builder.trunc(bits, _INT8)), whole=True)  # fmt: skip
set_row = _on_rows(1, lambda builder, target, value: builder.store(value, target))
scale_row = _on_rows(1, lambda builder, x, factor: builder.store(builder.fmul(builder.load(x), factor), x))
# Replace a row of increments and one of normals by the increments over the first and over the
# second halves of steps.
halve_rows = _on_rows(2, _halve)
# Set the elements of a row v to a value where the elements of a row u are at least a threshold.
raise_row = _on_rows(2, _raise)


def _vectors(context: Any, builder: Any, kind: Any, array: Any, lanes: int) -> Iterator[tuple[int, Any]]:
    """Loop over the last axis of an array (n, m, L), `lanes` at a time, then singly;
    yield a group's size and start.
    """
    width = cgutils.unpack_tuple(builder, make_array(kind)(context, builder, array).shape)[2]
    whole = builder.and_(width, INT64(-lanes))
    for size, first, last in ((lanes, INT64(0), whole), (1, whole, width)):
        with cgutils.for_range_slice(builder, first, last, INT64(size), INT64) as (k, _):
            yield size, k


@intrinsic
def add_rows(typingctx: Any, rows: Any, count: Any, j: Any, W: Any, b: Any) -> Any:  # noqa: ARG001 - numba's signature
    """Add rows[i, j] for all i < `count` to W[b, j]; the sums of SUMMED_LANES lanes at a time stay
    in registers.
    """

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        rows, count, j, W, b = arguments

        for lanes, k in _vectors(context, builder, signature.args[3], W, SUMMED_LANES):
            start = place(context, builder, signature.args[3], W, b, j, k, lanes=lanes)
            total = cgutils.alloca_once_value(builder, builder.load(start, align=8))
            with cgutils.for_range(builder, count) as loop:
                row = place(context, builder, signature.args[0], rows, loop.index, j, k, lanes=lanes)
                builder.store(builder.fadd(builder.load(total), builder.load(row, align=8)), total)
            builder.store(builder.load(total), start, align=8)
        return context.get_dummy_value()

    return types.void(rows, types.int64, types.int64, W, types.int64), code


def _mixed(builder: Any, a: Any, b: Any, order: Sequence[int]) -> Any:
    """The vector of the elements `order` of two vectors,
    whose elements are numbered from a's first to b's last.
    """
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(ir.IntType(32), len(order)), list(order)))


def _drawn(builder: Any, words: Sequence[Any]) -> Any:
    """Draw 64 bits from SFC64, or a vector of such draws; the state (a, b, c, counter)
    is at the addresses `words`.
    """
    a, b, c, counter = (builder.load(word, align=8) for word in words)
    bits, out = a.type, builder.add(builder.add(a, b), counter)
    turned = builder.or_(builder.shl(c, bits(24)), builder.lshr(c, bits(40)))
    a, b = builder.xor(b, builder.lshr(b, bits(11))), builder.add(c, builder.shl(c, bits(3)))
    for word, value in zip(
        words, (a, b, builder.add(turned, out), builder.add(counter, bits(1))), strict=True
    ):
        builder.store(value, word, align=8)
    return out


def _words(context: Any, builder: Any, kind: Any, rng: Any, s: Any, k: Any, lanes: int = 1) -> list[Any]:
    """The addresses of the four state words of stream s of rng (streams, 4, L),
    for `lanes` lanes from k on.
    """
    return [place(context, builder, kind, rng, s, INT64(i), k, lanes=lanes) for i in range(4)]


@intrinsic
def mix(typingctx: Any, rng: Any, s: Any, rounds: Any) -> Any:  # noqa: ARG001 - numba's signature
    """Draw `rounds` times from stream s of all lanes, to mix its state;
    two registers at a time hide the latency.
    """

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        rng, s, rounds = arguments
        for lanes, k in _vectors(context, builder, signature.args[0], rng, 16):
            words = _words(context, builder, signature.args[0], rng, s, k, lanes)
            state = [cgutils.alloca_once_value(builder, builder.load(word, align=8)) for word in words]
            with cgutils.for_range(builder, rounds):
                _drawn(builder, state)
            for word, value in zip(words, state, strict=True):
                builder.store(builder.load(value), word, align=8)
        return context.get_dummy_value()

    return types.void(rng, types.int64, types.int64), code


@intrinsic
def draw(typingctx: Any, rng: Any, s: Any, k: Any) -> Any:  # noqa: ARG001 - numba's signature
    """Draw the next 64 bits of stream s of lane k."""

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _drawn(builder, _words(context, builder, signature.args[0], *arguments))

    return types.uint64(rng, types.int64, types.int64), code


@intrinsic
def eight_normals(typingctx: Any, rng: Any, s: Any, k: Any, table: Any, out: Any, i: Any, j: Any) -> Any:  # noqa: ARG001 - numba's
    """Draw normals for eight lanes from lane k on by the ziggurat's first test;
    return a bit for each lane that fails.

    A lane (path) of out[i, j] gets its normal or, if it fails the test, the 64 bits drawn from
    stream s. The width and the limit of a layer in `table` are loaded together, because separate
    loads of the two would take twice as long.
    """
    bits, doubles = ir.VectorType(INT64, 8), ir.VectorType(FLOAT64, 8)

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        rng, s, k, table, out, i, j = arguments
        r = _drawn(builder, _words(context, builder, signature.args[0], rng, s, k, 8))
        layers = builder.and_(r, bits(0xFF))
        pairs = []
        for lane in (0, 2, 4, 6, 1, 3, 5, 7):
            layer = builder.extract_element(layers, INT64(lane))
            pair = place(context, builder, signature.args[3], table, layer, INT64(0), lanes=2)
            pairs.append(builder.load(pair, align=8))
        while len(pairs) > 2:  # join the pairs of the even lanes, and those of the odd lanes
            joined = zip(pairs[::2], pairs[1::2], strict=True)
            pairs = [_mixed(builder, a, b, range(2 * a.type.count)) for a, b in joined]
        width, limit = (
            _mixed(builder, pairs[0], pairs[1], [i + n for i in range(0, 8, 2) for n in (j, j + 8)])
            for j in (0, 1)
        )
        size = builder.sitofp(builder.and_(builder.lshr(r, bits(9)), bits(0x000FFFFFFFFFFFFF)), doubles)
        sign = builder.shl(builder.and_(r, bits(0x100)), bits(55))
        x = builder.xor(builder.bitcast(builder.fmul(size, width), bits), sign)
        done = builder.fcmp_ordered("<", size, limit)
        first = builder.bitcast(place(context, builder, signature.args[4], out, i, j, k), bits.as_pointer())
        builder.store(builder.select(done, x, r), first, align=8)
        return builder.zext(builder.bitcast(builder.not_(done), _INT8), INT64)

    return types.uint64(rng, types.int64, types.int64, table, out, types.int64, types.int64), code


@intrinsic
def lowest_bit(typingctx: Any, bits: Any) -> Any:  # noqa: ARG001 - numba's signature
    """The position of the lowest set bit; `bits` must not be 0."""
    return types.int64(types.uint64), _emits(
        lambda builder, a: builder.cttz(a[0], ir.Constant(ir.IntType(1), 1))
    )


@_inline
def sine_tail(z: float) -> float:
    """The number s in sin x = x + x·z·(−1/6 + z·s), z = x², for |x| ≤ π/4."""
    return 8.33333333332248946124e-03 + z * (
        -1.98412698298579493134e-04
        + z
        * (2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10))
    )


@_inline
def sincos(x: float) -> tuple[float, float]:
    """The pair (sin x, cos x), within 1 ulp of 1 for |x| ≤ 1e9, and NaN for larger |x|."""
    shifted = x * _TWO_OVER_PI + _TO_INTEGER
    k = shifted - _TO_INTEGER
    quadrant = float_bits(shifted)
    reduced = (x - k * _PART_1) - k * _PART_2
    r = reduced - k * _PART_3
    # The rounding error of r. Without it, results for all x of a binade and quadrant have a bias of
    # 1/10 of a rounding.
    low = (reduced - r) - k * _PART_3
    r = select(abs(x) <= _LARGEST_ANGLE, r, np.nan)
    z = r * r
    s = sine_tail(z)
    sine = r + (z * r * (-1.66666666666666324348e-01 + z * s) + low * (1.0 - 0.5 * z))
    c = 4.16666666666666019037e-02 + z * (
        -1.38888888888741095749e-03
        + z * (2.48015872894767294178e-05 + z * (-2.75573143513906633035e-07
        + z * (2.08757232129817482790e-09 - z * 1.13596475577881948265e-11)))
    )  # fmt: skip
    half = 0.5 * z
    w = 1.0 - half
    cos = w + (((1.0 - w) - half) + (z * z * c - r * low))
    odd = (quadrant & 1) != 0
    a = select(odd, cos, sine)
    b = select(odd, sine, cos)
    a = select((quadrant & 2) != 0, -a, a)
    b = select(((quadrant + 1) & 2) != 0, -b, b)
    return a, b


@_inline
def cosine(x: float) -> float:
    """The cosine of x, with the errors of `sincos`."""
    return sincos(x)[1]


@_inline
def sinc(x: float) -> tuple[float, float]:
    """sin(x)/x and its derivative, which has only a few digits for small x,
    enough for Newton's matrix.
    """
    sine, cos = sincos(x)
    flat = abs(x) < 1e-3
    safe = select(flat, 1.0, x)
    z = x * x
    s = sine_tail(z)
    # The quotient has two roundings, 0.53·2⁻⁵³ in root mean square; the series has 0.29·2⁻⁵³.
    value = select(z < 0.6, 1.0 + z * (-1.66666666666666324348e-01 + z * s), sine / safe)
    slope = select(flat, -x * (1.0 / 3.0 - z / 30.0), (cos - value) / safe)
    return value, slope


@_inline
def logarithm(x: float) -> float:
    """The logarithm ln x within 1 ulp for normal numbers x > 0; NaN for x ≤ 0 and for x not
    finite.
    """
    bits = float_bits(x)
    # 0x3fe6a09e667f3bcd is √½: the mantissa is reduced to [√½, √2).
    high = bits - 0x3FE6A09E667F3BCD
    k = high >> 52
    mantissa = bits_float(bits - (k << 52))
    f = mantissa - 1.0
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    t1 = w * (3.999999999940941908e-01 + w * (2.222219843214978396e-01 + w * 1.531383769920937332e-01))
    t2 = z * (
        6.666666666666735130e-01
        + w * (2.857142874366239149e-01 + w * (1.818357216161805012e-01 + w * 1.479819860511658591e-01))
    )
    R = t1 + t2
    half = 0.5 * f * f
    dk = float(k)
    value = dk * _LN2_HIGH - ((half - (s * (half + R) + dk * _LN2_LOW)) - f)
    return select((x > 0.0) & (x < np.inf), value, np.nan)


@_inline
def log1p_ratio(x: float) -> tuple[float, float]:
    """log1p(x)/x for x > −1 (1 for x = 0), and its derivative −∫₀¹τ/(1 + τx)²dτ by three Gauss
    nodes.
    """
    u = 1.0 + x
    # ln(1 + x) = ln u + (x − (u − 1))/u to first order in the rounding of u = 1 + x; if u = 1, this
    # is x.
    correction = (x - (u - 1.0)) / u
    safe = select(x == 0.0, 1.0, x)
    value = select(x == 0.0, 1.0, (logarithm(u) + correction) / safe)
    a = 1.0 + 0.1127016653792583 * x
    b = 1.0 + 0.5 * x
    c = 1.0 + 0.8872983346207417 * x
    slope = -(
        (0.2777777777777778 * 0.1127016653792583) / (a * a)
        + (0.4444444444444444 * 0.5) / (b * b)
        + (0.2777777777777778 * 0.8872983346207417) / (c * c)
    )
    return value, slope


@_inline
def expm1_ratio(x: float) -> tuple[float, float]:
    """expm1(x)/x (1 for x = 0) and its derivative, which has few digits for small x,
    enough for Newton's matrix.
    """
    flat = abs(x) < 1e-3
    safe = select(x == 0.0, 1.0, x)
    value = select(x == 0.0, 1.0, math.expm1(x) / safe)
    slope = select(flat, 0.5 + x * (1.0 / 3.0 + 0.125 * x), (1.0 + x * value - value) / safe)
    return value, slope
