"""Four doors onto one list of laws: the same scheme gets the same verdicts at each.
And Ctrl-C in a run of them.
"""

import json
import re
import shlex
import sys
from pathlib import Path
from typing import Any

import pytest
from doors import ROOT, Reader, but_deep, command

from sepv.external import load_program
from sepv.verification import LAWS, Effort, Finding, Law, verify
from sepv.verification import _verify as suite

EXAMPLES, PATHS, SHRINK, SEED = 2, 256, 10, 4
EFFORT = Effort(EXAMPLES, PATHS, SEED, SHRINK)


@pytest.fixture(scope="module")
def at_home() -> dict[str, str]:
    """The Euler-Heun scheme through ``sepv.verify``."""
    report = verify("euler-heun", effort=EFFORT)
    assert [f.law for f in report.findings] == list(LAWS)
    return {f.law: f.verdict.text for f in report.findings}


def test_the_command_line_says_the_same(at_home: dict[str, str], tmp_path: Path) -> None:
    file = tmp_path / "report.json"
    numbers = f"--examples {EXAMPLES} --paths {PATHS} --shrink-checks {SHRINK} --seed {SEED}"
    command(f"verify euler-heun {numbers} --json {file}")
    laws = json.loads(file.read_text())["laws"]
    assert {x["law"]: x["verdict"].replace("_", " ") for x in laws} == at_home


def test_pytest_says_the_same(at_home: dict[str, str], reader: Reader) -> None:
    few = f"--sepv-examples {EXAMPLES} --sepv-paths {PATHS} --sepv-shrink-checks {SHRINK} --sepv-seed {SEED}"
    # The two that take longest are left to the other doors.
    left_out = ("contract", "reproducibility")
    line = f"-p sepv.pytest_plugin --pyargs sepv.properties {few} --scheme euler-heun"
    shown = reader.pytest(*line.split(), "-k", " and ".join(f"not {law}" for law in left_out))
    rows = re.findall(r"^  (\S+) +([a-z ]+?)(?: \+)?$", shown, re.MULTILINE)
    assert dict(rows) == {law: verdict for law, verdict in at_home.items() if law not in left_out}


# *reproducibility* has batches of thousands, which take half a minute as JSON, and *contract*
# thousands of steps.
@pytest.mark.parametrize("left_out", but_deep([("reproducibility contract",), ("",)], ("",)))
def test_a_program_of_another_language_gets_the_same(at_home: dict[str, str], left_out: str) -> None:
    # Plain Python without sepv and NumPy: rounding is its own, verdicts are not.
    command = shlex.join([sys.executable, "-I", "-S", str(ROOT / "examples" / "euler_heun_plain.py")])
    with load_program(command) as scheme:
        report = verify(scheme, laws=[law for law in LAWS if law not in left_out.split()], effort=EFFORT)
    found = {f.law: f.verdict.text for f in report.findings}
    # Whether h f + S f cancels to the last bit at Δ = 0 is a matter of rounding: Euler-Heun does
    # not claim it.
    asked = {law: verdict for law, verdict in at_home.items() if law not in left_out.split()}
    # And the program refuses the steps that leave the octant, where the scheme of sepv leaves it.
    assert {**found, **{law: at_home[law] for law in ("identity", "positivity")}} == asked


def test_ctrl_c_keeps_what_was_decided(reader: Reader, monkeypatch: pytest.MonkeyPatch) -> None:
    """While the second law is measured; what a signal does to processes is asked in
    test_watch.py.
    """

    def measured(law: Law, *rest: Any, **more: Any) -> Finding:
        if law.name == "energy":
            raise KeyboardInterrupt
        return measure(law, *rest, **more)

    measure = suite.measure
    monkeypatch.setattr(suite, "measure", measured)
    files = "--json r.json --junit r.xml --badge b.json"
    shown = command(f"verify midpoint --law identity,energy,casimir --examples 2 {files}", 130).output
    assert "Interrupted: what was not measured is not judged." in shown
    assert "not found to hold" not in shown
    report = json.loads((reader.folder / "r.json").read_text())
    assert [x["verdict"] for x in report["laws"]] == ["holds", "not_measured", "not_measured"]
    assert sum(report["counts"].values()) == len(report["laws"])
    assert (reader.folder / "r.xml").exists()
    assert (reader.folder / "b.json").exists()
