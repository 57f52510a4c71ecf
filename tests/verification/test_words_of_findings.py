"""A law that fails says what was expected, what came, and how to see it again;
a long run says how far it is.
"""

import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from contextlib import nullcontext
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from doors import ROOT, but_deep, ended
from drawn import euler, stretched
from sepv.properties.test_midpoint import check as check_midpoint

import sepv
from sepv import Scheme, TargetError, exact_flow, problems, schemes
from sepv.children import Journal, Notes
from sepv.commands._shared import candidates
from sepv.console import _progress as display
from sepv.console import console
from sepv.law.cases.case import to_json
from sepv.problem import Array, Problem, vector_field
from sepv.schemes._energy_preserving import step as exact_step
from sepv.simulate import _truncation as bounded
from sepv.simulate import _wiener as wiener
from sepv.verification import Case, Effort, Finding, Verdict, load_laws, verify
from sepv.verification import _progress as progress

QUICK = Effort(examples=5, paths=512, shrink_checks=30)


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


SAID = {
    "refuse": "no convergence after 12 iterations",
    "nan": "Received [nan, nan",
    "divide": "The scheme refused the step by ZeroDivisionError: no inverse",
}
# Each law and each fault in every run, all of them with each other in the deep one.
EVERY_RUN = [("rounding", "refuse"), ("mean-square-order", "nan"), ("local-mean", "divide")]
EACH = [(law, fault) for law, _ in EVERY_RUN for fault in SAID]


@pytest.mark.parametrize(("law", "fault"), but_deep(EACH, *(pair for pair in EACH if pair not in EVERY_RUN)))
def test_an_error_names_the_step_its_state_and_what_the_scheme_says(law: str, fault: str) -> None:
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
    assert SAID[fault] in place[4]
    if law != "local-mean":
        assert re.search(r"path \d+ (of seed 0 )?in step \d+", found.message)
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

    message = finding(step, "local-weak").message
    found = re.search(r"E\[z\d z\d\] = (\S+) expected, (\S+) came", message)
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
    message = finding(stretched(error), "energy").message
    assert ("if the step solves its equation to a tolerance, state it: Scheme(" in message) == named
    stated = finding(stretched(error), "energy", solver_tolerance=1e-15)
    assert "state it" not in stated.message


def test_lines_say_the_share_and_the_seconds_left(monkeypatch: pytest.MonkeyPatch) -> None:
    written = io.StringIO()
    monkeypatch.setattr("sepv.console._console.console", lambda **_: console(written))
    monkeypatch.setattr(display, "FIRST_LINES", ())
    monkeypatch.setattr(display, "NEXT_LINE_SECONDS", 0.02)
    energy, casimir = load_laws(["energy", "casimir"])
    energy, casimir = (replace(law, cost=cost) for law, cost in ((energy, 1.0), (casimir, 3.0)))
    with progress.watching(laws=[energy, casimir]) as step:
        step(energy, None)
        first = _said(written, "energy")
        step(energy, energy.finding(Verdict.HOLDS, seconds=2000.0, checks=1))
        step(casimir, None)
        last = _said(written, "casimir")
    assert first.endswith("0 of 2 laws, energy")
    # A law counts by what it costs, at the pace so far.
    assert re.fullmatch(r"\d+%, about (59|60)\d\d s left: 1 of 2 laws, casimir", last)


# What a run asks of a scheme beside its own work: states in batches, or single ones
# (`sepv.verification.LAWS`).
BATCHED = {"contract": 3269, "reproducibility": 140606, "mean-square-order": 129024}
SINGLE = {"reproducibility": 0, "local-mean": 4810, "mean-square-order": 8064, "rounding": 8192}


