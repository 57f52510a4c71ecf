"""Every command takes a user's scheme, a user's problem and a program, and one that fails stops no other."""

import json
import shlex
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from doors import ROOT, command, obeys, verdicts
from drawn import by_hand
from reader import Reader

from sepv.problem import vector_field
from sepv.schemes import load_scheme

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
def folder(reader: Reader) -> Path:
    (reader.folder / "everywhere.py").write_text(MODULE)
    return reader.folder


OWN, EXEC = "everywhere:step -p everywhere:pendulum", f"--exec {shlex.quote(PROGRAM)} -p pendulum"
FEW = "--steps 8,16 --paths 32 --repeats 1"


@pytest.mark.parametrize(
    ("line", "word"),
    [
        (f"run {OWN} --steps 50", "everywhere"),
        (f"compare {OWN} {FEW}", "own"),
        (f"hard {OWN} --steps 20 --laws 0", "own"),
        (f"ulps {OWN} --steps 20", "own"),
        (f"bench {OWN}", "everywhere"),
        (f"verify {OWN} --law contract --examples 5", "everywhere"),
        (f"run {EXEC} --steps 20", "euler"),
        (f"compare {EXEC} {FEW}", "euler"),
        (f"hard {EXEC} --steps 10 --laws 0", "euler"),
        (f"ulps {EXEC} --steps 10", "euler"),
    ],
    ids=lambda text: " ".join(text.split()[:2]),
)
def test_it_takes_a_scheme_and_a_problem_of_a_module_and_a_program(folder, line, word):
    assert word in command(line).output.lower()


def test_a_path_of_a_black_box_says_what_is_known_and_no_more(folder: Path) -> None:
    shown = command(f"run {OWN} --steps 50 --json path.json").output
    assert "iterations" not in shown
    assert "Casimir" not in shown
    found = json.loads((folder / "path.json").read_text())
    assert (found["iterations"], found["casimir_defect"]) == (None, None)
    assert command(f"run {OWN} --steps 50 -q").output.startswith("50 steps: energy ")
    solved = command("run energy-preserving --steps 50").output
    assert "iterations a step" in solved
    assert "Casimirs" in solved


def test_a_path_that_ends_early_names_one_step_and_what_the_scheme_said(folder: Path) -> None:
    shown = command("run everywhere:tires -p everywhere:pendulum --h 0.125 --steps 50", 2).output
    assert "20 of 50" in shown
    assert "Received 20 steps; the next one, from y = [" in shown
    assert "failed: the scheme raised ArithmeticError: the inner iteration missed 1e-12." in shown
    assert "--seed" not in shown


def test_a_scheme_that_fails_ends_no_comparison(folder: Path) -> None:
    why = {"crashes": "not today", "fails_late": "no noise, please", "missing": "an attribute"}
    failing = " ".join(f"everywhere:{name}" for name in why)
    shown = command(f"compare midpoint {failing} {FEW} -p pendulum --json all.json", 3).output
    assert "midpoint" in shown
    for name, words in why.items():
        assert f"everywhere:{name} failed and is left out" in shown
        assert words in shown
    found = json.loads((folder / "all.json").read_text())
    obeys(found, "comparison")
    assert [m["name"] for m in found["methods"]] == ["midpoint"]
    assert set(found["failed"]) == {f"everywhere:{name}" for name in why}
    # Where all fail there is nothing to compare.
    assert "no noise, please" in command(f"compare everywhere:fails_late {FEW} -p pendulum", 3).output


def test_a_saved_record_of_an_own_problem_guards_it(folder: Path) -> None:
    command(f"bench {OWN} --save own.json")
    assert "same" in command("bench everywhere:step --against own.json -q").output


@pytest.mark.parametrize("problem", ["kepler", "toda"])
def test_laws_about_many_steps_fit_the_problems_beyond_the_paper(problem: str) -> None:
    # Kepler's steps are as long as its slopes allow; Toda's lattice starts at y = 0, where no rounding has a size.
    laws = ["rounding", "mean-square-order", "weak-order", "right-limit"]
    found = verdicts("energy-preserving", laws, problem, paths=512, examples=8)
    assert set(found.values()) <= {"holds", "inconclusive"}, found


def narrow(y: Any) -> Any:
    """States within 1 % of the circle; what is outside has no meaning."""
    return np.abs(np.sqrt(np.sum(y**2, axis=0)) - 1) < 0.01


def on_the_circle(problem: Any, y: Any, h: float, dW: Any) -> Any:
    if not np.all(narrow(y)):
        raise ValueError("no such state")
    delta = problem.random_step(h, dW)
    return y + delta * vector_field(problem, y + 0.5 * delta * vector_field(problem, y))


def first_lane(problem: Any, y: Any, h: float, dW: Any) -> Any:
    start = y if y.ndim == 1 else np.repeat(y[:, :1], y.shape[1], axis=1)
    return y + problem.random_step(h, dW) * vector_field(problem, start)


@pytest.mark.parametrize("domain", [None, narrow])
def test_a_step_on_a_narrow_domain_is_seen_to_take_batches(domain: Any) -> None:
    square = {"hamiltonian": lambda y: 0.5 * (y[0] ** 2 + y[1] ** 2), "gradient": lambda y: 1.0 * y}
    ring = by_hand(**square, noise=(0.5,), initial=(0.0, 1.0), domain=domain)
    assert load_scheme(on_the_circle, problems=[ring]).batched
    assert not load_scheme(first_lane, problems=[ring]).batched
    if domain is not None:  # without one a law may ask about any state
        assert verdicts(on_the_circle, "contract", ring, examples=5) == {"contract": "holds"}
