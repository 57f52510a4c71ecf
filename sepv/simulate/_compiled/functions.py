"""Sine, cosine and logarithm without branches or calls, so that a loop over lanes becomes SIMD code.

The polynomials are those of fdlibm (k_sin.c, k_cos.c, e_log.c; errors below 1 ulp of their reduced
argument). Imported by generated code alone: this module needs numba, and nothing of sepv, since numba
compiles a function anew where its own file has changed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from sepv._patches import add_attribute

_inline: Any = njit(error_model="numpy", forceinline=True, cache=True, _nrt=False)

# π/2 in three parts of 22, 22 and 53 bits: k·part is exact for |k| < 2³¹.
_PART_1 = float.fromhex("0x1.921fb0p+0")
_PART_2 = float.fromhex("0x1.5110bp-22")
_PART_3 = float.fromhex("0x1.18469898cc517p-44")
_TWO_OVER_PI = 2 / math.pi
# The largest angle; beyond it the result is NaN: the angle's own rounding is 1e-7, and the reduction is not exact.
_LARGEST_ANGLE = 1e9
_TO_INTEGER = 1.5 * 2.0**52  # adding it rounds to the nearest integer
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10


def _emits(instruction: Callable[[Any, Any], Any]) -> Callable[..., Any]:
    """An intrinsic of a single instruction, which the builder emits from the arguments."""
    return lambda context, builder, signature, arguments: instruction(builder, arguments)  # noqa: ARG005 - numba's


@intrinsic
def float_bits(typingctx: Any, x: Any) -> Any:  # noqa: ARG001 - numba's signature
    """The 64 bits of a float64 as an int64."""
    return types.int64(types.float64), _emits(lambda builder, a: builder.bitcast(a[0], ir.IntType(64)))


@intrinsic
def bits_float(typingctx: Any, x: Any) -> Any:  # noqa: ARG001 - numba's signature
    """The float64 with these 64 bits."""
    return types.float64(types.int64), _emits(lambda builder, a: builder.bitcast(a[0], ir.DoubleType()))


@intrinsic
def select(typingctx: Any, condition: Any, a: Any, b: Any) -> Any:  # noqa: ARG001 - numba's signature
    """a where the condition holds, else b, both evaluated: a branch would keep a loop from becoming SIMD code."""
    kind = types.float64 if types.float64 in (a, b) else types.int64
    return kind(types.boolean, kind, kind), _emits(lambda builder, found: builder.select(*found))


@intrinsic
def fma(typingctx: Any, a: Any, b: Any, c: Any) -> Any:  # noqa: ARG001 - numba's signature
    """a·b + c with one rounding, explicitly, so that SIMD and scalar code agree."""
    return types.float64(*[types.float64] * 3), _emits(lambda builder, a: builder.fma(*a))


@intrinsic
def prefer_512_bit(typingctx: Any) -> Any:  # noqa: ARG001 - numba's signature
    """Ask LLVM for registers of 512 bits where there are any; on Intel's it takes 256 by default.

    For loops of pure arithmetic that is 1.4 times slower.
    """

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ARG001 - numba's
        add_attribute(builder.function.attributes, '"prefer-vector-width"="512"')
        return context.get_dummy_value()

    return types.void(), code


@intrinsic
def prefetch(typingctx: Any, array: Any, n: Any, j: Any, k: Any) -> Any:  # noqa: ARG001 - numba's signature
    """Prefetch the cache line of array[n, j, k], which need not exist."""

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        found = make_array(signature.args[0])(context, builder, arguments[0])
        shape = cgutils.unpack_tuple(builder, found.shape, 3)
        row = builder.add(builder.mul(arguments[1], shape[1]), arguments[2])
        place = builder.gep(found.data, [builder.add(builder.mul(row, shape[2]), arguments[3])])
        byte = builder.bitcast(place, ir.IntType(8).as_pointer())
        kinds = [byte.type, *[ir.IntType(32)] * 3]
        function = builder.module.declare_intrinsic(
            "llvm.prefetch", [byte.type], ir.FunctionType(ir.VoidType(), kinds)
        )
        builder.call(function, [byte, *(ir.Constant(ir.IntType(32), v) for v in (0, 3, 1))])
        return context.get_dummy_value()

    return types.void(array, types.int64, types.int64, types.int64), code


@intrinsic
def marked(typingctx: Any, array: Any, first: Any) -> Any:  # noqa: ARG001 - numba's signature
    """One bit for each of 64 bytes of the array from `first` on: 1 where the byte is not 0."""

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        found = make_array(signature.args[0])(context, builder, arguments[0])
        kind = ir.VectorType(ir.IntType(8), 64)
        place = builder.gep(found.data, [arguments[1]], inbounds=True)
        bytes_ = builder.load(builder.bitcast(place, kind.as_pointer()), align=1)
        return builder.bitcast(builder.icmp_signed("!=", bytes_, ir.Constant(kind, None)), ir.IntType(64))

    return types.uint64(array, types.int64), code


@intrinsic
def sfc64(typingctx: Any, a: Any, b: Any, c: Any, counter: Any) -> Any:  # noqa: ARG001 - numba's signature
    """The next 64 bits of the generator SFC64 in the state (a, b, c, counter), followed by its next state."""
    kind = types.UniTuple(types.uint64, 5)

    def code(context: Any, builder: Any, signature: Any, state: Any) -> Any:  # noqa: ARG001 - numba's
        (a, b, c, counter), bits = state, ir.IntType(64)
        out = builder.add(builder.add(a, b), counter)
        turned = builder.or_(builder.shl(c, bits(24)), builder.lshr(c, bits(40)))
        a, b = builder.xor(b, builder.lshr(b, bits(11))), builder.add(c, builder.shl(c, bits(3)))
        following = a, b, builder.add(turned, out), builder.add(counter, bits(1))
        return context.make_tuple(builder, kind, [out, *following])

    return kind(*[types.uint64] * 4), code


@intrinsic
def lowest_bit(typingctx: Any, bits: Any) -> Any:  # noqa: ARG001 - numba's signature
    """The position of the lowest set bit; `bits` must not be 0."""
    return types.int64(types.uint64), _emits(
        lambda builder, a: builder.cttz(a[0], ir.Constant(ir.IntType(1), 1))
    )


@intrinsic
def not_(typingctx: Any, condition: Any) -> Any:  # noqa: ARG001 - numba's signature
    """The negated condition, without a branch."""
    return types.boolean(types.boolean), _emits(lambda builder, a: builder.not_(a[0]))


@_inline
def sine_tail(z: float) -> float:
    """s with sin x = x + x·z·(−1/6 + z·s), z = x², for |x| ≤ π/4."""
    return 8.33333333332248946124e-03 + z * (
        -1.98412698298579493134e-04
        + z
        * (2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10))
    )


@_inline
def sincos(x: float) -> tuple[float, float]:
    """(sin x, cos x), within 1 ulp of 1 for |x| ≤ 1e9, NaN beyond."""
    shifted = x * _TWO_OVER_PI + _TO_INTEGER
    k = shifted - _TO_INTEGER
    quadrant = float_bits(shifted)
    reduced = (x - k * _PART_1) - k * _PART_2
    r = reduced - k * _PART_3
    # The rounding error of r. Omitting it is a bias of a tenth of a rounding for all x of a binade and quadrant.
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
    """sin(x)/x and its derivative, which has a few digits for small x: enough for Newton's Jacobian."""
    sine, cos = sincos(x)
    flat = abs(x) < 1e-3
    safe = select(flat, 1.0, x)
    z = x * x
    s = sine_tail(z)
    # The quotient rounds twice, 0.53·2⁻⁵³ in the root mean square where the series has 0.29·2⁻⁵³.
    value = select(z < 0.6, 1.0 + z * (-1.66666666666666324348e-01 + z * s), sine / safe)
    slope = select(flat, -x * (1.0 / 3.0 - z / 30.0), (cos - value) / safe)
    return value, slope


@_inline
def logarithm(x: float) -> float:
    """ln x for normal x > 0, within 1 ulp; NaN for x ≤ 0 and for x not finite."""
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
    """log1p(x)/x for x > −1, 1 at 0, and its derivative −∫₀¹τ/(1 + τx)²dτ by three Gauss nodes."""
    u = 1.0 + x
    # ln(1 + x) = ln u + (x − (u − 1))/u to first order in the rounding of u; where u = 1 it is x.
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
    """expm1(x)/x, 1 at 0, and its derivative, which has a few digits for small x: enough for Newton's Jacobian."""
    flat = abs(x) < 1e-3
    safe = select(x == 0.0, 1.0, x)
    value = select(x == 0.0, 1.0, math.expm1(x) / safe)
    slope = select(flat, 0.5 + x * (1.0 / 3.0 + 0.125 * x), (1.0 + x * value - value) / safe)
    return value, slope