@pytest.mark.parametrize(
    ("machine", "step", "single", "batched", "states"),
    [
        pytest.param(3.0, 3e-6, 3e-4, True, BATCHED, id="(2.1) on a busy machine"),
        pytest.param(1.0, 2e-4, 2e-4, False, SINGLE, id="200 µs a state"),
        pytest.param(1.5, 2e-5, 5e-4, True, BATCHED, id="a program"),
        pytest.param(1.5, 2e-4, 2e-4, True, BATCHED, id="a slow program"),
    ],
)
def test_the_seconds_left_are_right_to_a_factor_of_two_after_a_third_of_the_laws(
    machine, step, single, batched, states,
    monkeypatch,
):  # fmt: skip
    """A law takes what it costs by turns 30 % more and less, and what its calls and states take."""
    now, laws = 0.0, load_laws()
    monkeypatch.setattr(time, "monotonic", lambda: now)
    course, left = progress.Course(laws), []
    for n, law in enumerate(laws):
        course.heard(law, None)
        count = states.get(law.name, law.steps)
        seconds = machine * law.cost * 1.3 ** (-1) ** n + count * (step if count > 5000 else single)
        verdict, checks = Verdict.HOLDS, 10
        if not batched and law.name == "reproducibility":
            verdict, checks, seconds = Verdict.NOT_APPLICABLE, 0, 0.0
        now += seconds
        # The oscillator's step takes less than the rigid body's.
        own = 0.75 * step if law.name == "contract" else None
        course.heard(law, law.finding(verdict, seconds=seconds, checks=checks, step_seconds=own))
        left.append((now, course.seconds_left()))
    third = [(at, said) for at, said in left[len(laws) // 3 - 1 :] if now - at > 2.0]
    assert len(third) > 8
    for at, said in third:
        assert said is not None
        assert 0.5 <= said / (now - at) <= 2.0, (at, said, now)


def test_the_seconds_left_of_laws_side_by_side_are_those_of_the_longest() -> None:
    long, short, third = (
        replace(law, cost=cost, steps=0)
        for law, cost in zip(load_laws(["energy", "casimir", "identity"]), (60.0, 1.0, 1.0), strict=True)
    )
    course = progress.Course([long, short, third])
    assert course.seconds_left() is None
    for law in (long, short):
        course.heard(law, None)
    course.heard(short, short.finding(Verdict.HOLDS, seconds=1.0, checks=1))
    left = course.seconds_left()
    assert left is not None
    assert 55 < left < 65


def test_a_law_that_takes_longer_than_expected_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """It said "96 %, about 1 s left" four times in 25 s:
    an eighth of what the law had taken so far.
    """
    now, laws = 0.0, load_laws(["energy", "casimir"])
    first, last = (replace(law, cost=cost, steps=0) for law, cost in zip(laws, (10.0, 0.5), strict=True))
    monkeypatch.setattr(time, "monotonic", lambda: now)
    course, shown = progress.Course([first, last]), display.ShownProgress()
    shown.expected, shown.doing = course.seconds_left, lambda: course.doing(None, "mine:step")
    course.heard(first, None)
    now = 20.0
    course.heard(first, first.finding(Verdict.HOLDS, seconds=20.0, checks=1))
    course.heard(last, None)
    now = 20.5
    assert shown.line() == "98%, about 1 s left: 1 of 2 laws, casimir"
    now = 28.0
    assert shown.line() == "28 s: 1 of 2 laws, casimir for 8 s where 1 s were expected"
    # Nothing is expected of a law of many steps while nothing tells how long a step takes.
    course.left = {"casimir": replace(last, steps=5000)}
    assert shown.line() == "28 s: 1 of 2 laws, casimir"
    course.found = [(first, first.finding(Verdict.HOLDS, seconds=20.0, checks=1, step_seconds=1e-4))]
    assert shown.line() == "28 s: 1 of 2 laws, casimir for 8 s where 2 s were expected"


def test_the_seconds_left_are_not_said_for_longer_than_half_of_what_a_law_was_expected_to_take(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It said "97 %, about 10 s left" for two minutes of a law that was expected to take one,
    and took three.
    """
    now, laws = 0.0, load_laws(["energy", "casimir"])
    first, last = (replace(law, cost=cost, steps=0) for law, cost in zip(laws, (300.0, 60.0), strict=True))
    monkeypatch.setattr(time, "monotonic", lambda: now)
    course = progress.Course([first, last])
    course.heard(first, None)
    now = 300.0
    course.heard(first, first.finding(Verdict.HOLDS, seconds=300.0, checks=1))
    course.heard(last, None)
    said = []
    for second in range(1, 240):
        now = 300.0 + second
        said.append(course.seconds_left())
    assert [s for s in said[:50] if s is not None] == pytest.approx(list(range(59, 9, -1)))
    assert sum(s is not None for s in said[60:]) <= 30  # while it is late by half at most
    assert not any(said[90:])


def test_a_step_that_is_being_compiled_is_waited_for_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    now, (law,) = 100.0, load_laws(["energy"])
    monkeypatch.setattr(time, "monotonic", lambda: now)
    course, journal = progress.Course([law]), Journal(lambda *_: None, Notes())
    course.heard(law, None)
    journal.cases, journal.since = 1, 100.0
    now = 114.0
    waits = "0 of 1 laws, energy, waiting for the first step of mine:step, 14 s"
    assert course.doing(journal, "mine:step") == waits
    journal.cases = 7
    assert course.doing(journal, "mine:step") == "0 of 1 laws, energy, case 7 for 14 s"
    journal.since = 113.0
    assert course.doing(journal, "mine:step") == "0 of 1 laws, energy"


def test_a_scheme_is_named_before_it_is_loaded() -> None:
    said: list[str] = []
    with pytest.raises(TargetError), candidates(["no_such_module:step"], (), said.append):
        pass
    assert said == ["waiting for the first step of no_such_module:step"]


def _said(written: io.StringIO, word: str) -> str:
    """The first whole line that ends so, however long a busy machine takes to print it."""
    end = time.monotonic() + 60
    while time.monotonic() < end:
        for line in written.getvalue().splitlines(keepends=True):
            if line.endswith(f"{word}\n"):
                return line.strip()
        time.sleep(0.01)
    raise AssertionError(f"no line ends with {word}: {written.getvalue()!r}")


def test_what_is_quick_or_quiet_says_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    with display.showing():
        pass
    with display.showing(quiet=True) as shown:
        shown.update("nothing", 0.5)
    assert capfd.readouterr().err == ""


# As `python -m`, but with SIGINT as a terminal has it: a shell that starts jobs in the background
# has them ignore it.
START = (
    "import sys, signal, runpy; signal.signal(signal.SIGINT, signal.default_int_handler); sys.argv = sys.argv[1:]; "
    "runpy.run_module(sys.argv[0], run_name='__main__', alter_sys=True)"
)


@pytest.mark.parametrize(
    ("words", "workers"),
    [
        ("sepv verify midpoint -j 2", True),
        ("sepv teeth b-at-y0 b-at-y1", True),
        ("sepv reproduce 4.4", True),
        ("sepv hard --steps 1000000 --json r.json", False),
        ("sepv solvability lotka-volterra --states 4000 --json r.json", False),
        ("benchmarks.orders", False),
    ],
)
def test_ctrl_c_ends_all_processes_with_a_word_and_leaves_no_half_file(words, workers, tmp_path):
    child = subprocess.Popen(
        [sys.executable, "-c", START, *words.split()], env=os.environ | {"PYTHONPATH": str(ROOT)},
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    with child:
        assert child.stderr
        assert child.stderr.readline()  # the first line of progress: it works by now
        shown = subprocess.run(["ps", "-eo", "pid=,ppid="], capture_output=True, text=True, check=True).stdout
        rows = (tuple(map(int, line.split())) for line in shown.splitlines())
        children = [pid for pid, parent in rows if parent == child.pid]
        assert children or not workers
        child.send_signal(signal.SIGINT)
        out, err = child.communicate(timeout=30)
    assert child.returncode == 130, out + err
    assert "Traceback" not in out + err
    assert "interrupted" in (out + err).lower()
    # The tracker of multiprocessing ends by itself, once the pipe to its parent is closed.
    assert ended(children)
    for file in tmp_path.iterdir():
        assert file.name == "r.json"
        json.loads(file.read_text())


def test_every_benchmark_is_imported_and_starts_with_its_progress() -> None:
    for file in sorted((ROOT / "benchmarks").glob("*.py")):
        import_module(f"benchmarks.{file.stem}")
        text = file.read_text(encoding="utf-8")
        if 'if __name__ == "__main__":' in text:
            assert text.endswith('if __name__ == "__main__":\n    start(main)\n'), file


def test_violations_are_said_as_they_are_decided(monkeypatch: pytest.MonkeyPatch) -> None:
    written = io.StringIO()
    monkeypatch.setattr("sepv.console._console.console", lambda **_: console(written))
    monkeypatch.setattr(display, "FIRST_LINES", (0.01,))
    monkeypatch.setattr(display, "WORK_CHECK_SECONDS", 0.01)
    energy, casimir = load_laws(["energy", "casimir"])
    with progress.watching(laws=[energy, casimir]) as step:
        step(energy, None)
        step(energy, energy.finding(Verdict.VIOLATED, defect=9.0, bound=1.0, checks=1))
        words = "energy (Prop. 3.1) violated: 9 against 1 ulp of H, not claimed"
        assert _said(written, "not claimed") == words
        step(casimir, None)
        step(casimir, casimir.finding(Verdict.HOLDS, checks=1))


def test_laws_of_few_steps_are_asked_first_and_shown_in_the_order_of_the_suite() -> None:
    asked: list[str] = []
    asked_for = "contract,energy,poisson-map:constant,local-mean,local-weak,mean-square-order,right-limit"
    report = verify("midpoint", laws=asked_for, effort=Effort(examples=1, paths=64, shrink_checks=0),
                    progress=lambda law, found: asked.append(law.name) if found is None else None)  # fmt: skip
    assert [f.law for f in report.findings] == asked_for.split(",")
    assert asked == ["contract", "energy", "poisson-map:constant", "local-mean", "local-weak", "mean-square-order",
                     "right-limit"]  # fmt: skip


@pytest.mark.parametrize(
    ("scheme", "method"), [("midpoint", "the midpoint rule"), ("gauss-2", "the 2-stage Gauss method")]
)
def test_the_law_midpoint_names_the_method_that_a_step_is_compared_with(scheme: str, method: str) -> None:
    case = Case(problems.harmonic_oscillator().data, (0.2, 0.1), 0.25, (0.5,))
    assert check_midpoint(schemes.by_name(scheme), case).detail.endswith(f"ulp from {method}")
