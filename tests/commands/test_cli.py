"""What a user sees: tables, files, exit codes, one message a mistake;
every command takes a user's own scheme.
"""

import json
import re
import shlex
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from doors import ROOT, Reader, command, obeys, verdicts
from drawn import by_hand

from sepv.problem import vector_field
from sepv.schemes import load_scheme
from sepv.verification import LAWS


def test_a_claim_that_would_not_be_measured_is_refused(call) -> None:
    result = call("verify midpoint --law energy --claim casimir,energy")
    assert result.exit_code == 2
    assert "--claim casimir, and energy to measure" in " ".join(result.output.split())


def test_a_pin_says_which_command_guards_and_what_it_guards_no_more(call) -> None:
    few = "--examples 2 --pin p.toml -q"
    first = call(f"verify midpoint --law identity,casimir {few}")
    assert first.output.strip().endswith("sepv verify midpoint --law identity,casimir --expected p.toml")
    second = call(f"verify euler-heun --law identity,casimir {few}")
    assert "The pin before guarded casimir, identity too." in " ".join(second.output.split())


def test_a_pin_of_another_scheme_is_said_with_what_to_do(call, tmp_path: Path) -> None:
    few = "--law identity,casimir --examples 2 -q"
    call(f"verify energy-preserving {few} --pin p.toml")
    assert "written for" not in call(f"verify energy-preserving {few} --expected p.toml").output
    other = call(f"verify mine:correct {few} --expected p.toml", "")
    assert other.exit_code == 0
    said = " ".join(other.output.split())
    assert "was written for energy-preserving, and this is mine:correct: where it is the same scheme" in said
    renamed = (tmp_path / "p.toml").read_text().replace('"energy-preserving"', '"mine:correct"')
    (tmp_path / "p.toml").write_text(renamed)
    assert "written for" not in call(f"verify mine:correct {few} --expected p.toml").output
    # One of a version that wrote no names.
    (tmp_path / "p.toml").write_text(renamed.replace('scheme = "mine:correct"\n', ""))
    assert "written for" not in call(f"verify mine:correct {few} --expected p.toml").output
    (tmp_path / "p.toml").write_text(renamed.replace('"mine:correct"', "3"))
    assert call(f"verify mine:correct {few} --expected p.toml").exit_code == 2


def test_several_targets_give_a_matrix_and_a_quiet_line_names_its_target_where_there_are_several(call):
    line = "verify energy-preserving midpoint --law energy,identity --examples 2 --shrink-checks 0"
    matrix = call(line)
    assert matrix.exit_code == 0
    assert "holds +" in matrix.output
    assert "+ claimed" in matrix.output
    both = call(f"{line} -q").output.splitlines()
    assert [line.split(": ")[0] for line in both if line] == ["energy-preserving", "midpoint"]
    assert "midpoint: 2 laws: 1 holds, 1 violated; " in both[-1]
    (alone,) = call("verify midpoint --law identity --examples 2 -q").output.splitlines()
    assert alone.startswith("1 law: 1 holds; ")


@pytest.mark.parametrize(
    ("line", "processes"),
    [("midpoint gauss-2", 2), ("midpoint mine:correct", 1), ("nosuch", 1), ("midpoint --law energy", 1)],
)
def test_laws_of_built_in_schemes_are_measured_on_all_cores_by_default(call, monkeypatch, line, processes):
    given = []
    monkeypatch.setattr("sepv.commands._verify.cores", lambda: 2)
    monkeypatch.setattr("sepv.commands._verify.start_ahead", lambda *_: None)
    monkeypatch.setattr("sepv.commands._verify._arguments", lambda _, options: given.append(options["jobs"]))
    call(f"verify {line}")
    assert given == [processes]


@pytest.mark.parametrize(
    ("arguments", "raised"), [("u, system, dt, xi", "Attribute"), ("system, u, xi, dt", "Type")]
)
def test_other_names_in_another_order_end_in_an_error_that_says_what_was_called(call, arguments, raised):
    code = f"def step({arguments}):\n    return u + system.random_step(dt, xi) * system.gradient(u)\n"
    said = call("verify mine:step --law energy --examples 2", code).output
    assert f"The scheme raised {raised}Error" in said
    assert re.search(r"mine\.py, line \d+, in step\)", said)
    called = r"called with the problem [^,]+, y of shape \(2,\), h = [\d.]+, dW of shape \(\d+,\)"
    assert re.search(called, said)


def test_a_name_that_a_module_lacks_is_answered_by_its_schemes_first(call) -> None:
    code = "def helper(x):\n    return x\nright = sepv.Scheme('right', correct)\nsystem = sepv.problems.rigid_body()\n"
    said = " ".join(call("verify mine:nosuch", code).output.split())
    assert "a module with right, system, helper." in said


