"""Right schemes on problems and steps that once had them accused,
and faults next to them that are found.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from doors import says, verdicts
from sepv.reference.problem import exact_problem

from benchmarks.right_schemes import RIGHT_SCHEMES
from sepv import problems, schemes
from sepv.law.cases.classes import CLASSES
from sepv.law.cases.clipped import clips, fits, within
from sepv.law.cases.from_problem import describe
from sepv.problem import Array, Problem, Systems, energy_change
from sepv.schemes import Scheme
from sepv.verification import Effort, Verdict, load_laws, verify

EP = schemes.energy_preserving


def planar(hamiltonian: Any, initial: tuple[float, ...], **known: Any) -> Problem:
    """q̇ = ∂H/∂p, ṗ = −∂H/∂q with y = (p, q) and one noise."""
    J = np.array([[0.0, -1.0], [1.0, 0.0]])
    return Problem(
        2,
        lambda y: J[(...,) + (None,) * (y.ndim - 1)] + 0 * y[0],
        hamiltonian,
        noise=(0.5,),
        initial=initial,
        **known,
    )


def far_from_zero(y: Array) -> Array:
    return 1e12 + 0.5 * y[0] ** 2 - np.cos(y[1])


def test_a_constant_in_the_energy_hides_no_change_of_it() -> None:
    """H = 1e12 + ½p² − cos q: in binary64 the change of H was 2.9e7 ulp where 1.7 are allowed."""
    own = planar(far_from_zero, (0.5, 1.0), name="raised-pendulum")
    found = says(EP, "rounding", "holds", problems=own)
    assert found.bound < 2
    bound = says(EP, "energy", "holds", problems=own).bound
    assert bound < 1000
    says(schemes.euler_heun, "energy", "violated", problems=own)


def test_the_energy_of_a_recorded_function_has_many_digits() -> None:
    exact = exact_problem(describe(planar(far_from_zero, (0.5, 1.0))), 40)
    y0, y1 = np.array([0.5, 1.0]), np.array([0.5 + 2.0**-30, 1.0])
    change = exact.hamiltonian(exact.state(y1)) - exact.hamiltonian(exact.state(y0))
    assert float(change) == pytest.approx(2.0**-31 + 2.0**-61, rel=1e-15, abs=0)
    assert exact.uncertainty(y0, y1) == 0


def test_changes_of_the_energy_of_a_batch_lose_no_digits() -> None:
    plain = planar(lambda y: 0.5 * y[0] ** 2 - np.cos(y[1]), (0.5, 1.0))
    y0 = np.random.default_rng(0).standard_normal((2, 50))
    y1 = y0 + 1e-3
    found = energy_change(planar(far_from_zero, (0.5, 1.0)), y0, y1)
    assert np.allclose(found, plain.hamiltonian(y1) - plain.hamiltonian(y0), rtol=1e-9, atol=1e-15)


def test_a_hidden_energy_with_a_large_constant_is_not_judged() -> None:
    """Its code takes binary64 numbers alone, and the rounding of 1e12 is larger than any change
    of H.
    """
    own = planar(
        lambda y: 1e12 + np.vectorize(lambda p, q: 0.5 * p * p - math.cos(q), otypes=[float])(y[0], y[1]),
        (0.5, 1.0), gradient=lambda y: np.stack([y[0], np.sin(y[1])]), check=False, name="hidden",
    )  # fmt: skip
    says(EP, "rounding", "not applicable", "hides its operations", problems=own)


def test_where_nothing_responds_to_noise_no_clip_is_seen() -> None:
    """B = hat(y) at y0 = 0: "nan ≤ 1" was a violation."""
    rigid = problems.rigid_body()
    at_rest = Problem(
        3, rigid.structure, lambda y: 0.5 * (y[0] ** 2 + 2 * y[1] ** 2), noise=(0.5,), initial=(0, 0, 0.0)
    )
    says(EP, "truncation", "not applicable", "no step responds", problems=at_rest)


def test_a_number_that_is_none_decides_nothing() -> None:
    (law,) = load_laws(["energy"])
    for verdict in (Verdict.HOLDS, Verdict.VIOLATED):
        for key in ("defect", "bound"):
            found = law.finding(verdict, **{"defect": 1.0, "bound": 1.0, key: math.nan})
            assert found.verdict is Verdict.INCONCLUSIVE
            assert "not a number" in found.message


def test_a_solution_that_escapes_in_finite_time_is_no_error_of_the_scheme() -> None:
    """H = q²p, q̇ = q²: the flow from q = 1 ends at θ = 1,
    which the random time passes on most paths.
    """
    own = planar(lambda y: y[1] ** 2 * y[0], (1.0, 1.0), name="escaping")
    says(EP, "rounding", "not applicable", "the exact solution escapes on half of the paths", problems=own)


def test_a_step_of_another_hamiltonian_returns_as_exactly_as_its_roundings_grow() -> None:
    """q1 = q + Δp whatever the masses: (2.1) hardly moves where this step moves far."""
    for seed in (0, 1):
        found = verify(
            RIGHT_SCHEMES["unit-masses"], laws=["symmetry", "reversibility"], effort=Effort(seed=seed)
        )
        assert [f.verdict for f in found.findings] == [Verdict.HOLDS] * 2
    right = RIGHT_SCHEMES["unit-masses"].step

    def tilted(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        y1 = right(problem, y, h, dW)
        return np.asarray(y1 + 2.0**-40 * (y1 - y) ** 2 / (np.abs(y).max() + np.abs(y1).max() + 1e-300))

    says(Scheme("tilted", tilted, systems=Systems.MECHANICAL), "symmetry", "violated")


CLIPPED = ["identity", "midpoint", "reduction", "noise-sum", "random-step", "reference", "refusal"]


@pytest.mark.parametrize("k", [2, 3, 8])
def test_a_scheme_that_clips_as_the_remark_says_or_less_is_asked_within_its_clip(k: int) -> None:
    """Also with k = 3 and 8, where the step takes longer increments than Scheme.truncation = 2
    says.
    """

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        most = np.sqrt(2 * k * abs(h * np.log(abs(h)))) if h else 0.0
        return EP.step(problem, y, h, np.clip(dW, -most, most))

    laws = CLIPPED if k == 2 else ["noise-sum", "random-step", "midpoint"]
    own = Scheme(f"clip-{k}", step, EP.claims, batched=True)
    assert verdicts(own, laws, examples=2) == dict.fromkeys(laws, "holds")


def test_a_scheme_that_clips_and_drops_a_noise_is_found() -> None:
    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        most = np.sqrt(4 * abs(h * np.log(abs(h)))) if h else 0.0
        first = np.where(np.arange(len(dW)) < 1, dW, 0.0)
        return EP.step(problem, y, h, np.clip(first, -most, most))

    says(Scheme("drops", step), "random-step", "violated")


def test_a_scheme_that_does_not_clip_is_asked_beyond_the_clip_too() -> None:
    cases = [case for _, case in CLASSES[Systems.SINGLE].space.cases(0)]
    assert not clips(replace(EP, name="asked"), cases)
    assert not all(fits(case.build()[0], case.h, np.array(case.dW), 2) for case in cases)
    for case in cases:
        found = within(case, 2)
        assert found is not None
        problem, _, h, dW = found.build()
        assert fits(problem, h, dW, 2)
        assert within(found, 2) == found
        before = case.build()
        if abs(case.h) <= 0.5:  # the same products, to the bit
            assert np.array_equal(problem.c * dW, before[0].c * before[3])


def test_no_increment_fits_a_step_without_length() -> None:
    case = next(
        c for _, c in CLASSES[Systems.SINGLE].space.cases(0) if np.any(c.build()[0].c * np.array(c.dW))
    )
    assert within(replace(case, h=0.0), 2) is None
    assert within(replace(case, h=0.0, dW=tuple(0.0 for _ in case.dW)), 2) is not None
