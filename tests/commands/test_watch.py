"""Whatever happens to the process of a command, it ends with a word: Ctrl-C at any moment, a crash in compiled code."""

import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

# From the first line of `main` on, with SIGINT as a terminal has it; who waits is told when that is.
START = (
    "import os, signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    "from sepv.commands import main; os.write(1, b'.'); main()"
)
# A machine may be loaded: this is a limit against hanging. Who watches kills what has not answered after 1.2 s.
SOON = 20.0
PROGRAM = """
import json, sys
for line in sys.stdin:
    m = json.loads(line)
    if m["type"] == "stop":
        break
    hello = {"protocol": 1, "scheme": "still", "polynomial": True}
    print(json.dumps({"id": m["id"], **(hello if m["type"] == "hello" else {"y_next": [s["y"] for s in m["steps"]]})}))
    sys.stdout.flush()
"""
VERIFY = "verify energy-preserving --law identity,casimir,truncation -q"


def started(folder: Path, arguments: str) -> subprocess.Popen[str]:
    child = subprocess.Popen(
        [sys.executable, "-c", START, *arguments.split()],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, bufsize=0,
    )  # fmt: skip
    assert child.stdout
    assert os.read(child.stdout.fileno(), 1) == b"."
    return child


def interrupted(child: subprocess.Popen[str], times: int = 1) -> tuple[str, str, float]:
    begun = time.monotonic()
    for n in range(times):
        time.sleep(0.05 * (n > 0))
        child.send_signal(signal.SIGINT)
    out, err = child.communicate(timeout=SOON)
    return out, err, time.monotonic() - begun


# The last lines of what shows what was done.
SHOWN = ("Interrupted: what was not measured is not judged.", "(interrupted)")


def require_answered(child: subprocess.Popen[str], out: str, err: str) -> None:
    """130 and one line, of the command or of its report."""
    assert child.returncode == 130, (child.returncode, out, err)
    assert err.count("sepv: interrupted") + sum(map(out.count, SHOWN)) == 1, (out, err)
    assert "Traceback" not in out + err, err
    assert "KeyboardInterrupt" not in out + err, err


def length_of(folder: Path, arguments: str) -> float:
    """Seconds of a run that nobody interrupts."""
    begun = time.monotonic()
    started(folder, arguments).communicate(timeout=6 * SOON)
    return time.monotonic() - begun


@pytest.mark.parametrize("arguments", [VERIFY, f"{VERIFY} -j 2"])
def test_ctrl_c_at_random_moments_is_answered(arguments: str, tmp_path: Path) -> None:
    at_random_moments(tmp_path, arguments, 6)


@pytest.mark.deep
@pytest.mark.parametrize(
    "arguments",
    [
        VERIFY, f"{VERIFY} -j 2", "verify --exec ./program --law identity,energy -q",
        "compare midpoint euler-heun --paths 64 --repeats 1 -q", "reproduce 4.4 --quick --workers 2 -q",
        "run midpoint --steps 1e4 -q", "report a.json --out r.html",
    ],
)  # fmt: skip
def test_ctrl_c_at_two_hundred_random_moments_is_answered(arguments: str, tmp_path: Path) -> None:
    """Of them 1 in 128 was eaten before, each by the callback of a garbage collection."""
    program = tmp_path / "program"
    program.write_text(f"#!{sys.executable}\n{PROGRAM}")
    program.chmod(0o755)
    started(tmp_path, "verify midpoint --law identity,energy -q --json a.json").communicate(timeout=SOON)
    at_random_moments(tmp_path, arguments, 200)


def at_random_moments(folder: Path, arguments: str, count: int) -> None:
    whole, rng, longest = length_of(folder, arguments), random.Random(7), 0.0
    for _ in range(count):
        child = started(folder, arguments)
        time.sleep(rng.uniform(0.0, 0.9 * whole))
        if child.poll() is not None:  # it was faster than the first
            child.communicate()
            continue
        out, err, seconds = interrupted(child)
        if child.returncode == 0 and "sepv: interrupted" not in err:
            # It had ended, and only Python's own end was left. What swallows Ctrl-C would go on for longer.
            assert seconds < 0.5 + 0.25 * whole, (seconds, whole, out, err)
            continue
        require_answered(child, out, err)
        longest = max(longest, seconds)
    print(f"{arguments}: {count} moments, the longest answer took {longest:.2f} s")


