"""Records: value, derivative and mean of random expressions against mpmath,
and what cannot be recorded.
"""

import operator

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sepv import problems
from sepv.core.arrays import matvec
from sepv.record import CannotRecord, NoClosedForm, Tape, degree, evaluator, gradient, jacobian, mean
from sepv.record._derivative import reachable
from sepv.record._functions import FUNCTIONS
from sepv.record._replay import replay

EPS = 2.0**-52
MP = mpmath.mp.clone()
MP.dps = 40
EXACT = {
    "sinc": MP.sinc,
    "sinc_slope": lambda x: (MP.cos(x) - MP.sinc(x)) / x if x else MP.mpf(0),
    "log1p_ratio": lambda x: MP.log1p(x) / x if x else MP.mpf(1),
    "log1p_ratio_slope": lambda x: (1 / (1 + x) - MP.log1p(x) / x) / x if x else MP.mpf(-0.5),
    "expm1_ratio": lambda x: MP.expm1(x) / x if x else MP.mpf(1),
    "expm1_ratio_slope": lambda x: (MP.exp(x) - MP.expm1(x) / x) / x if x else MP.mpf(0.5),
    "arctan": MP.atan,
    "log": MP.ln,
}


def exactly(name, x):
    return EXACT[name](x) if name in EXACT else getattr(MP, name)(x)


def at(outputs, inputs, y):
    """The outputs by mpmath, with 40 digits."""
    values = {x.index: MP.mpf(v) for x, v in zip(inputs, y, strict=True)}
    return replay(outputs, values, exactly, MP.mpf, lambda x, a: MP.power(x, MP.mpf(a)))


# Functions with values and slopes of a moderate size at arguments of a moderate size.
UNARY = (
    np.sin, np.cos, np.arctan, np.tanh, np.negative, lambda x: np.exp(0.25 * np.sin(x)),
    lambda x: np.log(2 + np.cos(x)), lambda x: np.sqrt(1 + x * x), lambda x: 1 / (1 + x**2),
    lambda x: (2 + np.sin(x)) ** -1.5,
)  # fmt: skip
BINARY = (operator.add, operator.sub, operator.mul, lambda a, b: a / (2 + b * b))
CONSTANTS = st.sampled_from([0.0, 1.0, -1.0, 0.5, -2.0, 3.25, 0.1])


@st.composite
def expressions(draw):
    """A function of two numbers, of both kinds: symbols and float64."""
    leaf = st.one_of(st.sampled_from(["x", "y"]), CONSTANTS)

    def nodes(below):
        of_two = st.tuples(st.sampled_from(BINARY), below, below)
        return st.one_of(st.tuples(st.sampled_from(UNARY), below), of_two)

    tree = draw(st.recursive(leaf, nodes, max_leaves=8))

    def evaluate(tree, y):
        if isinstance(tree, str):
            return y[0] if tree == "x" else y[1]
        if isinstance(tree, float):
            return tree
        return tree[0](*(evaluate(part, y) for part in tree[1:]))

    return lambda y: evaluate(tree, y)


STATES = st.tuples(*[st.floats(-2, 2).map(lambda v: round(v, 6))] * 2)


@given(expressions(), STATES)
@settings(max_examples=60)
def test_values_and_both_derivatives_are_those_of_the_function(function, state) -> None:
    tape = Tape()
    y = tape.vector(2)
    f = tape.symbol(function(y))
    forward, backward = jacobian([f], y)[0], gradient(f, y)
    with np.errstate(all="ignore"):
        plain = float(function(np.array(state)))
    # Eight leaves make at most some sixty operations; folding constants rounds as well.
    sizes = [abs(v) for v in at(reachable([f, *forward]), y, state)]
    bound = 200 * EPS * float(max([*sizes, 1])) ** 2
    assert abs(float(at([f], y, state)[0]) - plain) <= bound
    ran = evaluator([y], np.array([f, *forward, *backward], dtype=object))(np.array(state)[:, None])[:, 0]
    exact = [float(v) for v in at([f, *forward, *backward], y, state)]
    assert np.allclose(exact[1:3], exact[3:], rtol=1e-13, atol=bound)
    assert np.allclose(ran, exact, rtol=0, atol=bound)
    with MP.workdps(60):
        for k, x in enumerate(y):
            h = MP.mpf(10) ** -20
            ends = [
                replay([f], {v.index: MP.mpf(s) + (sign * h if v is x else 0) for v, s in zip(y, state, strict=True)},
                       exactly, MP.mpf, lambda b, a: MP.power(b, MP.mpf(a)))[0]
                for sign in (1, -1)
            ]  # fmt: skip
            assert abs((ends[0] - ends[1]) / (2 * h) - at([forward[k]], y, state)[0]) <= bound


