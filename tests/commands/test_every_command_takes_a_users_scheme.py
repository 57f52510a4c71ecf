"""Every command takes a user's scheme, a user's problem and a program, and one that fails stops no other."""

from __future__ import annotations

import json
import shlex
import sys
from pathlib import Path

import jsonschema
import pytest
from click.testing import CliRunner, Result

import sepv
from sepv.commands._cli import main

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = shlex.join([sys.executable, str(ROOT / "examples" / "euler_heun_plain.py")])

MODULE = '''
import numpy as np
import sepv
from sepv.problem._fields import vector_field

def step(problem, y, h, dW):
    delta = problem.random_step(h, dW)
    f = vector_field(problem, y)
    return y + 0.5 * delta * (f + vector_field(problem, y + delta * f))

def crashes(problem, y, h, dW):
    raise RuntimeError("not today")

def fails_late(problem, y, h, dW):
    if abs(dW).max() > 0:
        raise RuntimeError("no noise, please")
    return y.copy()

steps = []

def tires(problem, y, h, dW):
    if h == 0.125:
        steps.append(h)
    if len(steps) > 21:  # one is asked beforehand, whether it answers with a state at all
        raise ArithmeticError("the inner iteration missed 1e-12")
    return step(problem, y, h, dW)

def pendulum():
    """Functions alone, without data."""
    return sepv.Problem(
        2,
        lambda y: np.stack([np.stack([0 * y[0], 0 * y[0] - 1]), np.stack([0 * y[0] + 1, 0 * y[0]])]),
        lambda y: 0.5 * y[0] ** 2 - np.cos(y[1]),
        lambda y: np.stack([y[0], np.sin(y[1])]),
        initial=(0.2, 1.0),
        name="own",
    )
'''


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "everywhere.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def sepv_(*arguments: str) -> Result:
    return CliRunner().invoke(main, list(arguments))


