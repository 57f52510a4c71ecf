"""What a user sees: tables, counterexamples, files, exit codes, and one clear message for each mistake."""

import re
from pathlib import Path

import pytest

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
    # Green, and not without a word: a renamed scheme is right, the file of another one is not.
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


def test_a_quiet_line_names_its_target_where_there_are_several(call) -> None:
    both = call("verify energy-preserving midpoint --law energy,identity --examples 2 -q").output.splitlines()
    assert [line.split(": ")[0] for line in both if line] == ["energy-preserving", "midpoint"]
    assert "midpoint: 2 laws: 1 holds, 1 violated; " in both[-1]
    (alone,) = call("verify midpoint --law identity --examples 2 -q").output.splitlines()
    assert alone.startswith("1 law: 1 holds; ")


def test_arguments_in_another_order_are_named_before_anything_is_measured(call) -> None:
    code = "def step(y, problem, h, dW):\n    return y\n"
    result = call("verify mine:step --law energy", code)
    assert result.exit_code == 3
    assert "step(problem, y, h, dW)" in result.output
    assert "Received mine:step(y, problem, h, dW): the same names in another order." in result.output


@pytest.mark.parametrize(
    ("arguments", "raised"), [("u, system, dt, xi", "Attribute"), ("system, u, xi, dt", "Type")]
)
def test_other_names_in_another_order_end_in_an_error_that_says_what_was_called(call, arguments, raised):
    code = f"def step({arguments}):\n    return u + system.random_step(dt, xi) * system.gradient(u)\n"
    said = call("verify mine:step --law energy --examples 2", code).output
    assert f"The scheme raised {raised}Error" in said
    # In the author's file, and not in the function of sepv that was given the wrong thing.
    assert re.search(r"mine\.py, line \d+, in step\)", said)
    called = r"called with the problem [^,]+, y of shape \(2,\), h = [\d.]+, dW of shape \(\d+,\)"
    assert re.search(called, said)


def test_a_refusal_by_a_function_of_sepv_is_the_schemes_error(call) -> None:
    """Not a usage error of the command, which would end the run with the advice for another mistake."""
    code = "def step(problem, y, h, dW):\n    return sepv.exact_flow(problem, 'x', y).y[:, 0]\n"
    result = call("verify mine:step --law energy --examples 2", code)
    assert result.exit_code == 3
    assert re.search(r"raised UsageError: Expected .* \(\S*mine\.py, line", result.output, re.DOTALL)


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


def test_several_targets_give_a_matrix(call) -> None:
    result = call("verify energy-preserving euler-heun --law energy,identity --examples 2 --shrink-checks 0")
    assert result.exit_code == 0
    assert "holds +" in result.output
    assert "+ claimed" in result.output


def test_a_raising_scheme_is_an_error_of_every_law_and_debug_shows_it(call) -> None:
    code = "def step(problem, y, h, dW):\n    raise RuntimeError('out of order')\n"
    result = call("verify mine:step --examples 2 --paths 64 --shrink-checks 2", code)
    assert result.exit_code == 3
    # Truncation is about the increments that the scheme asks for, a function of one state has no batch, and some
    # laws are for schemes of another class of systems.
    assert f"7 not applicable, {len(LAWS) - 7} errors" in result.output
    assert "out of order" in result.output
    shown = call("verify mine:step --examples 2 --law energy --debug", code)
    assert "Traceback" in shown.output or isinstance(shown.exception, RuntimeError)
