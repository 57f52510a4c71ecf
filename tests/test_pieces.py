"""Pieces of straight-line code mean what they say: the lines by Python, and by LLVM's instructions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

pytest.importorskip("numba")
from numba import njit

from sepv.simulate._engine.functions import fma, logarithm, not_, select, sincos
from sepv.simulate._engine.pieces import lane_piece, loaded, state_piece

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


def test_a_piece_of_a_state_fills_its_arrays() -> None:
    lines = ["x0 = x[0]", "A[1, 0] = x0 * v[1]", "A[0, 1] = -x0", "b[1] = p0 + x[1]", "found += 5"]
    piece, parameters = state_piece(lines, {"PARAMETERS": PARAMETERS}), loaded(2)

    @njit(error_model="numpy")
    def at(x: Any, v: Any, A: Any, b: Any, P: Any) -> int:
        return piece(x, v, A, b, parameters(P))

    A, b = np.zeros((2, 2)), np.zeros(2)
    assert at(np.array([2.0, 3.0]), np.array([0.0, 0.5]), A, b, np.array([0.0, 10.0])) == 5
    assert A.tolist() == [[0.0, -2.0], [1.0, 0.0]]
    assert b.tolist() == [0.0, 13.0]


@pytest.mark.parametrize(
    "line", ["a = x[0] @ x[1]", "a = [1.0]", "a = x[0] if x[1] else 0.0", "for i in x: pass"]
)
def test_what_no_instruction_stands_for_is_refused(line: str) -> None:
    piece = state_piece([line], {"PARAMETERS": ()})

    @njit
    def at(x: Any, A: Any) -> int:
        return piece(x, x, A, x, ())

    with pytest.raises((AssertionError, KeyError)):
        at(np.ones(2), np.ones((2, 2)))
