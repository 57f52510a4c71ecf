"""Laws about one step meet every decade of h; a right scheme may have lengths of its own."""

import math
from dataclasses import replace

import numpy as np
import pytest
from sepv.properties import test_truncation as truncation
from sepv.properties._orders import any_step
from sepv.properties._orders.local_errors import cases, two_noises

from sepv import schemes
from sepv.problem import Array, Problem
from sepv.schemes import energy_preserving
from sepv.schemes._scheme import Step
from sepv.verification import Effort, Verdict, verify

right = energy_preserving.step


def verdict(step: Step, law: str, seed: int = 0, **changes: object) -> Verdict:
    scheme = replace(energy_preserving, step=step, solve=None, **changes)
    return verify(scheme, laws=[law], effort=Effort(seed=seed)).findings[0].verdict


def in_window(low: float, high: float, wrong: Step) -> Step:
    return lambda p, y, h, dW: (wrong if low < h < high else right)(p, y, h, dW)


def euler(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    B, g = problem.structure(y), problem.gradient(y)
    return np.asarray(y + problem.random_step(h, dW) * np.einsum("ij...,j...->i...", B, g))


def clipped(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    bound = math.sqrt(2 * h * abs(math.log(h)))
    return right(problem, y, h, np.clip(dW, -bound, bound))


@pytest.mark.parametrize("decade", range(-10, -1))
def test_no_decade_is_left_out(decade: int) -> None:
    low, high = 10.0**decade, 10.0 ** (decade + 1)
    assert verdict(in_window(low, high, clipped), "truncation") is Verdict.VIOLATED
    if -9 <= decade < -1:  # below, the error of a step of order one is no more than 1e-9
        assert verdict(in_window(low, high, euler), "local-mean-square") is Verdict.VIOLATED


def test_a_step_that_explodes_in_a_window_is_seen() -> None:
    far = in_window(1e-4, 1e-3, lambda p, y, h, dW: right(p, y, h, dW) + 1e60)
    assert verdict(far, "local-mean-square") is Verdict.VIOLATED


def divided(length: float) -> Step:
    """(2.1) in equal parts that are no longer than a length in seconds: errors fall with a slope of ½ above it."""

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        parts = min(64, math.ceil(h / length))
        for _ in range(parts):
            y = right(problem, y, h / parts, dW / parts)
        return y

    return step


def hybrid(short: Step, length: float) -> Step:
    return lambda p, y, h, dW: (short if h < length else right)(p, y, h, dW)


RIGHT: dict[str, Step] = {
    "parts of 0.01": divided(0.01),
    "parts of 1e-5": divided(1e-5),
    "Euler-Heun below 0.001": hybrid(schemes.euler_heun.step, 1e-3),
    "Euler-Heun above 1e-5": lambda p, y, h, dW: (schemes.euler_heun.step if h > 1e-5 else right)(
        p, y, h, dW
    ),
    "order 8 below 0.001": hybrid(schemes.explicit(8).step, 1e-3),
    "order 8": schemes.explicit(8).step,
}


@pytest.mark.parametrize("name", RIGHT)
@pytest.mark.parametrize("seed", range(3))
def test_right_schemes_with_lengths_of_their_own_hold(name: str, seed: int) -> None:
    """Their errors have other constants below and above some h, or a low slope where they are small."""
    for law in ("truncation", "local-mean-square"):
        assert verdict(RIGHT[name], law, seed) is Verdict.HOLDS


def test_one_scheme_has_one_constant_in_every_unit_of_time() -> None:
    """With the same u = νh and noise the numbers are the same, whatever h is; so are the errors."""
    found = list(any_step._pairs(energy_preserving, two_noises(), 0))
    for louder in any_step.LOUDER:
        long = [pair for pair in found if pair.louder == louder and pair.unit < 1]
        errors = np.array([pair.errors for pair in long])
        assert len(long) >= 2
        assert np.ptp(np.log(errors), axis=0) == pytest.approx(0, abs=1e-3)


def test_a_larger_noise_allows_each_term_its_growth() -> None:
    one, loud = (
        any_step.Pair(two_noises(), 2.0**-12, 1.0, louder, np.ones(2), 0.0) for louder in (1.0, 16.0)
    )
    assert loud.growth(one, 1.0) == 16**3
    assert one.growth(loud, 1.0) == 1
    assert replace(one, h=2.0**-8).growth(one, 1.0) == 4**3


def test_steps_of_the_response_are_small_beside_the_slope() -> None:
    rng = np.random.default_rng(0)
    for problem in cases(energy_preserving.systems):
        for posed, h, A in truncation._steps(energy_preserving, problem, 0, 2, rng.random(40)):
            slope = truncation.rates_at(posed, np.array(posed.initial))[1]
            assert slope * (h + posed.c[0] * math.sqrt(h) * A) <= truncation.REACH * (1 + 1e-9)


def test_a_loose_solver_says_so_and_is_not_accused() -> None:
    def loose(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        return right(problem, y, h, dW) * (1 + 1e-9)

    assert verdict(loose, "local-mean-square", solver_tolerance=2e-9) is Verdict.HOLDS
