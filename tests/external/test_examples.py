"""The examples in C, C++, Fortran and Octave, each built and run if its tools are on the
machine.
"""

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sepv import external, problems, schemes, verify
from sepv.verification import LAWS, Effort

EXAMPLES = Path(__file__).parents[2] / "examples"
# How each example is built in a folder, and the command that runs it: (tools, commands, program,
# scheme of sepv).
BUILT = {
    "C": (
        ("cc",),
        ["cc -O2 -Wall -Wextra -Werror -o {out}/midpoint {in}/midpoint.c -lm"],
        "{out}/midpoint",
        "midpoint",
    ),
    "C, (2.1)": (
        ("cc",),
        ["cc -O2 -o {out}/ep {in}/energy_preserving.c -lm"],
        "{out}/ep",
        "energy-preserving",
    ),
    "C++": (
        ("c++",),
        ["c++ -O2 -Wall -x c++ -o {out}/midpoint {in}/midpoint.c"],
        "{out}/midpoint",
        "midpoint",
    ),
    "Fortran": (
        ("cc", "gfortran"),
        [
            "cc -O2 -c -x c {in}/client.h -o {out}/client.o",
            "gfortran -O2 -J{out} -o {out}/midpoint {in}/midpoint.f90 {out}/client.o",
        ],
        "{out}/midpoint",
        "midpoint",
    ),
    "Octave": (("octave-cli",), [], "octave-cli -qf {in}/midpoint.m", "midpoint"),
    "Octave, (2.1)": (("octave-cli",), [], "octave-cli -qf {in}/energy_preserving.m", "energy-preserving"),
}


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[str, str]]:
    """A function that builds an example once, and returns its command and the name of sepv's own
    scheme.
    """
    commands: dict[str, str] = {}

    def make(name: str) -> tuple[str, str]:
        tools, steps, program, own = BUILT[name]
        absent = [tool for tool in tools if shutil.which(tool) is None]
        if absent:
            pytest.skip(f"{', '.join(absent)}: not on this machine")
        if name not in commands:
            places = {"in": str(EXAMPLES), "out": str(tmp_path_factory.mktemp("built"))}
            for step in steps:
                subprocess.run(step.format(**places).split(), check=True)
            commands[name] = program.format(**places)
        return commands[name], own

    return make


@pytest.mark.parametrize("name", BUILT)
def test_an_example_keeps_the_protocol(built: Callable[[str], tuple[str, str]], name: str) -> None:
    checks = external.check_protocol(built(name)[0], laws=LAWS)
    assert [c for c in checks if not c.ok] == []
    assert len(checks) > 12


@pytest.mark.parametrize("name", BUILT)
def test_an_example_steps_as_the_scheme_of_sepv(built: Callable[[str], tuple[str, str]], name: str) -> None:
    command, own = built(name)
    with external.load_program(command) as scheme:
        for known in ("harmonic-oscillator", "rigid-body", "pendulum"):
            problem = problems.by_name(known)
            y = np.asarray(problem.initial)[:, None] * np.linspace(0.5, 1.5, 40)
            dW = np.random.default_rng(2).standard_normal((problem.noises, 40)) / 8
            ours = schemes.by_name(own).step(problem, y, 0.0625, dW)
            # Both equations are solved to rounding, with a condition number near 1 at these steps.
            np.testing.assert_allclose(scheme.step(problem, y, 0.0625, dW), ours, rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("name", ["C, (2.1)", "Fortran", "Octave"])
def test_an_example_keeps_the_invariants_that_it_claims(
    built: Callable[[str], tuple[str, str]], name: str
) -> None:
    command, own = built(name)
    with external.load_program(command) as scheme:
        report = verify(scheme, laws="energy,casimir", effort=Effort(examples=2, shrink_checks=10))
    expected = "holds" if own == "energy-preserving" else "violated"
    assert report.finding("energy").verdict.text == expected
    assert report.finding("casimir").verdict.text == "holds"