OWN = ("everywhere:step", "-p", "everywhere:pendulum")
COMMANDS = {
    "run": ("run", *OWN, "--steps", "50"),
    "compare": ("compare", *OWN, "--steps", "8,16", "--paths", "32", "--repeats", "1"),
    "hard": ("hard", *OWN, "--steps", "20", "--laws", "0"),
    "ulps": ("ulps", *OWN, "--steps", "20"),
    "bench": ("bench", *OWN),
    "verify": ("verify", *OWN, "--law", "contract", "--examples", "5"),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_it_takes_a_scheme_and_a_problem_by_module_and_attribute(folder: Path, command: str) -> None:
    done = sepv_(*COMMANDS[command])
    assert done.exit_code == 0, done.output
    assert "own" in done.output or "everywhere" in done.output


def test_a_path_of_a_black_box_says_what_is_known_and_no_more(folder: Path) -> None:
    done = sepv_("run", *OWN, "--steps", "50", "--json", "path.json")
    assert "iterations" not in done.output
    assert "Casimir" not in done.output
    found = json.loads((folder / "path.json").read_text())
    assert (found["iterations"], found["casimir_defect"]) == (None, None)
    assert sepv_("run", *OWN, "--steps", "50", "-q").output.startswith("50 steps: energy ")
    solved = sepv_("run", "energy-preserving", "--steps", "50").output
    assert "iterations a step" in solved
    assert "Casimirs" in solved


def test_a_path_that_ends_early_names_one_step_and_what_the_scheme_said(folder: Path) -> None:
    done = sepv_("run", "everywhere:tires", "-p", "everywhere:pendulum", "--h", "0.125", "--steps", "50")
    assert done.exit_code == 2
    assert "20 of 50" in done.output
    assert "Received 20 steps; the next one, from y = [" in done.output
    assert "failed: the scheme raised ArithmeticError: the inner iteration missed 1e-12." in done.output
    assert "--seed" not in done.output


EXEC = {
    "run": ("run", "--exec", PROGRAM, "-p", "pendulum", "--steps", "20"),
    "compare": (
        "compare",
        "--exec",
        PROGRAM,
        "-p",
        "pendulum",
        "--steps",
        "8,16",
        "--paths",
        "32",
        "--repeats",
        "1",
    ),
    "hard": ("hard", "--exec", PROGRAM, "-p", "pendulum", "--steps", "10", "--laws", "0"),
    "ulps": ("ulps", "--exec", PROGRAM, "-p", "pendulum", "--steps", "10"),
}


@pytest.mark.parametrize("command", EXEC)
def test_it_takes_a_program_in_another_language(folder: Path, command: str) -> None:
    done = sepv_(*EXEC[command])
    assert done.exit_code == 0, done.output
    assert "euler" in done.output.lower()


def test_a_scheme_that_fails_ends_no_comparison(folder: Path) -> None:
    done = sepv_(
        "compare", "midpoint", "everywhere:crashes", "everywhere:fails_late", "everywhere:missing",
        "--steps", "8,16", "--paths", "32", "--repeats", "1", "-p", "pendulum", "--json", "all.json",
    )  # fmt: skip
    assert done.exit_code == 3
    assert "midpoint" in done.output
    for name, why in (
        ("crashes", "not today"),
        ("fails_late", "no noise, please"),
        ("missing", "an attribute"),
    ):
        assert f"everywhere:{name} failed and is left out" in done.output
        assert why in done.output
    found = json.loads((folder / "all.json").read_text())
    schema = json.loads((ROOT / "sepv" / "schemas" / "comparison.schema.json").read_text())
    jsonschema.validate(found, schema)
    assert [m["name"] for m in found["methods"]] == ["midpoint"]
    assert set(found["failed"]) == {f"everywhere:{name}" for name in ("crashes", "fails_late", "missing")}


def test_where_all_fail_there_is_nothing_to_compare(folder: Path) -> None:
    done = sepv_("compare", "everywhere:fails_late", "--steps", "8,16", "--paths", "32", "-p", "pendulum")
    assert done.exit_code == 3
    assert "no noise, please" in done.output


def test_neither_a_scheme_nor_a_program_is_refused(folder: Path) -> None:
    done = sepv_("run")
    assert done.exit_code == 2
    assert "a scheme, or a program with --exec" in done.output


def test_a_saved_record_of_an_own_problem_guards_it(folder: Path) -> None:
    assert sepv_("bench", *OWN, "--save", "own.json").exit_code == 0
    done = sepv_("bench", "everywhere:step", "--against", "own.json", "-q")
    assert done.exit_code == 0, done.output
    assert "same" in done.output


def test_ulps_of_functions_and_of_data_agree() -> None:
    from dataclasses import replace

    from sepv.studies._ulps import one_step

    data = sepv.problems.pendulum()
    functions = replace(data, data=None, check=False)
    a, b = (one_step(sepv.schemes.midpoint, p, steps=20) for p in (data, functions))
    assert a.energy_median is not None
    assert b.energy_median == pytest.approx(a.energy_median, rel=1e-3)


@pytest.mark.parametrize("problem", ["kepler", "toda"])
def test_laws_about_many_steps_fit_the_problems_beyond_the_paper(problem: str) -> None:
    # Kepler's steps are as long as its slopes allow; Toda's lattice starts at y = 0, where no rounding has a size.
    laws = ["rounding", "mean-square-order", "weak-order", "right-limit"]
    report = sepv.verify(
        "energy-preserving", problems=[problem], laws=laws, effort=sepv.Effort(paths=512, examples=8)
    )
    assert {f.verdict for f in report.findings} <= {sepv.Verdict.HOLDS, sepv.Verdict.INCONCLUSIVE}, report


NARROW = '''
import numpy as np
import sepv
from sepv.problem._fields import vector_field

def ring():
    """States within 1 % of the circle; what is outside has no meaning."""
    return sepv.Problem(
        2,
        lambda y: np.stack([np.stack([0 * y[0], 0 * y[0] - 1]), np.stack([0 * y[0] + 1, 0 * y[0]])]),
        lambda y: 0.5 * (y[0] ** 2 + y[1] ** 2),
        lambda y: 1.0 * y,
        noise=(0.5,),
        initial=(0.0, 1.0),
        domain=DOMAIN,
    )

def step(problem, y, h, dW):
    if np.any(np.abs(np.sqrt(np.sum(y**2, axis=0)) - 1) > 0.01):
        raise ArithmeticError("no such state")
    delta = problem.random_step(h, dW)
    f = vector_field(problem, y)
    return y + delta * vector_field(problem, y + 0.5 * delta * f)

def first_lane(problem, y, h, dW):
    start = y if y.ndim == 1 else np.repeat(y[:, :1], y.shape[1], axis=1)
    return y + problem.random_step(h, dW) * vector_field(problem, start)
'''


@pytest.mark.parametrize("domain", ["None", "lambda y: np.abs(np.sqrt(np.sum(y**2, axis=0)) - 1) < 0.01"])
def test_a_step_on_a_narrow_domain_is_seen_to_take_batches(folder: Path, domain: str) -> None:
    module = f"narrow_{len(domain)}"
    (folder / f"{module}.py").write_text(NARROW.replace("DOMAIN", domain))
    from sepv.schemes import load_problem, load_scheme

    ring = load_problem(f"{module}:ring")
    assert load_scheme(f"{module}:step", problems=[ring]).batched
    assert not load_scheme(f"{module}:first_lane", problems=[ring]).batched
    if ring.domain is not None:  # without one a law may ask about any state
        report = sepv.verify(f"{module}:step", problems=ring, laws="contract", effort=sepv.Effort(examples=5))
        assert report.finding("contract").verdict is sepv.Verdict.HOLDS, report