def test_a_bare_function_claims_nothing_and_is_measured(call) -> None:
    result = call("verify mine:correct --law energy --law contract --examples 2")
    assert result.exit_code == 0
    # The contract is what whoever hands over a step signs; a green run says nothing about the rest.
    last = result.output.splitlines()[-1]
    assert "Nothing is claimed, so nothing is guarded but the contract" in last
    assert "sepv verify mine:correct --claim energy;" in last
    assert "--pin FILE." in last  # a sentence of the level may follow


def test_a_raising_scheme_is_an_error_of_every_law_and_debug_shows_it(call) -> None:
    code = "def step(problem, y, h, dW):\n    raise RuntimeError('out of order')\n"
    result = call("verify mine:step --examples 2 --paths 64 --shrink-checks 2", code)
    assert result.exit_code == 3
    # Truncation is about the increments that the scheme asks for, a function of one state has no
    # batch, and some laws are for schemes of another class of systems, or for functions that a
    # problem states.
    assert f"7 not applicable, {len(LAWS) - 7} errors" in result.output
    assert "out of order" in result.output
    shown = call("verify mine:step --examples 2 --law energy --debug", code)
    assert "Traceback" in shown.output or isinstance(shown.exception, RuntimeError)


PROGRAM = shlex.join([sys.executable, str(ROOT / "examples" / "euler_heun_plain.py")])

MODULE = '''
import numpy as np
import sepv
from drawn import J, refusing
from sepv.schemes._euler_heun import step

crashes = refusing(RuntimeError("not today"))
fails_late = refusing(RuntimeError("no noise, please"), lambda problem, y, h, dW: abs(dW).max() > 0)
steps = []

def tires(problem, y, h, dW):
    if h == 0.125:
        steps.append(h)
    if len(steps) > 21:  # one is asked beforehand, whether it answers with a state at all
        raise ArithmeticError("the inner iteration missed 1e-12")
    return step(problem, y, h, dW)

def pendulum():
    """Functions alone, without data."""
    H, gradient = lambda y: 0.5 * y[0] ** 2 - np.cos(y[1]), lambda y: np.stack([y[0], np.sin(y[1])])
    return sepv.Problem(2, J, H, gradient, initial=(0.2, 1.0), name="own")
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
        (f"bench {OWN}", "everywhere"),
        (f"verify {OWN} --law contract --examples 5", "everywhere"),
        (f"run {EXEC} --steps 20", "euler"),
        (f"compare {EXEC} {FEW}", "euler"),
        (f"hard {EXEC} --steps 10 --laws 0", "euler"),
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
    why = {"crashes": "not today", "fails_late": "no noise, please"}
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
    # A name that names nothing ends the command before anything is timed: somebody waits for that
    # scheme.
    for name, words in (("everywhere:missing", "an attribute"), ("midpiont", "did you mean 'midpoint'?")):
        shown = command(f"compare midpoint {name} {FEW} -p pendulum", 3)
        assert words in shown.stderr
        assert not shown.stdout
    # Where all fail there is nothing to compare.
    assert "no noise, please" in command(f"compare everywhere:fails_late {FEW} -p pendulum", 3).output


def test_a_saved_record_of_an_own_problem_guards_it(folder: Path) -> None:
    command(f"bench {OWN} --save own.json")
    assert "same" in command("bench everywhere:step --against own.json -q").output


@pytest.mark.parametrize("problem", ["kepler", "toda"])
def test_laws_about_many_steps_fit_the_problems_beyond_the_paper(problem: str) -> None:
    # Kepler's steps are as long as its slopes allow; Toda's lattice starts at y = 0, where no
    # rounding has a size.
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


def test_a_list_can_be_narrowed_to_the_rows_with_some_words() -> None:
    found = command("list casimir friction", 0)
    assert "invariant:casimir" in found.output
    assert "Schemes" not in found.output
    wrong = command("list enrgy", 2)
    assert "did you mean 'energy'?" in wrong.output


def test_exact_takes_a_problem_of_python_functions_in_float64(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "posed.py").write_text(
        "import numpy as np, sepv\n"
        "problem = sepv.Problem(2, ((0, -1), (1, 0)), lambda y: y[0]**2 / 2 - np.cos(y[1]), initial=(0.2, 1.0))\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    found = command("exact posed:problem --theta 8", 0).output
    (p,) = re.findall(r"y1 = (\S+)", found)
    # The pendulum's p at θ = 8 from (0.2, 1), 50 digits: −0.79300008860379348509…
    assert abs(float(p) + 0.79300008860379348509) < 1e-13
    assert "its error is at most" in found
