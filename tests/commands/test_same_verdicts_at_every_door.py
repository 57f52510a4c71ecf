"""Four doors onto one list of laws: the same scheme gets the same verdicts at each. And Ctrl-C at any time."""

import json
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from doors import ROOT, command
from reader import Reader

from sepv.external import load_program
from sepv.verification import LAWS, Effort, verify

EXAMPLES, PATHS, SHRINK, SEED = 2, 256, 10, 4
EFFORT = Effort(EXAMPLES, PATHS, SEED, SHRINK)
# Far above what a loaded machine needs to end after Ctrl-C.
SOON = 30.0


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


# *reproducibility* has batches of thousands, which take half a minute as JSON.
@pytest.mark.parametrize("left_out", ["reproducibility", pytest.param("", marks=pytest.mark.deep)])
def test_a_program_of_another_language_gets_the_same(at_home: dict[str, str], left_out: str) -> None:
    # Plain Python without sepv and NumPy: rounding is its own, verdicts are not.
    command = shlex.join([sys.executable, "-I", "-S", str(ROOT / "examples" / "euler_heun_plain.py")])
    with load_program(command) as scheme:
        report = verify(scheme, laws=[law for law in LAWS if law != left_out], effort=EFFORT)
    found = {f.law: f.verdict.text for f in report.findings}
    # Whether h f + S f cancels to the last bit at Δ = 0 is a matter of rounding: Euler-Heun does not claim it.
    asked = {law: verdict for law, verdict in at_home.items() if law != left_out}
    # And the program refuses the steps that leave the octant, where the scheme of sepv leaves it.
    assert {**found, **{law: at_home[law] for law in ("identity", "positivity")}} == asked


def test_ctrl_c_keeps_what_was_decided(tmp_path: Path) -> None:
    # A scheme that sleeps from the moment at which the second law begins.
    (tmp_path / "mine.py").write_text(
        "import time\nfrom pathlib import Path\n"
        "def step(problem, y, h, dW):\n"
        "    if Path('second').exists():\n"
        "        Path('asleep').touch()\n"
        "        time.sleep(60)\n"
        "    return y.copy()\n"
    )
    (tmp_path / "run.py").write_text(
        "import signal\nfrom pathlib import Path\nfrom sepv.commands import main\n"
        "from sepv.verification import _verify as suite\n"
        # A shell that starts jobs in the background has them ignore SIGINT: here they shall not.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "run = suite.measure\n"
        "def watched(law, *rest):\n"
        "    if law.name == 'energy': Path('second').touch()\n"
        "    return run(law, *rest)\n"
        "suite.measure = watched\n"
        "main()\n"
    )
    words = "verify mine:step --law identity,energy,casimir --json r.json --junit r.xml --badge b.json"
    process = subprocess.Popen(
        [sys.executable, "run.py", *words.split()],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    with process:
        start = time.monotonic()
        while not (tmp_path / "asleep").exists() and time.monotonic() - start < SOON:
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=SOON)
    assert process.returncode == 130, out + err
    assert "Traceback" not in out + err
    report = json.loads((tmp_path / "r.json").read_text())
    assert [x["verdict"] for x in report["laws"]] == ["holds", "not_measured", "not_measured"]
    assert "Interrupted: what was not measured is not judged." in out
    assert "not found to hold" not in out
    assert sum(report["counts"].values()) == len(report["laws"])
    assert (tmp_path / "r.xml").exists()
    assert (tmp_path / "b.json").exists()
