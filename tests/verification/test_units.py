"""No verdict depends on the unit of time or of length, on how strong the noise is, or on the clip of the suite."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from doors import verdicts

from benchmarks.right_schemes.other_formulas import flow
from benchmarks.right_schemes.solved_otherwise import of_lanes
from benchmarks.units import LAWS, PROBLEMS, SCALES, Scale, findings, scaled, wrong
from sepv import problems, schemes, verify
from sepv.problem import Array, Problem
from sepv.schemes import Scheme
from sepv.simulate import truncate
from sepv.verification import Effort, Verdict
from sepv.verification._units import Units, units_of

QUICK = Effort(paths=2048)
FAST = ("truncation", "right-limit")


@pytest.mark.parametrize("name", ["harmonic-oscillator", "quartic-top", "double-well", "kepler"])
def test_the_units_of_a_problem_change_with_it(name: str) -> None:
    problem = PROBLEMS[name]()
    own, other = units_of(problem), units_of(scaled(problem, Scale(4.0**9, 2.0**-9, 2.0**-12)))
    assert other == Units(own.time / 4**9, own.length / 2**12)


def test_a_problem_at_the_origin_or_at_rest_has_units() -> None:
    start = PROBLEMS["quartic"]()
    moved = replace(start, initial=(0.0, 0.0), data=None, check=False)
    assert units_of(moved).length == 1.0
    assert 0 < units_of(moved).time < np.inf


@pytest.mark.parametrize("name", ["quartic", "quartic-top"])
def test_verdicts_are_the_same_in_every_unit(name: str) -> None:
    """Powers of two change no digit of a state: what differs is the rounding of the exact flow."""
    problem = PROBLEMS[name]()
    few = Effort(paths=512)
    usual = findings(schemes.energy_preserving, scaled(problem, Scale()), few)
    for scale in (Scale(4.0**-8, 2.0**8, 2.0**-18), Scale(4.0**9, 2.0**-9, 2.0**10)):
        other = findings(schemes.energy_preserving, scaled(problem, scale), few)
        for a, b in zip(usual, other, strict=True):
            assert (a.verdict, a.checks) == (b.verdict, b.checks), b
            # Slopes of one step end where errors are some roundings; "rounding" sees nothing else.
            near = 1.0 if a.law == "rounding" else 1e-2 if a.law.startswith("local") else 1e-6
            assert a.defect == pytest.approx(b.defect, rel=near), b


@pytest.mark.parametrize("rate", [1e-4, 80.0, 1e5])
@pytest.mark.parametrize("name", ["energy-preserving", "euler-heun"])
def test_a_fast_oscillator_with_unit_noise_accuses_nobody(name: str, rate: float) -> None:
    """H = ½ω|y|²: steps that are not the problem's own called (2.1) violated from ω = 80 on."""
    oscillator = scaled(problems.harmonic_oscillator(), Scale(rate))
    found = findings(schemes.by_name(name), replace(oscillator, noise=(1.0,), check=False), QUICK, FAST)
    assert [f.verdict for f in found] == [Verdict.HOLDS] * len(found), found


OWN = ("energy-preserving", "euler-heun", "milstein")
# Each problem, each scheme and each scale in every run, all of them with each other in the deep one.
EVERY_RUN = [(list(PROBLEMS)[n % len(PROBLEMS)], OWN[n % 3], scale) for n, scale in enumerate(SCALES)]


def each() -> Iterator[Any]:
    for case in product(PROBLEMS, OWN, SCALES):
        marks = [] if case in EVERY_RUN else [pytest.mark.deep]
        yield pytest.param(*case, marks=marks)


@pytest.mark.parametrize(("problem", "scheme", "scale"), list(each()))
def test_no_right_scheme_is_accused_or_left_open_at_any_rate_noise_and_size(problem, scheme, scale):
    found = findings(schemes.by_name(scheme), scaled(PROBLEMS[problem](), scale), QUICK, LAWS)
    assert not [f for f in found if wrong(f)]


@pytest.mark.parametrize("size", [1e-6, 1e6])
def test_a_noise_far_smaller_than_the_error_of_the_step_is_measured(size: float) -> None:
    """Increments of "explicit-4" have weights: a share of the noise is a covariance with weighted means."""
    small = scaled(PROBLEMS["pendulum"](), Scale(1e-6, 1e-6, size))
    (found,) = findings(schemes.by_name("explicit-4"), small, QUICK, ("right-limit",))
    assert found.verdict is Verdict.HOLDS, found
    assert found.checks == 512  # decided at the first look


def _clipping(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """(2.1), which lets a third less of its increments through than k = 2 does, in units of the fast problem."""
    return schemes.energy_preserving.step(problem, y, h, truncate(dW, h, 1, unit=_TIME))


@pytest.mark.parametrize("rate", [1e-6, 1.0, 1e5])
def test_a_clip_in_seconds_is_not_accused_on_slow_problems(rate: float) -> None:
    """√(4|ln h|) with h in seconds: 30 of them are a small step of a problem that takes 10⁶."""

    def clipping(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        bound = np.sqrt(4 * abs(np.log(h)) * h)
        return schemes.energy_preserving.step(problem, y, h, np.clip(dW, -bound, bound))

    problem = scaled(problems.harmonic_oscillator(), Scale(rate))
    scheme = Scheme("clipping", clipping, ("truncation",), batched=True, problems=(problem,))
    assert verify(scheme, laws=["truncation"]).findings[0].verdict is Verdict.HOLDS


_FAST = scaled(problems.harmonic_oscillator(), Scale(1000.0))
_TIME = units_of(_FAST).time


def test_faults_of_the_noise_show_in_every_unit() -> None:
    clipping = Scheme("clipping", _clipping, ("truncation",), batched=True, problems=(_FAST,))
    assert verify(clipping, laws=["truncation"]).findings[0].verdict is Verdict.VIOLATED
    for scale in (Scale(1e6), Scale(1.0, 1e-5), Scale(1e-3, 1e3), Scale(size=1e6)):
        problem = scaled(PROBLEMS["quartic"](), scale)

        def louder(problem: Problem, y: Array, h: float, dW: Array) -> Array:
            return schemes.energy_preserving.step(problem, y, h, 1.02 * dW)

        own = Scheme("louder", louder, batched=True, problems=(problem,))
        (finding,) = verify(own, laws=["right-limit"], effort=QUICK).findings
        assert finding.verdict is Verdict.VIOLATED, finding
        assert "noise of the limit is wrong by" in finding.message


@pytest.mark.parametrize("name", ["flow", "explicit-8", "collocation-3"])
def test_a_bare_function_that_is_better_than_the_clip_holds(name: str) -> None:
    """Its increments are clipped with k = 2 as no one told otherwise: the clip is the suite's, and no fault of it."""
    step = of_lanes(flow) if name == "flow" else schemes.by_name(name).step

    def mine(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        return step(problem, y, h, dW)

    laws = ["truncation", "mean-square-order", "weak-order", "right-limit"]
    assert verdicts(mine, laws, paths=512) == dict.fromkeys(laws, "holds")
