"""The exact flow three ways: Taylor series, enclosures, closed forms."""

import pytest
from doors import command
from sepv.reference.arithmetic import context, decimal
from sepv.reference.balls import from_mpf, precision
from sepv.reference.elliptic import closed_form
from sepv.reference.flow import FlowNotReached, enclosed, taylor
from sepv.reference.series import Series, series_over

from sepv import problems
from sepv.problem import PolynomialSystem
from sepv.record import _polynomial as poly

PENDULUM, BODY = problems.pendulum().data, problems.rigid_body().data
OSCILLATOR, PREDATORS = problems.harmonic_oscillator().data, problems.lotka_volterra().data

CLOSED = [
    (PENDULUM, (0.2, 1.0), 1.5),
    (PENDULUM, (2.0, 0.0), -1.0),
    (PENDULUM, (-2.5, 7.0), 1.0),
    (PENDULUM, (0.0, 3.141592653589793), 3.0),
    (PENDULUM, (0.0, 0.0), 2.0),
    (BODY, (0.8, 0.6, 0.0), 1.5),
    (BODY, (0.0, 1.0, 1e-8), 3.0),
    (BODY, (-0.9, -0.2, 0.1), -1.0),
    (problems.rigid_body((1.0, 0.345, 0.653)).data, (0.1, 0.2, -0.9), 1.0),
    (problems.rigid_body((0.653, 0.345, 1.0)).data, (0.5, 0.2, -0.4), 1.0),
    (OSCILLATOR, (0.2, 0.1), 8.0),
]


@pytest.mark.parametrize(("data", "y", "theta"), CLOSED)
def test_series_and_closed_forms_agree_to_fifty_digits(data, y, theta) -> None:
    for a, b in zip(taylor(data, y, theta), closed_form(data, y, theta), strict=True):
        assert abs(a - b) < 1e-50


def test_series_lie_in_their_enclosures() -> None:
    pytest.importorskip("flint", reason="the extra certify is not installed")
    for data, y, theta in [*CLOSED[:2], *CLOSED[5:6], (PREDATORS, (1.0, 1.9, 0.5), 0.0625)]:
        balls = enclosed(data, y, theta)
        with precision(500):
            for value, ball in zip(taylor(data, y, theta, 70), balls, strict=True):
                assert abs(from_mpf(value) - ball).upper() < 1e-50
                assert ball.rad() < 1e-49


def test_flows_compose() -> None:
    ctx = context(60)
    middle = taylor(PREDATORS, (1.0, 1.9, 0.5), 0.25, 60)
    rounded = [float(v) for v in middle]
    there = taylor(PREDATORS, rounded, -0.25, 40)
    # The way back from a state rounded to binary64 misses by what the rounding grew to.
    assert max(abs(a - b) for a, b in zip(there, (1.0, 1.9, 0.5), strict=True)) < 1e-14
    assert ctx.dps == 60


def test_series_of_functions_are_their_taylor_series() -> None:
    ctx, arithmetic = context(40), series_over(decimal(40))
    x = Series(ctx.fdot, lambda k: ctx.mpf(k == 1), [ctx.mpf("0.5")])
    for f, g in (
        (arithmetic.sin, ctx.sin),
        (arithmetic.cos, ctx.cos),
        (arithmetic.log, ctx.ln),
        (lambda s: 1 / s, lambda t: 1 / t),
        (lambda s: 3 - s * s / (2 + s), lambda t: 3 - t * t / (2 + t)),
    ):
        for a, b in zip(f(x).upto(12), ctx.taylor(g, ctx.mpf("0.5"), 12), strict=True):
            assert abs(a - b) < 1e-25


def test_a_flow_that_blows_up_says_where() -> None:
    """p′ = −3x², x′ = p with H = p²/2 + x³: from (−1, −1) the solution is gone before θ = 10."""
    H = poly.polynomial(2, [((2, 0), 0.5), ((0, 3), 1.0)])
    cubic = PolynomialSystem(2, H, ((0, 1, poly.constant(2, -1.0)),), (1.0,))
    with pytest.raises(FlowNotReached, match="and no further"):
        taylor(cubic, (-1.0, -1.0), 10.0, 15)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("exact harmonic-oscillator --theta 8 --digits 40 --certify",
         ["y1 = -0.1280358314240608900619970373916446665972\n", "in float64, off by", "y1 in [-0.128"]),
        ("step energy-preserving rigid-body --h 0.1 --dW 0.05 --digits 30 --certify",
         ["y1 = 0.802313691387643825092815834210\n", "ulp", "F has exactly one zero in X"]),
        ("step averaged-vector-field pendulum --h 0.1 --y 0x1p-3,1", ["no float64 result"]),
    ],
)  # fmt: skip
def test_commands_print_digits_beside_float64_and_the_proof(line: str, words: list[str]) -> None:
    shown = command(line).output
    assert not [word for word in words if word not in shown]


def test_a_step_without_a_solution_says_where_its_branch_ends() -> None:
    shown = command("step energy-preserving lotka-volterra --h 2", 3).output
    assert "end at Δ = 1.139191" in shown
    assert "residual" in shown
