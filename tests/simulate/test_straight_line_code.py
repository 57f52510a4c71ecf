"""Pieces of straight-line code mean what they say: the lines by Python, and by LLVM's instructions."""

import math
from typing import Any

import numpy as np
import pytest

pytest.importorskip("numba")
from numba import njit

from sepv.simulate._compiled.functions import fma, logarithm, not_, select, sincos
from sepv.simulate._compiled.llvm import lane_piece, loaded

L, PARAMETERS, NAN, HALF = 4, ("c0", "p0"), math.nan, 0.5
LINES = [
    "u = buffer[n, 1, k]",
    "y = S[0 + k]",
    "a = fma(c0, u, -y) * p0 - 2.0 / y",
    "b = select((a > 0.0) & not_(u <= y) | (y == HALF), a, NAN)",
    "t = sincos(u)",
    "r = t[0] + t[1] ** 3.0 + logarithm(abs(a)) + (h - bound) * 2 + n",
    "S[4 + k] = b",
    "S[8 + k] = r",
    "I[k] = select(r != r, 7, -first)",
    "total += select(I[k] < 0, 1, 0)",
    "total += k",
]


def by_python(S: np.ndarray, I: np.ndarray, buffer: np.ndarray, n: int, k: int, q: tuple[float, ...]) -> int:
    """The same lines."""
    names: dict[str, Any] = {
        "S": S, "I": I, "buffer": buffer, "n": n, "k": k, "first": 3, "h": 0.25, "bound": 0.125, "HALF": HALF,
        "NAN": NAN, "c0": q[0], "p0": q[1], "total": 0, "abs": abs, "not_": lambda v: not v,
        "fma": lambda a, b, c: float(np.longdouble(a) * np.longdouble(b) + np.longdouble(c)),
        "select": lambda c, a, b: a if c else b, "logarithm": lambda x: float(np.log(x)),
        "sincos": lambda x: (math.sin(x), math.cos(x)),
    }  # fmt: skip
    exec("\n".join(LINES), names)
    return int(names["total"])


def test_the_lines_of_a_lane_are_its_instructions() -> None:
    known = {"PARAMETERS": PARAMETERS, "NAN": NAN, "HALF": HALF}
    known |= {"fma": fma, "not_": not_, "select": select, "sincos": sincos, "logarithm": logarithm}
    piece, parameters = lane_piece(LINES, "total", known), loaded(2)

    @njit(error_model="numpy")
    def all_lanes(S: Any, I: Any, buffer: Any, P: Any) -> int:
        q = parameters(P)
        total = 0
        for k in range(L):
            total += piece(S, I, buffer, 1, k, 3, 0.25, 0.125, q)
        return total

    rng = np.random.default_rng(0)
    buffer, P = rng.standard_normal((2, 3, L)), np.array([1.5, -0.75])
    S, I = rng.standard_normal(3 * L), np.zeros(L, dtype=np.int64)
    S[2] = HALF
    mine, counts = S.copy(), I.copy()
    expected = sum(by_python(mine, counts, buffer, 1, k, tuple(P)) for k in range(L))
    assert all_lanes(S, I, buffer, P) == expected
    assert np.array_equal(I, counts)
    # Functions of lanes are right to an ulp, and sums of three of them lose no more than a few.
    assert np.allclose(S, mine, rtol=1e-14, atol=1e-14, equal_nan=True)
    assert np.isnan(mine).any()
    assert not np.isnan(mine).all()
