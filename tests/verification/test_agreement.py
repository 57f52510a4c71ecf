"""*agreement*: two programs of one method agree up to roundings, and a port with a fault does
not.
"""

import json
import shlex
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from doors import ROOT, command, obeys

import sepv
from benchmarks.right_schemes.twins import ports
from sepv import Effort, Scheme, StatefulStep, schemes
from sepv.faults.saboteurs import SABOTEURS
from sepv.faults.saboteurs.twins import euler_heun, port_of
from sepv.problem import Array, Problem
from sepv.schemes import Twin
from sepv.verification import ALL_LAWS, LAWS, Finding, Run, Verdict, load_laws, measure

(LAW,) = load_laws(["agreement"])
LITTLE = Effort(shrink_checks=0)
PORTS = ports()
# Thirty digits and a hundred nodes take a second each: in the deep run.
SLOW = ("mpmath-rounded", "lists-and-fsum")


def compared(a: Any, b: Any, bits: bool = False, effort: Effort = LITTLE, **how: Any) -> Finding:
    """What *agreement* finds about two programs."""
    return sepv.verify(a, laws="agreement", agrees_with=b, bits=bits, effort=effort, **how).finding(
        "agreement"
    )


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.deep] * n.endswith(SLOW)) for n in PORTS]
)
def test_two_right_programs_of_one_method_agree(name: str) -> None:
    found = measure(LAW, PORTS[name], Run(LITTLE))
    assert found.verdict is Verdict.HOLDS, found.message
    assert found.defect is not None
    assert found.bound is not None
    assert found.bound < 1e4 or "sweeps" in name or "scipy" in name  # the two that state a tolerance


@pytest.mark.deep
@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("name", PORTS)
def test_two_right_programs_agree_with_every_seed(name: str, seed: int) -> None:
    found = measure(LAW, PORTS[name], Run(Effort(seed=seed, shrink_checks=0)))
    assert found.verdict is Verdict.HOLDS, found.message


def test_a_twin_off_by_an_ulp_holds_and_is_violated_where_equal_bits_are_asked() -> None:
    off = SABOTEURS["port-off-by-an-ulp"].scheme.step
    assert compared(off, "euler-heun").verdict is Verdict.HOLDS
    found = compared(off, "euler-heun", bits=True)
    assert found.verdict is Verdict.VIOLATED
    assert found.bound == 0
    assert found.defect is not None
    assert 0 < found.defect <= 1
    assert "roundings may cause it" in found.message
    assert compared("euler-heun", "euler-heun", bits=True).verdict is Verdict.HOLDS


