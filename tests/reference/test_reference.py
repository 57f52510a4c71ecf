"""The references: exact invariants, independence of precision, and formulas written out in another way."""

from functools import partial

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from sepv.reference.arithmetic import context
from sepv.reference.elliptic import closed_form
from sepv.reference.flow import taylor
from sepv.reference.problem import exact_problem
from sepv.reference.steps import reference_step

from sepv import problems
from sepv.errors import UsageError
from sepv.verification import Case, strategies

energy_preserving = partial(reference_step, "energy-preserving")
midpoint = partial(reference_step, "midpoint")


@settings(max_examples=40)
@given(strategies.any_steps())
def test_the_reference_keeps_energy_and_casimirs_to_its_digits(case: Case) -> None:
    exact = exact_problem(case.problem, 65)
    y0, y1 = exact.state(case.y), energy_preserving(case.problem, case.y, case.h, case.dW).y1
    scale = 1 + abs(exact.hamiltonian(y0)) + max(abs(v) for v in exact.gradient(y0))
    assert abs(exact.hamiltonian(y1) - exact.hamiltonian(y0)) < 1e-45 * scale
    for before, after in zip(exact.casimir_values(y0), exact.casimir_values(y1), strict=True):
        assert abs(after - before) < 1e-45 * (1 + abs(before))


@settings(max_examples=30)
@given(strategies.any_steps())
def test_thirty_digits_agree_with_sixty(case: Case) -> None:
    for solve in (energy_preserving, midpoint):
        coarse, fine = (solve(case.problem, case.y, case.h, case.dW, digits) for digits in (30, 60))
        for a, b in zip(coarse.y1, fine.y1, strict=True):
            assert abs(b - a) < 1e-29 * (1 + abs(b))


SIZES = (5e-324, 1e-310, 1e-200, 1e-100, 1e100, 1e200, 1e300)


@pytest.mark.parametrize("y", [(0.2, 0.1), *((size, 0.0) for size in SIZES)])
def test_oscillator_is_the_printed_formula_to_fifty_digits(y: tuple[float, float]) -> None:
    data, ctx = problems.harmonic_oscillator().data, context(60)
    (p, x), delta = map(ctx.mpf, y), ctx.mpf(0.5) + ctx.mpf(0.25)
    q = 1 + delta**2 / 4
    expected = [(-delta * x + (1 - delta**2 / 4) * p) / q, ((1 - delta**2 / 4) * x + delta * p) / q]
    for solve in (energy_preserving, midpoint):
        for a, b in zip(solve(data, y, 0.5, [0.25]).y1, expected, strict=True):
            assert abs(a - b) <= abs(b) * ctx.mpf(10) ** -50


@pytest.mark.parametrize("stages", range(1, 7))
def test_collocation_is_gauss_for_quadratic_h_and_the_scheme_for_one_stage(stages: int) -> None:
    body, y, h, dW = problems.rigid_body().data, (0.8, 0.6, 0.0), 0.25, (0.125,)
    both = [reference_step(f"{name}-{stages}", body, y, h, dW).y1 for name in ("collocation", "gauss")]
    assert max(abs(a - b) for a, b in zip(*both, strict=True)) < 1e-50
    for name in ("pendulum", "lotka-volterra"):
        problem = problems.by_name(name)
        arguments = (problem.data, tuple(map(float, problem.initial)), 0.05, (0.025,) * problem.noises)
        one, many = (reference_step(n, *arguments).y1 for n in ("energy-preserving", f"collocation-{stages}"))
        flow = taylor(problem.data, arguments[1], 0.05 + 0.025 * float(np.sum(problem.c)), 50)
        if stages == 1:
            assert max(abs(a - b) for a, b in zip(one, many, strict=True)) < 1e-50
        # Order 2s: each further stage brings the step closer to the flow by two orders.
        off = float(max(abs(a - b) for a, b in zip(flow, many, strict=True)))
        assert off < 0.2 * 0.2 ** (2 * stages)


def test_milstein_and_euler_maruyama_are_their_formulas_by_hand() -> None:
    """Oscillator: f′f = −y, so that Milstein is (1 − S²/2)y + Δf and Euler-Maruyama (1 − h/2)y + Δf for c = 1."""
    data, ctx = problems.harmonic_oscillator().data, context(60)
    p, x, h, S = ctx.mpf(0.2), ctx.mpf(0.1), ctx.mpf(0.125), ctx.mpf(0.25)
    for name, factor in (("milstein", 1 - S * S / 2), ("euler-maruyama", 1 - h / 2)):
        y1 = reference_step(name, data, (0.2, 0.1), 0.125, (0.25,)).y1
        assert abs(y1[0] - (factor * p - (h + S) * x)) < 1e-55
        assert abs(y1[1] - (factor * x + (h + S) * p)) < 1e-55


@pytest.mark.parametrize("digits", [0, -1, 10**5, 2.5, True])
def test_absurd_digits_are_refused(digits) -> None:
    data, y = problems.harmonic_oscillator().data, (0.2, 0.1)
    for call, rest in ((energy_preserving, (0.1, (0.0,))), (taylor, (1.0,)), (closed_form, (1.0,))):
        with pytest.raises(UsageError, match="digits, an integer between 1 and 2000"):
            call(data, y, *rest, digits)


def test_no_global_precision_is_touched() -> None:
    before = mpmath.mp.dps
    energy_preserving(problems.pendulum().data, [0.2, 1.0], 0.1, [0.1, 0.1], 80)
    assert mpmath.mp.dps == before
