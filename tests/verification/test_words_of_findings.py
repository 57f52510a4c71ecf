"""A law that fails says what was expected, what came, from which state, and how to see it again."""

import re
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

import sepv
from sepv import problems
from sepv.exact import exact_flow
from sepv.problem import Array, Problem, vector_field
from sepv.schemes import Scheme
from sepv.schemes._energy_preserving import step as exact_step
from sepv.simulate import _truncation as bounded
from sepv.simulate import _wiener as wiener
from sepv.verification import Case, Effort, Finding, Verdict, load_laws, verify
from sepv.verification._cases.case import to_json

QUICK = Effort(examples=5, paths=512, shrink_checks=30)


def euler(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Itô's limit, and not Stratonovich's."""
    return np.asarray(y + vector_field(problem, y) * problem.random_step(h, dW))


def finding(step: object, law: str, **facts: object) -> Finding:
    report = verify(Scheme("own", step, **facts), laws=[law], effort=QUICK)
    found = report.finding(law)
    assert found.verdict is Verdict.VIOLATED, found
    return found


def numbers(text: str) -> Array:
    return np.array([float(v) for v in text.split(",")])


@pytest.mark.parametrize("law", ["mean-square-order", "weak-order", "right-limit"])
def test_a_sampled_law_names_a_path_that_a_reader_can_run(law: str) -> None:
    found = finding(euler, law, batched=True)
    assert found.replay == f"--law {law} --seed 0 --paths 512"
    assert re.search(r"from 512 paths, (slope ≥|share ≤) [\d.]+ needed", found.message)
    line = next(line for line in found.message.splitlines() if ", path " in line)
    problem = problems.by_name(line.partition(",")[0])
    y0, W, expected, came = (numbers(v) for v in re.findall(r"\(([-\de., +]+)\)", line)[:4])
    # The recipe for its increments is Python; what came is what the scheme makes of them.
    recipe = re.search(r"sepv\.simulate\.(increments\(.*\))$", line)
    assert recipe is not None
    dW = eval(recipe[1], {"increments": wiener.increments, "range": range})
    assert np.allclose(W, dW.sum(axis=0)[:, 0], rtol=1e-11)
    h = 0.5 / len(dW)
    y = np.array(problem.initial)
    for row in bounded.truncate(dW, h, 2):
        y = euler(problem, y, h, row[:, 0])
    assert np.allclose(y, came, rtol=1e-10)
    assert np.allclose(y0, problem.initial)
    exact = exact_flow(problem, problem.random_step(0.5, dW.sum(axis=0))).y[:, 0]
    assert np.allclose(exact, expected, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("law", ["local-mean", "local-mean-square", "local-weak"])
def test_a_law_by_quadrature_names_a_state_and_a_step(law: str) -> None:
    found = finding(euler, law)
    assert found.replay == f"--law {law}"
    line = next(line for line in found.message.splitlines() if "from y0 =" in line)
    h = float(re.search(r"h = ([\d.e-]+)", line)[1])
    y0, *rest = (numbers(v) for v in re.findall(r"\(([-\de., +]+)\)", line))
    problem, (expected, came) = problems.by_name(line.partition(",")[0]), rest[-2:]
    if law == "local-mean-square":
        (dW, *_), seen = rest, bounded.truncate(rest[0], h, 2)
        assert np.allclose(euler(problem, y0, h, seen) - y0, came, rtol=1e-8)
        ends = exact_flow(problem, np.array([problem.random_step(h, dW)]), y0).y[:, 0]
        assert np.allclose(ends - y0, expected, rtol=1e-8)
    else:
        # Of Euler's step the mean is f h, of the exact solution f h + ½(Σc²)f′f h + …
        assert np.allclose(came, vector_field(problem, y0) * h, rtol=1e-8)
        assert np.linalg.norm(expected - came) > 0.1 * np.linalg.norm(came)


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("refuse", "no convergence after 12 iterations"),
        ("nan", "Received [nan, nan"),
        ("divide", "The scheme refused the step by ZeroDivisionError: no inverse"),
    ],
)
@pytest.mark.parametrize("law", ["rounding", "mean-square-order", "local-mean"])
def test_an_error_names_the_step_its_state_and_what_the_scheme_says(law: str, fault: str, said: str) -> None:
    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        if h < 0.02 and abs(dW[0]) < 0.3 * h**0.5:
            if fault == "refuse":
                raise sepv.StepFailure("no convergence after 12 iterations")
            if fault == "divide":
                raise ZeroDivisionError("no inverse")
            return np.full_like(y, np.nan)
        return exact_step(problem, y, h, dW)  # keeps H, or *rounding* is settled before

    # Takes one state at a time, or its `if` would be about many.
    few = replace(QUICK, paths=64)
    (found,) = verify(Scheme("own", step), laws=[law], effort=few).findings
    assert found.verdict is Verdict.ERROR
    words = r"from y0 = \(([^)]+)\) with h = ([\d.e-]+), ΔW = \(([^)]+)\): (.*)"
    place = re.search(words, found.message, re.DOTALL)
    assert place is not None, found.message
    y0, dW, h = numbers(place[1]), numbers(place[3]), float(place[2])
    assert said in place[4]
    if law != "local-mean":
        assert re.search(r"path \d+ (of seed 0 )?in step \d+", found.message)
    # What is printed is enough to see it again.
    errors = {"refuse": sepv.StepFailure, "divide": ZeroDivisionError}
    with pytest.raises(errors[fault]) if fault in errors else nullcontext():
        assert np.isnan(step(problems.rigid_body(), y0, h, dW)).all()


def test_a_weak_law_names_the_second_moment_where_the_means_agree() -> None:
    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        # E f Δ and the Itô term as they should be, E ΔW² 10 % too small.
        delta = h + 0.9**0.5 * (problem.random_step(h, dW) - h)
        f, part = vector_field(problem, y), 1e-5
        slope = (vector_field(problem, y + part * f) - vector_field(problem, y - part * f)) / (2 * part)
        return np.asarray(y + f * delta + 0.5 * slope * delta**2 / 0.9)

    line = finding(step, "local-weak").message.splitlines()[-1]
    found = re.search(r"E\[z\d z\d\] = (\S+) expected, (\S+) came", line)
    assert found is not None
    assert float(found[2]) / float(found[1]) == pytest.approx(0.9, abs=0.05)


def test_energy_names_the_state_before_the_step_that_fails() -> None:
    (law,) = load_laws(["energy"])
    problem = problems.rigid_body()
    case = Case(problem.data, (0.8, 0.6, 0.0), 0.125, (0.0,))
    made: list[Array] = [np.array(case.y)]

    def third(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        made.append(exact_step(problem, y, h, dW) * (1.001 if len(made) == 3 else 1.0))
        return made[-1]

    found = law.replay(law, Scheme("own", third), to_json(case))
    assert found.verdict is Verdict.VIOLATED
    assert "step 3: " in found.message
    assert f"from y0 = {made[2].tolist()} after 2 steps" in found.message
    assert sepv.verify(exact_step, laws=["energy"], effort=QUICK).exit_code == 0


@pytest.mark.parametrize(("error", "named"), [(1e-11, True), (1e-3, False)])
def test_a_defect_as_small_as_a_tolerance_says_how_to_state_one(error: float, named: bool) -> None:
    def inexact(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        return exact_step(problem, y, h, dW) * (1 + error)

    message = finding(inexact, "energy").message
    assert ("if the step solves its equation to a tolerance, state it: Scheme(" in message) == named
    # Who states one is not told to.
    stated = finding(inexact, "energy", solver_tolerance=1e-15)
    assert "state it" not in stated.message