@pytest.mark.parametrize("name", FUNCTIONS)
def test_elementary_functions_and_their_slopes(name) -> None:
    x = np.concatenate([[0.0], *(s * np.geomspace(1e-9, 0.9, 60) for s in (-1, 1))])
    x = x if name not in ("log", "sqrt") else np.abs(x) + 0.5
    for v, got in zip(x, np.asarray(FUNCTIONS[name].value(x)), strict=True):
        exact = exactly(name, MP.mpf(v))
        # A slope's quotient cancels to a twentieth of its terms at most: see the bounds of the
        # series.
        assert abs(got - exact) <= 64 * EPS * max(abs(exact), 2.0**-3 if "slope" in name else 0)
    if FUNCTIONS[name].slope is not None:
        tape = Tape()
        y = tape.vector(1)
        (slope,) = jacobian([y[0].apply(name)], y)[0]
        for v in x[1::7]:
            with MP.workdps(50):
                exact = MP.diff(lambda t: exactly(name, t), MP.mpf(v))
                assert abs(at([slope], y, [v])[0] - exact) < 1e-20


TERMS = {
    "sin": np.sin, "cos": np.cos, "exp": np.exp, "log": np.log, "reciprocal": lambda x: 1 / x, "root": np.sqrt,
    "power": lambda x: x**1.7, "inverse power": lambda x: x**-2.5, "sinh": np.sinh, "cosh": np.cosh,
}  # fmt: skip


@pytest.mark.parametrize("name", TERMS)
@pytest.mark.parametrize("size", [0.0, 1e-300, 1e-9, 1e-3, 0.7, -0.9])
def test_means_of_affine_arguments_lose_nothing(name, size) -> None:
    """For every length of the segment the mean is that of 40 digits to a few roundings."""
    tape = Tape()
    y, z = tape.vector(2), tape.vector(2)
    H = 0.5 * y[0] ** 2 + 3 * TERMS[name](0.5 * y[0] - 0.25 * y[1] + 2) - 2 * TERMS[name](y[1])
    average = mean(H, y, z).value
    start, move = [0.8, 1.3], [size, -0.3 * size]
    got = evaluator([y, z], average)(np.array(start)[:, None], np.array(move)[:, None])[:, 0]
    slope = gradient(H, y)
    along = lambda tau: [a + tau * b for a, b in zip(start, move, strict=True)]  # noqa: E731
    for i in range(2):
        exact = MP.quad(lambda tau, i=i: at([slope[i]], y, along(tau))[0], [0, 1])
        # The terms of the sum, at most about 10, are rounded some ten times; the condition of the
        # arguments is below 8.
        assert abs(got[i] - exact) <= 80 * EPS * 10


def test_the_degree_of_a_polynomial_is_found_and_its_mean_exact() -> None:
    tape = Tape()
    y, z = tape.vector(2), tape.vector(2)
    H = (y[0] + y[1]) ** 3 * y[1] ** 2 / 7 - y[0]
    assert degree(H, y) == 5
    assert degree(np.sin(y[0]), y) is None
    assert degree(y[0] / (2 + np.cos(z[0])), y) == 1
    got = evaluator([y, z], mean(H, y, z).value)(np.array([[0.3], [0.7]]), np.array([[0.5], [-0.2]]))[:, 0]
    slope = lambda t, i: at([gradient(H, y)[i]], y, [0.3 + 0.5 * t, 0.7 - 0.2 * t])[0]  # noqa: E731
    exact = [float(MP.quad(lambda t, i=i: slope(t, i), [0, 1])) for i in range(2)]
    assert np.allclose(got, exact, rtol=1e-14)


