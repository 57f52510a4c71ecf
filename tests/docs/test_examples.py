"""The programs in examples/, by their laws and by the protocol, and the conversation printed in docs/protocol.md."""

import re
import shlex
import shutil
import subprocess
import sys

import numpy as np
import pytest
from doors import ROOT, block_in, doc, python, verdicts

from sepv import external, problems, schemes
from sepv.external import Program, check_protocol, load_program
from sepv.external._errors import StepRefused
from sepv.problem import PolynomialSystem
from sepv.record import polynomial
from sepv.verification import LAWS


@pytest.fixture(scope="session")
def midpoint_c(tmp_path_factory):
    """The command of examples/midpoint.c, built with the system's compiler."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler `cc` on this system")
    program = tmp_path_factory.mktemp("c") / "midpoint"
    subprocess.run([compiler, "-O2", "-o", program, ROOT / "examples" / "midpoint.c", "-lm"], check=True)
    return str(program)


@pytest.fixture(scope="session")
def euler_heun_plain():
    """The command of examples/euler_heun_plain.py, which sees no installed package (-I -S)."""
    return shlex.join([sys.executable, "-I", "-S", str(ROOT / "examples" / "euler_heun_plain.py")])


def found(command: str, laws: list[str]) -> dict[str, str]:
    with load_program(command) as scheme:
        return verdicts(scheme, laws, examples=2, paths=1024, shrink_checks=10)


def test_the_midpoint_rule_in_c_obeys_what_theory_says_and_no_more(midpoint_c):
    holds = ["contract", "identity", "casimir", "midpoint", "symmetry", "mean-square-order", "right-limit"]
    assert found(midpoint_c, [*holds, "energy"]) == {**dict.fromkeys(holds, "holds"), "energy": "violated"}


def test_the_plain_python_example_has_the_order_that_it_claims_and_keeps_no_invariant(euler_heun_plain):
    # *contract* and the others are asked in test_same_verdicts_at_every_door.py.
    holds, broken = ["mean-square-order", "right-limit"], ["energy", "casimir", "symmetry"]
    expected = {**dict.fromkeys(holds, "holds"), **dict.fromkeys(broken, "violated")}
    assert found(euler_heun_plain, [*holds, *broken]) == expected


@pytest.mark.parametrize("name", ["harmonic-oscillator", "rigid-body", "pendulum"])
def test_the_examples_agree_with_the_schemes_of_sepv(midpoint_c, euler_heun_plain, name):
    problem = problems.by_name(name)
    y = np.asarray(problem.initial)[:, None] * np.linspace(0.5, 1.5, 600)
    step = problem, y, 0.0625, np.random.default_rng(2).standard_normal((problem.noises, 600)) / 8
    for command, own in ((midpoint_c, schemes.midpoint), (euler_heun_plain, schemes.euler_heun)):
        with load_program(command) as scheme:
            np.testing.assert_allclose(scheme.step(*step), own.step(*step), rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("example", ["midpoint_c", "euler_heun_plain"])
def test_the_examples_keep_the_protocol(request, example):
    checks = check_protocol(request.getfixturevalue(example), laws=LAWS)
    assert [c for c in checks if not c.ok] == []
    assert len(checks) > 12
    assert external.describe(checks).count("\n") > 2 * len(checks) - 2


# ---- docs/protocol.md ----


def conversation() -> list[tuple[str, str | None]]:
    """(what sepv writes, what the program answers) of the sample in the page."""
    turns: list[tuple[str, str | None]] = []
    for line in block_in(doc("protocol.md"), "text").splitlines():
        if line.startswith("> "):
            turns.append((line[2:], None))
        else:
            turns[-1] = (turns[-1][0], line.removeprefix("< "))
    return turns


def test_the_sample_of_the_page_is_what_the_program_in_c_answers(midpoint_c):
    turns = conversation()
    asked = "\n".join(line for line, _ in turns)
    done = subprocess.run([midpoint_c], input=asked, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [answer for _, answer in turns if answer is not None]


def test_the_sample_of_the_page_is_what_sepv_writes(tmp_path):
    turns = conversation()
    (tmp_path / "answers").write_text("".join(f"{answer}\n" for _, answer in turns if answer is not None))
    (tmp_path / "recorder.py").write_text(f"""
import sys
asked = open({str(tmp_path / "asked")!r}, "w")
for answer in open({str(tmp_path / "answers")!r}):
    asked.write(sys.stdin.readline())
    print(answer, end="", flush=True)
asked.write(sys.stdin.readline())
""")
    program = Program(shlex.join([sys.executable, "-I", "-S", str(tmp_path / "recorder.py")]))
    scheme = program.scheme()
    y = np.array([[1.0, 1.0], [0.5, 0.5]])
    y = scheme.step(problems.harmonic_oscillator(), y, 1.0, np.array([[1.0, -1.0]]))
    assert y.tolist() == [[-0.5, 1.0], [1.0, 0.5]]
    square = ((0, 1, polynomial(2, [((0, 0), 1.0), ((2, 0), 1.0)])),)
    unsolvable = problems.build(PolynomialSystem(2, polynomial(2, [((0, 1), 1.0)]), square, ()))
    with pytest.raises(StepRefused, match="no convergence"):
        scheme.step(unsolvable, np.zeros(2), 2.0, np.zeros(0))
    strange, unknown = (turns[n][0].split(",", 1)[1].rstrip("\n")[:-1] for n in (3, 4))
    assert program.ask(strange) == ("skip", "unknown problem")
    assert program.ask(unknown) == ("error", "unknown type of message")
    assert program.stop() == "exit code 0"
    assert (tmp_path / "asked").read_text().splitlines() == [line for line, _ in turns]


def test_energy_and_two_casimirs_in_four_dimensions_are_kept_to_rounding():
    out = python((ROOT / "examples" / "casimirs_in_four_dimensions.py").read_text(encoding="utf-8"))
    kept, lost = ([float(v) for v in re.findall(r"[HCD] (\S+?)(?:,|$)", line)] for line in out.splitlines())
    # 1000 steps round y ~ 1 by eps each: 8 eps √1000 as in `sepv.reference.paper.runs.rounding_bound`.
    assert max(kept) < 8 * 2.0**-52 * 1000**0.5
    assert lost[0] < 8 * 2.0**-52 * 1000**0.5 < 1e-7 < min(lost[1:])