def test_zeros_of_both_signs_have_other_bits() -> None:
    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        return np.where(y == 0, -0.0, y)

    def plain(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        return y + 0.0

    assert compared(step, plain).verdict is Verdict.HOLDS
    assert compared(step, plain, bits=True).verdict is Verdict.VIOLATED


def test_a_violation_names_the_components_and_the_first_step_that_part() -> None:
    half = sepv.verify(
        port_of(schemes.euler_heun, SABOTEURS["port-with-another-half"].scheme.step),
        laws="agreement", agrees_with="euler-heun",
    )  # fmt: skip
    found = half.finding("agreement")
    # In the simplified case y2 does not move.
    assert "apart: component 1 by" in found.message
    assert "bound" in found.message
    assert half.replay("agreement").verdict is Verdict.VIOLATED
    later = compared(SABOTEURS["port-wrong-from-step-5"].scheme.step, "euler-heun", effort=Effort())
    assert "step 5 of" in later.message


def test_the_path_of_a_scheme_with_memory_is_compared_with_that_of_a_scheme_without() -> None:
    def frozen(problem: Problem, state: Any, h: float, dW: Array) -> Any:
        y, made = state
        return (y if made else euler_heun(problem, y, h, dW)), made + 1

    stuck = StatefulStep(lambda _, y: (y.copy(), 0), frozen, lambda state: state[0].copy())
    for a, b in ((stuck, "euler-heun"), ("euler-heun", stuck)):
        found = compared(a, b, effort=Effort(shrink_checks=60))
        assert found.verdict is Verdict.VIOLATED
        assert "step 2 of 2" in found.message


def test_an_array_that_a_program_uses_again_hides_no_difference() -> None:
    kept: dict[int, Array] = {}

    def into(problem: Problem, y: Array, h: float, dW: Array, half: float) -> Array:
        out = kept.setdefault(len(y), np.empty(len(y)))
        out[:] = euler_heun(problem, y, h, dW, half)
        return out

    def wrong(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        return into(problem, y, h, dW, 0.5 + 1e-9)

    def right(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        return into(problem, y, h, dW, 0.5)

    assert compared(wrong, right).verdict is Verdict.VIOLATED


def _refusing(where: Any, answer: Any = None) -> Any:
    """Euler-Heun with a refusal, or the number `answer`, where `where(h, dW)` says so."""

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        if where(h, dW):
            if answer is not None:
                return np.full_like(y, answer)
            raise ArithmeticError("too much noise")
        return euler_heun(problem, y, h, dW)

    return step


def _noisy(_: float, dW: Array) -> bool:
    return bool(np.any(np.abs(dW) > 0.25))


def test_two_programs_that_refuse_the_same_steps_agree() -> None:
    found = compared(_refusing(_noisy), _refusing(_noisy))
    assert found.verdict is Verdict.HOLDS
    assert "refused by both" in found.message
    never = _refusing(lambda *_: True)
    nothing = compared(never, never)
    assert nothing.verdict is Verdict.NOT_APPLICABLE
    assert "no step was made by both" in nothing.message


def test_a_step_that_one_program_refuses_is_named_and_not_judged() -> None:
    found = compared(_refusing(_noisy), "euler-heun")
    assert found.verdict is Verdict.HOLDS
    assert found.share is not None
    assert "refuses a step that euler-heun makes" in found.message
    assert "too much noise" in found.message
    mostly = compared(_refusing(lambda h, dW: bool(np.any(dW)) or h > 2.0**-10), "euler-heun")
    assert mostly.verdict is Verdict.INCONCLUSIVE
    assert "too few" in mostly.message


def test_a_nan_where_the_other_has_numbers_is_a_difference() -> None:
    assert compared(_refusing(_noisy, np.nan), "euler-heun").verdict is Verdict.VIOLATED
    assert compared("euler-heun", _refusing(_noisy, np.nan)).verdict is Verdict.VIOLATED
    assert compared(_refusing(_noisy, np.nan), _refusing(_noisy)).verdict is Verdict.HOLDS


def test_a_fault_names_the_program_that_made_it() -> None:
    found = compared("euler-heun", SABOTEURS["port-in-place"].scheme)
    assert found.verdict is Verdict.ERROR
    assert "port-in-place: Expected y unchanged by the step" in found.message


def test_a_solver_that_stops_early_is_told_to_state_its_tolerance() -> None:
    early = SABOTEURS["port-that-stops-early"].scheme.step
    found = compared(early, "midpoint", effort=Effort())
    assert found.verdict is Verdict.VIOLATED
    assert "solver_tolerance" in found.message
    stated = Scheme("early", early, solver_tolerance=1e-9)
    assert compared(stated, "midpoint").verdict is Verdict.HOLDS
    assert compared("midpoint", stated).verdict is Verdict.HOLDS


def test_roundings_that_another_equation_magnifies_are_no_difference() -> None:
    """A term that (2.1) does not have, with a derivative of 1e7 along y:
    two orders of its sum part beyond r.
    """

    def steep(problem: Problem, y: Array, h: float, dW: Array, shift: float) -> Array:
        # Both are sin(1e7 |y|²/s²) h with s = max|y|, in another order of operations.
        size = float(np.max(np.abs(y))) or 1.0
        phase = float(np.sum((y / size) ** 2)) if shift else float(y @ y) / size**2
        return y + h * size * np.sin(1e7 * phase)

    def one(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        return steep(problem, y, h, dW, 0.0)

    def other(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        return steep(problem, y, h, dW, 1.0)

    assert compared(one, other, problems="rigid-body").verdict is Verdict.HOLDS


def test_without_a_second_program_the_law_is_not_asked() -> None:
    assert set(ALL_LAWS) - set(LAWS) == {"agreement"}
    assert [law.name for law in load_laws()] == list(LAWS)
    alone = sepv.verify("midpoint", laws="agreement").finding("agreement")
    assert alone.verdict is Verdict.NOT_APPLICABLE
    assert "--agrees-with" in alone.message
    report = sepv.verify("midpoint", laws="identity", agrees_with="midpoint", effort=LITTLE)
    assert [f.law for f in report.findings] == ["identity", "agreement"]
    with pytest.raises(sepv.UsageError, match="bits"):
        sepv.verify("midpoint", laws="identity", bits=True)
    with pytest.raises(sepv.TargetError, match="nonesuch"):
        sepv.verify("midpoint", laws="identity", agrees_with="nonesuch")


@pytest.mark.parametrize(
    ("a", "b", "words"),
    [
        (schemes.by_name("conformal"), schemes.by_name("several-structures"), "class"),
        (
            Scheme("areas", lambda *_: None, asks="areas"),
            Scheme("halves", lambda *_: None, asks="halves"),
            "asks for areas",
        ),
        (schemes.by_name("area-midpoint"), Scheme("still", lambda *_: None, order=2), "without noise"),
    ],
)
def test_programs_with_no_case_in_common_are_told_so(a: Scheme, b: Scheme, words: str) -> None:
    found = compared(a, b)
    assert found.verdict is Verdict.NOT_APPLICABLE
    assert words in found.message


def test_a_function_is_asked_on_the_class_of_its_original() -> None:
    original = schemes.by_name("stochastic-midpoint")

    def port(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        return original.step(problem, y, h, dW)

    for a, b in ((port, original), (original, port)):
        found = compared(a, b, bits=True)
        assert found.verdict is Verdict.HOLDS, found.message


PORT = """
import numpy as np

def step(problem, y, h, dW, half=0.5):
    def field(v):
        return problem.structure(v) @ problem.gradient(v)
    S = float(problem.c @ dW)
    return y + h * field(y) + half * S * (field(y) + field(y + h * field(y) + S * field(y)))

def wrong(problem, y, h, dW):
    return step(problem, y, h, dW, 0.5 + 1e-9)
"""


@pytest.fixture
def port(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "a_port.py").write_text(PORT)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


@pytest.mark.usefixtures("port")
def test_the_command_line_compares_replays_and_pins() -> None:
    done = command("sepv verify a_port:wrong --agrees-with euler-heun --law agreement"[5:], 1)
    (again,) = [line for line in done.output.splitlines() if line.strip().startswith("sepv verify")]
    assert "--agrees-with euler-heun" in again
    replayed = command(again.strip()[5:], 1)
    assert "agreement violated" in replayed.output
    right = "verify a_port:step --agrees-with euler-heun --law agreement --json right.json --html right.html"
    assert "claimed law holds" in command(f"{right} --pin pin.toml").output
    report = json.loads(Path("right.json").read_text())
    obeys(report, "report")
    assert report["scheme"]["twin"] == {"name": "euler-heun", "target": "euler-heun", "bits": False}
    page = Path("right.html").read_text()
    assert "agreement" in page
    assert "euler-heun" in page
    command("verify a_port:step --agrees-with euler-heun --law agreement --expected pin.toml")
    command("verify a_port:step --agrees-with euler-heun --law agreement --against right.json")
    beyond = "verify a_port:step --agrees-with a_port:wrong --law agreement,identity -j 2"
    assert "depends" not in command(beyond, 1).output
    command("verify a_port:step --bits --law identity", 2)


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_programs_are_compared_with_each_other_and_with_python(tmp_path: Path) -> None:
    program = tmp_path / "midpoint"
    source = ROOT / "examples" / "midpoint.c"
    subprocess.run(["cc", "-O2", "-o", str(program), str(source), "-lm"], check=True)
    named = shlex.quote(f"exec:{program}")
    for line in (
        f"verify {named} --agrees-with midpoint --law agreement",
        f"verify midpoint --agrees-with {named} --law agreement",
        f"verify {named} --agrees-with {named} --bits --law agreement,identity -j 2",
    ):
        assert "agreement  yes      holds" in command(line, COLUMNS="120").output


def test_a_twin_without_a_name_is_replayed_in_python() -> None:
    wrong = SABOTEURS["port-with-another-half"].scheme.step
    report = sepv.verify("euler-heun", laws="agreement", agrees_with=Scheme("port", wrong), effort=LITTLE)
    assert "report.replay" in report.again(report.finding("agreement"))
    assert report.replay("agreement").verdict is Verdict.VIOLATED
    named = sepv.verify(
        "euler-heun", laws="agreement", agrees_with=Twin(Scheme("p", wrong), words="p:q"), effort=LITTLE
    )
    assert "--agrees-with p:q" in named.again(named.finding("agreement"))
