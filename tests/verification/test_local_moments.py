"""Moments of the exact solution after one step: the splitting for functions against the generator for polynomials."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sepv import problems
from sepv.problem import Array, HamiltoniansProblem
from sepv.schemes import Scheme, energy_preserving
from sepv.schemes._load_target import load_scheme
from sepv.verification import Effort, Verdict, verify
from sepv.verification._orders.local_errors import local_states
from sepv.verification._orders.local_moments import moments_at


def as_functions(name: str) -> HamiltoniansProblem:
    """The problem without its data: what is known of it is its functions."""
    problem = problems.by_name(name)
    assert isinstance(problem, HamiltoniansProblem)
    return replace(problem, data=None, name=f"{name} as functions", check=False)


@pytest.mark.parametrize("name", ["random-inertia", "noisy-henon-heiles", "random-maxwell-bloch"])
def test_the_splitting_has_the_moments_of_the_generator_up_to_the_fourth_power_of_h(name: str) -> None:
    problem, functions = problems.by_name(name), as_functions(name)
    states = local_states(energy_preserving, problem)
    sizes = [2.0**-k for k in (5, 6, 7)]
    exact, _ = moments_at(problem, states, sizes, 5)
    found, error = moments_at(functions, states, sizes, 5)
    apart = np.array([np.max(np.abs(a - b)) for a, b in zip(exact, found, strict=True)])
    assert error < 1e-14
    assert apart[0] < 1e-5
    assert np.all(np.diff(np.log2(apart)) < -3.7), apart


def test_steps_at_which_a_flow_is_not_finite_are_left_out() -> None:
    functions = as_functions("random-inertia")
    states = local_states(energy_preserving, functions)
    blow_up = replace(functions, gradient=lambda y: y**9, check=False)
    found, _ = moments_at(blow_up, 3 * states, [2.0, 2.0**-20], 3)
    assert len(found) == 1
    assert np.all(np.isfinite(found[0]))


def test_orders_of_functions_are_judged_as_those_of_the_same_data() -> None:
    laws = ["local-mean", "local-mean-square", "local-weak"]
    functions = as_functions("random-inertia")
    for scheme in (load_scheme("stochastic-midpoint"), _with_too_much_drift()):
        seen = []
        for problem in ("random-inertia", functions):
            report = verify(replace(scheme, problems=(problem,)), laws=laws, effort=Effort())
            seen.append(
                [
                    (f.law, f.verdict, round((f.witness or {})["measured"][0]["slope"], 1))
                    for f in report.findings
                ]
            )
        assert seen[0] == seen[1]
    assert seen[1][0][1] is Verdict.VIOLATED


def _with_too_much_drift() -> Scheme:
    """The midpoint rule over a step that is a thousandth too long."""
    midpoint = load_scheme("stochastic-midpoint")

    def step(problem: HamiltoniansProblem, y: Array, h: float, dW: Array) -> Array:
        return midpoint.step(problem, y, 1.001 * h, dW)

    return replace(midpoint, name="too long", step=step, solve=None, claims=())