def test_what_has_no_closed_mean_is_refused_and_says_why() -> None:
    tape = Tape()
    y, z = tape.vector(2), tape.vector(2)
    none = (np.sin(y[0] * y[1]), "not affine"), (np.tanh(y[0]), "no rule"), (y[0] * np.exp(y[1]), "no rule")
    for H, why in none:
        with pytest.raises(NoClosedForm, match=why):
            mean(H, y, z)


def test_a_record_of_the_scheme_is_as_short_as_by_hand() -> None:
    """R and K of (2.1) for the rigid body: 41 operations where the kernel written by hand has 41 an
    iteration.
    """
    problem, tape = problems.rigid_body(), Tape()
    y, z, delta = tape.vector(3), tape.vector(3), tape.vector(1)
    B = tape.symbols(problem.structure(y + 0.5 * z))
    R = delta[0] * matvec(B, mean(problem.hamiltonian(y), y, z).value)
    lines = reachable([*R, *jacobian(R, z).ravel()])
    assert sum(s.line.name not in ("input", "constant") for s in lines) <= 41


def test_choices_and_conditions_are_recorded() -> None:
    def function(y):
        inside = np.where(y[0] > y[1], y[0] * y[1], np.maximum(y[0], 0.25) - abs(y[1]))
        return np.stack([inside, np.where(y[0] > 0, y[1], -y[1])])

    tape = Tape()
    y = tape.vector(2)
    f = tape.symbols(function(y))
    state = np.random.default_rng(1).normal(size=(2, 40))
    assert np.array_equal(evaluator([y], f)(state), function(state))
    inside = np.all(y > 0, axis=0) | (y[0] == y[1])
    assert np.array_equal(evaluator([y], np.array([inside]))(state)[0], np.all(state > 0, axis=0))
    K = evaluator([y], jacobian(f, y))(state)
    assert np.array_equal(K[1, 1], np.sign(state[0]))


@pytest.mark.parametrize("axis", [{}, {"axis": 0}, {"axis": 1}, {"axis": -1}], ids=str)
def test_extremes_are_recorded_along_any_axis(axis: dict[str, int]) -> None:
    def function(y):
        table = np.reshape(y, (2, 3))
        return np.atleast_1d(np.max(table, **axis) + np.min(table, *axis.values()))

    tape = Tape()
    y = tape.vector(6)
    state = np.array([0.3, -0.7, 1.1, 2.0, 0.5, -1.5])
    assert np.array_equal(evaluator([y], np.array(function(y)))(state), function(state))


def test_functions_that_move_elements_about_are_recorded() -> None:
    def function(y):
        a = np.cross(y, np.roll(y, 1)) + np.zeros_like(y) + y[::-1]
        a += np.concatenate([y[1:], y[:1]])
        return np.array([[1.0, 2.0, 0.0], [0.0, -1.0, 0.5]]) @ a + np.sum(y * y, axis=0) + np.dot(y, y)

    tape = Tape()
    y = tape.vector(3)
    state = np.array([0.3, -0.7, 1.1])
    assert np.allclose(evaluator([y], tape.symbols(function(y)))(state), function(state), rtol=16 * EPS)


@pytest.mark.parametrize(
    ("function", "why"),
    [
        (lambda y: y[0] if y[0] > 0 else y[1], "branches on a value"),
        (lambda y: float(y[0]), "wants the value"),
        (np.floor, "np.floor"),
        (lambda y: np.asarray(y, dtype=np.float64), "wants the value"),
        (lambda y: y[0] / 0.0, "divides by the constant 0"),
        (lambda y: y[0] ** y[1], "exponent"),
        (lambda y: y[0] * np.nan, "NaN"),
    ],
)
def test_what_cannot_be_recorded_says_why(function, why) -> None:
    with pytest.raises(CannotRecord, match=why):
        function(Tape().vector(2))


def test_symbols_of_two_records_do_not_mix() -> None:
    with pytest.raises(CannotRecord, match="two records"):
        Tape().vector(1) + Tape().vector(1)
