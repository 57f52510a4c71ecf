"""Polynomials as data: evaluated exactly as written, and kept to the bit by JSON."""

import pickle
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sepv.law.strategies import polynomials
from sepv.record import Polynomial, PolynomialMap
from sepv.record import _polynomial as poly
from sepv.record import _polynomial_map as evaluation


def exactly(p: Polynomial, y: list[float]) -> Fraction:
    total = Fraction(0)
    for exponents, coefficient in p.terms:
        term = Fraction(coefficient)
        for component, exponent in zip(y, exponents, strict=True):
            term *= Fraction(component) ** exponent
        total += term
    return total


cases = st.integers(1, 5).flatmap(
    lambda d: st.tuples(polynomials(d, 6), st.lists(st.floats(-2, 2), min_size=d, max_size=d))
)


@given(cases)
def test_value_is_the_exact_sum_to_rounding_of_its_terms(case: tuple[Polynomial, list[float]]) -> None:
    p, y = case
    value, size = PolynomialMap((), (p,))(np.array(y)), PolynomialMap((), (p,)).majorant(np.array(y))
    # A term takes at most 6 products, the sum at most 5 additions: 12 roundings of the majorant.
    allowed = 12 * Fraction(2) ** -53 * Fraction(float(size)) + Fraction(2) ** -1070
    assert abs(Fraction(float(value)) - exactly(p, y)) <= allowed


@given(cases, st.integers(0, 4))
def test_derivative_is_the_limit_of_exact_quotients(case: tuple[Polynomial, list[float]], k: int) -> None:
    p, y = case
    k %= p.dimension
    derivative = exactly(poly.differentiate(p, k), y)
    # Exact rational differences: the quotient differs from the derivative by O(step).
    for step in (Fraction(1, 2**40), Fraction(1, 2**60)):
        moved = [Fraction(v) + (step if i == k else 0) for i, v in enumerate(y)]
        quotient = (exactly(p, moved) - exactly(p, [Fraction(v) for v in y])) / step
        assert abs(quotient - derivative) <= 10_000 * step


@pytest.mark.parametrize("few", [0, evaluation.ONE_REDUCTION_MAX_SIZE])
@pytest.mark.parametrize("rows", [1, 3])
def test_long_sums_run_strictly_in_order(monkeypatch: pytest.MonkeyPatch, rows: int, few: int) -> None:
    """NumPy sums a column of eight and more numbers in pairs:
    other bits than those of the same state in a batch.
    """
    monkeypatch.setattr(evaluation, "ONE_REDUCTION_MAX_SIZE", few)
    rng = np.random.default_rng(0)
    long = poly.polynomial(2, {(i, j): rng.normal() for i in range(7) for j in range(7)})
    f = PolynomialMap((rows,), (long, poly.constant(2, 1.0), long)[:rows])
    y = rng.normal(size=(2, 9))
    powers = np.stack([y**0, y, y * y])
    for _ in range(4):
        powers = np.concatenate([powers, (powers[-1] * y)[None]])
    total = np.zeros(9)
    for (i, j), c in sorted(long.terms):
        total += c * (powers[i, 0] * powers[j, 1])
    assert np.array_equal(f(y)[0], total)
    assert np.array_equal(np.stack([f(column) for column in y.T], axis=1), f(y))


@given(st.lists(cases, min_size=1, max_size=4), st.integers(0, 4))
def test_a_state_asked_for_often_keeps_every_bit(
    drawn: list[tuple[Polynomial, list[float]]], far: int
) -> None:
    """Python's numbers make the operations of NumPy's arrays, in their order, also where terms
    underflow; what overflows is left to NumPy, which warns.
    """
    d = drawn[0][0].dimension
    rows = [p for p, _ in drawn if p.dimension == d] * 2
    values, state = PolynomialMap((len(rows),), tuple(rows)), np.array(drawn[0][1])
    states = np.stack([state, -state, state * 10.0 ** (-80 * far), 0.0 * -state, np.full(d, 1e200)], axis=1)
    with np.errstate(all="ignore"):
        batch, scales = values(states), values.majorant(states)
        for y, expected, scale in zip(states.T, batch.T, scales.T, strict=True):
            one = [(values(y), values.majorant(y)) for _ in range(evaluation.COMPILED_FROM_USE)][-1]
            assert [v.tobytes() for v in one] == [
                np.ascontiguousarray(v).tobytes() for v in (expected, scale)
            ]
    again = pickle.loads(pickle.dumps(values))
    assert again(state).tobytes() == values(state).tobytes()


def test_what_overflows_warns_also_when_asked_for_often() -> None:
    values = PolynomialMap((1,), (poly.polynomial(1, {(4,): 1.0}),))
    for _ in range(2 * evaluation.COMPILED_FROM_USE):
        assert values(np.array([3.0])) == [81.0]
    with pytest.warns(RuntimeWarning, match="overflow"):
        assert values(np.array([1e100])) == [np.inf]


def test_algebra_agrees_with_hand_calculation() -> None:
    x, y = poly.variable(2, 0), poly.variable(2, 1)
    product = poly.multiply(poly.add(x, y), poly.add(x, poly.scale(-1.0, y)))
    assert product == poly.polynomial(2, {(2, 0): 1.0, (0, 2): -1.0})
    assert str(product) == "y1^2 - y2^2"


def test_degrees_and_the_order_of_terms() -> None:
    p = poly.polynomial(2, {(2, 1): 4.0, (0, 1): 1.0, (1, 0): 2.0})
    assert p.degree == 3
    assert [e for e, _ in p.terms] == [(1, 0), (0, 1), (2, 1)]
    assert poly.polynomial(2, {}).degree == poly.constant(2, 3.0).degree == 0
    # Within a degree the first variable first.
    unit = [tuple(int(i == j) for i in range(4)) for j in range(4)]
    assert [e for e, _ in poly.polynomial(4, dict.fromkeys(unit[::-1], 1.0)).terms] == unit
    assert poly.polynomial(0, {(): 2.0}).terms == (((), 2.0),)
    assert poly.polynomial(1, {(poly.MAX_DEGREE,): 1.0}).degree == poly.MAX_DEGREE


def test_constants_and_zero_are_what_they_say_also_far_out() -> None:
    y = np.array([[1.0, -2.0, np.inf], [0.5, 3.0, 0.0]])
    assert PolynomialMap((), (poly.constant(2, 3.0),))(y).tolist() == [3.0, 3.0, 3.0]
    assert PolynomialMap((), (poly.polynomial(2, {}),))(y).tolist() == [0.0, 0.0, 0.0]
    rows = PolynomialMap((2,), (poly.variable(2, 1), poly.constant(2, 2.0)))
    assert rows(y).tolist() == [[0.5, 3.0, 0.0], [2.0, 2.0, 2.0]]


def test_polynomials_print_as_they_are_written() -> None:
    p = poly.polynomial(3, {(0, 0, 0): 2.5, (1, 0, 0): -1.0, (0, 1, 1): 3.0, (2, 0, 0): 1.0, (0, 0, 2): -0.5})
    assert str(p) == "2.5 - y1 + y1^2 + 3.0 y2 y3 - 0.5 y3^2"
    assert str(poly.polynomial(3, {})) == "0"