SCHEMES = """
import ctypes, os, time
from pathlib import Path
from sepv.schemes._midpoint import step as midpoint
def falls(problem, y, h, dW):
    if problem.dimension == 5 and problem.random_step(h, dW) and problem.gradient(y).any():
        ctypes.string_at(0)  # in no case of the law identity
    return midpoint(problem, y, h, dW)
def leaves(problem, y, h, dW):
    if problem.name not in ("pendulum", "rigid-body"):
        os._exit(0)
    return midpoint(problem, y, h, dW)
def aborts(problem, y, h, dW):
    os.abort()
calls = 0
def hides(problem, y, h, dW):
    global calls
    calls += 1
    if calls > 40:
        ctypes.string_at(0)  # while the first violation is simplified
    return 1.001 * midpoint(problem, y, h, dW)
def eats(problem, y, h, dW):
    Path("begun").touch()
    while True:
        try:
            time.sleep(60)
        except BaseException:
            pass
class Destroyed:
    def __del__(self):
        Path("begun").touch()
        end = time.monotonic() + 0.6
        while time.monotonic() < end:
            pass
def destroys(problem, y, h, dW):
    Destroyed()
    return midpoint(problem, y, h, dW)
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "mine.py").write_text(SCHEMES)
    return tmp_path


@pytest.mark.parametrize(("scheme", "times"), [("destroys", 1), ("eats", 1), ("eats", 2)])
def test_ctrl_c_that_is_eaten_is_answered(scheme: str, times: int, folder: Path) -> None:
    """By a destructor, as Hypothesis' callback of the garbage collector ate it, or by a step that catches all."""
    child = started(folder, f"verify mine:{scheme} --law identity -q")
    wait_for(folder / "begun")
    require_answered(child, *interrupted(child, times)[:2])


def crashed(folder: Path, command: str) -> str:
    """What a command prints that ends in an error of its scheme."""
    child = started(folder, command)
    out, err = child.communicate(timeout=6 * SOON)
    assert child.returncode == 3, out + err
    return out + err


def wait_for(file: Path) -> None:
    end = time.monotonic() + SOON
    while not file.exists():
        assert time.monotonic() < end
        time.sleep(0.01)


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_a_segmentation_fault_ends_its_law_alone_and_its_case_is_named(jobs: str, folder: Path) -> None:
    """It ended `sepv verify` with 139 and no word."""
    command = f"verify mine:falls --law identity,energy,casimir -j {jobs} --shrink-checks 3 --json r.json"
    crashed(folder, command)
    laws = {law["law"]: law for law in json.loads((folder / "r.json").read_text())["laws"]}
    assert {name: law["verdict"] for name, law in laws.items()} == {
        "identity": "holds", "energy": "violated", "casimir": "error",
    }  # fmt: skip
    crash = laws["casimir"]
    assert "signal SIGSEGV" in crash["message"]
    assert len(crash["witness"]["y"]) == 5
    assert re.search(r"B\d\d\(y\) = ", crash["message"])
    # It is replayed by its token, and ends so again.
    assert "signal SIGSEGV" in crashed(folder, f"verify mine:falls {crash['replay']}")


def test_a_violation_before_a_segmentation_fault_is_not_lost(folder: Path) -> None:
    crashed(folder, "verify mine:hides --law energy --json r.json")
    (law,) = json.loads((folder / "r.json").read_text())["laws"]
    assert law["verdict"] == "error"
    assert "signal SIGSEGV" in law["message"]
    assert "violated, before:" in law["message"]
    (again,) = re.findall(r"Its replay: (.*)", law["message"])
    (folder / "mine.py").write_text(SCHEMES.replace("calls > 40", "False"))
    child = started(folder, f"verify mine:hides {again} --claim energy -q")
    assert "energy violated" in child.communicate(timeout=6 * SOON)[0]
    assert child.returncode == 1


@pytest.mark.parametrize(
    ("command", "once"),
    [
        ("verify mine:leaves --law identity -q", ["1 error"]),
        ("verify mine:aborts --law identity", ["the process ended with signal SIGABRT"]),
        ("run mine:aborts --steps 4", ["the process ended with signal SIGABRT"]),
        ("verify midpoint mine:falls --law identity,casimir --shrink-checks 3 -q",
         ["midpoint: 2 laws: 2 hold", "mine:falls: 2 laws: 1 holds, 1 error"]),
    ],
)  # fmt: skip
def test_a_step_that_ends_the_process_has_a_word_and_is_no_success(command, once, folder):
    shown = crashed(folder, command)
    assert [shown.count(words) for words in once] == [1] * len(once)


def test_a_debugger_sees_the_step(folder: Path) -> None:
    """A break point reads from the terminal of the command; under `python -m pdb` all runs in one process."""
    (folder / "mine.py").write_text("def step(problem, y, h, dW):\n    breakpoint()\n    return y.copy()\n")
    child = subprocess.run(
        [sys.executable, "-m", "sepv", "verify", "mine:step", "--law", "identity"],
        cwd=folder, input="p ('dimension', problem.dimension)\nq\n", capture_output=True, text=True, timeout=SOON,
        check=False,
    )  # fmt: skip
    assert "('dimension', 3)" in child.stdout
    traced = subprocess.run(
        [sys.executable, "-m", "pdb", "-c", "continue", "-m", "sepv", "list"],
        cwd=folder, input="q\n", capture_output=True, text=True, timeout=SOON, check=False,
    )  # fmt: skip
    assert "energy-preserving" in traced.stdout


def test_a_command_that_is_killed_leaves_no_process(folder: Path) -> None:
    child = started(folder, "verify mine:eats --law identity -q")
    wait_for(folder / "begun")
    (worker,) = map(int, Path(f"/proc/{child.pid}/task/{child.pid}/children").read_text().split())
    child.kill()
    child.communicate(timeout=SOON)
    end = time.monotonic() + SOON
    while Path(f"/proc/{worker}").exists() and time.monotonic() < end:
        time.sleep(0.01)
    assert not Path(f"/proc/{worker}").exists()
