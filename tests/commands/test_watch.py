"""Whatever happens to the process of a command, it ends with a word: Ctrl-C at any moment,
a crash in compiled code.
"""

import contextlib
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
from doors import but_deep, ended

from benchmarks import hostile_steps

# From the first line of `main` on, with SIGINT as a terminal has it; who waits is told when that
# is.
START = (
    "import os, signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    "from sepv.commands import main; os.write(1, b'.'); main()"
)
# A machine may be loaded: this is a limit against hanging. Who watches kills what has not answered
# after 1.2 s.
SOON = 60.0
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
    at_random_moments(tmp_path, arguments, 3)


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
    """Interrupt a run at random moments until `count` answers have come;
    a run that ended before is begun again.

    The interval of moments becomes shorter with each such run, so that the moments come in the end.
    """
    whole, rng, answers = length_of(folder, arguments), random.Random(7), list[float]()
    for _ in range(4 * count):
        child = started(folder, arguments)
        time.sleep(rng.uniform(0.0, 0.9 * whole))
        if child.poll() is not None:  # it was faster than the first
            child.communicate()
            whole *= 0.9
            continue
        out, err, seconds = interrupted(child)
        if child.returncode == 0 and "sepv: interrupted" not in err:
            # It had ended, and only Python's own end was left. What swallows Ctrl-C would go on for
            # longer.
            assert seconds < 0.5 + 0.25 * whole, (seconds, whole, out, err)
            continue
        require_answered(child, out, err)
        answers.append(seconds)
        if len(answers) == count:
            break
    assert len(answers) == count, f"{len(answers)} of {4 * count} runs were still there to be interrupted"
    print(f"{arguments}: {count} moments, the longest answer took {max(answers):.2f} s")


SCHEMES = Path(hostile_steps.__file__).read_text(encoding="utf-8")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "mine.py").write_text(SCHEMES)
    return tmp_path


@pytest.mark.parametrize(("scheme", "times"), [("destroys", 1), ("eats", 1), ("eats", 2)])
def test_ctrl_c_that_is_eaten_is_answered(scheme: str, times: int, folder: Path) -> None:
    """By a destructor, as Hypothesis' callback of the garbage collector ate it,
    or by a step that catches all.
    """
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
    """A break point reads from the terminal of the command;
    under `python -m pdb` all runs in one process.
    """
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


@pytest.mark.parametrize("scheme", ["eats", "spins"])
def test_a_command_that_is_killed_leaves_no_process(scheme: str, folder: Path) -> None:
    """A process in a loop of compiled code ran on, because the thread that saw the end did not
    run.
    """
    child = started(folder, f"verify mine:{scheme} --law energy -q")
    wait_for(folder / "begun")
    workers = list(map(int, Path(f"/proc/{child.pid}/task/{child.pid}/children").read_text().split()))
    assert workers
    child.kill()
    child.communicate(timeout=SOON)
    assert ended(workers, SOON)


def test_two_programs_and_their_own_processes_end_with_the_command(folder: Path) -> None:
    """SIGTERM ended the group of the first program only."""
    if sys.platform != "linux":
        pytest.skip("/proc tells which processes there are")
    for name in ("one", "two"):
        (folder / name).write_text(
            f"#!{sys.executable}\nimport os, subprocess\n"
            "helper = subprocess.Popen(['sleep', '300'])\n"
            f"open('{name}.pids', 'w').write(f'{{os.getpid()}} {{helper.pid}}')\n{PROGRAM}"
        )
        (folder / name).chmod(0o755)
    line = "verify --exec ./one --agrees-with exec:./two --law agreement -q --examples 1000000"
    child = started(folder, line)
    pids = []
    for name in ("one", "two"):
        wait_for(folder / f"{name}.pids")
    time.sleep(0.2)  # the text of a file follows the file
    for name in ("one", "two"):
        pids += map(int, (folder / f"{name}.pids").read_text().split())
    child.terminate()
    child.communicate(timeout=SOON)
    assert child.returncode == -signal.SIGTERM
    assert ended(pids, SOON)


def test_a_loop_that_nothing_interrupts_is_told_from_outside(folder: Path) -> None:
    """In a thread of one's own program; not even a warning came."""
    (folder / "own.py").write_text(
        "import threading, mine, sepv, sepv.children._bell as bell\n"
        "assert bell.KILL_GRACE > 0\nbell.KILL_GRACE = -58\n"  # two seconds
        "threading.Thread(target=lambda: sepv.verify(mine.spins, laws='energy', timeout=60)).start()\n"
    )
    child = subprocess.Popen([sys.executable, "own.py"], cwd=folder, stderr=subprocess.PIPE, text=True)
    try:
        assert child.stderr
        said = child.stderr.readline()
    finally:
        child.kill()
        child.communicate(timeout=SOON)
    assert "the time limit of 60 s, which cannot interrupt compiled code" in said
    assert f"`sepv verify`, or jobs=2 of sepv.verify, would have ended it; kill -9 {child.pid} ends" in said


# Seconds of a law for a scheme that does not end: the others need less, on a loaded machine too.
LIMIT = 15.0


@pytest.mark.parametrize(
    ("scheme", "jobs"),
    but_deep(
        [
            ("spins", 1),
            ("spins", 2),
            ("swallows", 1),
            ("swallows", 2),
            ("is_deaf", 1),
            ("stops", 1),
            ("stops", 2),
        ],
        ("spins", 2),
        ("swallows", 1),
        ("stops", 1),  # each scheme and each number of jobs runs; these take 15 s each
    ),
)
def test_a_law_that_nothing_interrupts_is_ended_and_the_others_are_measured(scheme, jobs, folder):
    """Each ran without end: the exception of a time limit was not seen, or was caught."""
    laws = "energy,truncation"
    shown = crashed(
        folder,
        f"verify mine:{scheme} --law {laws} --timeout {LIMIT} -j {jobs} --json r.json -q",
    )
    found = {law["law"]: law for law in json.loads((folder / "r.json").read_text())["laws"]}
    assert found["energy"]["verdict"] == "error", shown
    assert "was killed: no end within 15 s (--timeout)" in found["energy"]["message"]
    assert found["truncation"]["verdict"] == "holds"


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_scheme_that_hangs_while_it_is_loaded_is_named(jobs: int, folder: Path) -> None:
    shown = crashed(folder, f"verify mine:eats --law identity --timeout 2 -j {jobs}")
    assert "was killed: no end within 2 s (--timeout) and 5 s more while it was loaded" in shown


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_copy_that_comes_back_from_a_step_ends_there(jobs: int, folder: Path) -> None:
    """The copy went on as a whole run, and its steps forked again."""
    child = subprocess.Popen(
        [sys.executable, "-m", "sepv", "verify", "mine:forks", "--law", "energy,truncation", "-j", str(jobs), "-q",
         "--json", "r.json"],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True,
    )  # fmt: skip
    try:
        shown, _ = child.communicate(timeout=6 * SOON)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child.pid, signal.SIGKILL)
    assert child.returncode == 3, shown
    assert shown.count("2 laws:") == 1, shown  # one run, one report
    found = {law["law"]: law for law in json.loads((folder / "r.json").read_text())["laws"]}
    assert found["energy"]["verdict"] == "error"
    assert "came back in the copy too" in found["energy"]["message"]
    assert found["truncation"]["verdict"] == "holds"
    assert (folder / "copies").stat().st_size < 40


@pytest.mark.parametrize(
    ("scheme", "words"),
    [("panics", "raised Panic"), ("raises_untold", "raised Untold: (its text cannot be made: ValueError)"),
     ("returns_untold", "Untold: (its text cannot be made: ValueError)"), ("removes", "changed numpy.isfinite")],
)  # fmt: skip
def test_what_a_scheme_raises_returns_or_removes_is_its_error_alone(
    scheme: str, words: str, folder: Path
) -> None:
    crashed(folder, f"verify mine:{scheme} --law casimir,truncation --shrink-checks 3 --json r.json -q")
    found = {law["law"]: law for law in json.loads((folder / "r.json").read_text())["laws"]}
    assert found["casimir"]["verdict"] == "error"
    assert words in found["casimir"]["message"]
    assert found["truncation"]["verdict"] == "holds"


def test_a_thread_and_a_process_that_a_scheme_leaves_behind_hold_nothing_up(folder: Path) -> None:
    """The replay in a fresh process was waited for until its limit of a minute,
    and never said anything.
    """
    child = started(folder, "verify mine:leaves_helpers --law energy --json r.json -q")
    with (
        child.stdout,
        child.stderr,
    ):  # whose end is not waited for: the process left behind holds it for minutes
        child.wait(timeout=6 * SOON)
    (law,) = json.loads((folder / "r.json").read_text())["laws"]
    assert law["verdict"] == "violated", law["message"]
    assert law["afresh"] == "violated"


@pytest.mark.parametrize("redirected", [">&-", "2>&-", ">/dev/full"])
def test_output_that_nobody_can_read_is_no_verdict(redirected: str, folder: Path) -> None:
    """A closed stdout ended in 1, as a violated law does, and a full device in 2."""
    done = in_shell(f"{{sepv}} verify midpoint --law identity -q {redirected}", folder)
    assert done.returncode == 70
    assert len((done.stdout + done.stderr).splitlines()) == 1, done.stdout + done.stderr


@pytest.mark.parametrize("limit", ["-n 6", "-v 60000"])
def test_a_system_that_refuses_is_no_verdict(limit: str, folder: Path) -> None:
    done = in_shell(f"ulimit {limit}; exec {{sepv}} verify midpoint --law identity", folder)
    assert done.returncode == 70, done.stdout + done.stderr
    assert "no verdict" in done.stderr
    assert "Traceback" not in done.stderr


def in_shell(line: str, folder: Path) -> subprocess.CompletedProcess[str]:
    line = line.format(sepv=f"{sys.executable} -m sepv")
    return subprocess.run(
        ["bash", "-c", line], cwd=folder, capture_output=True, text=True, timeout=6 * SOON, check=False
    )


def test_a_program_that_kills_sepv_does_not_stay_behind(folder: Path) -> None:
    """Linux tells a process that its parent has died; elsewhere it sees the end of stdin."""
    if sys.platform != "linux":
        pytest.skip("no signal tells a parent's death")
    program = folder / "program"
    program.write_text(
        f"#!{sys.executable}\nimport os, signal, time\nfrom pathlib import Path\n"
        "Path('pids').open('a').write(f'{os.getpid()}\\n')\n"
        "os.kill(os.getppid(), signal.SIGKILL)\ntime.sleep(300)\n"
    )
    program.chmod(0o755)
    crashed(folder, "verify --exec ./program --law identity -q")
    assert ended(map(int, (folder / "pids").read_text().split()))


@pytest.mark.parametrize(
    ("start", "target"),
    [
        (["-m", "sepv"], "mine:step"),
        (["-c", "from sepv.commands import main; main()"], "energy-preserving"),
    ],
)
def test_modules_of_the_folder_hide_none_of_pythons(start: list[str], target: str, folder: Path) -> None:
    """A worker and a replay ran the folder's queue.py, 35 times in a run, and blamed the scheme."""
    for name in ("queue", "random", "sepv", "secrets"):
        if name != "sepv" or start[0] != "-m":  # `python -m sepv` is the folder's, as Python itself says
            (folder / f"{name}.py").write_text("open('ran', 'a').write(__name__)\n")
    (folder / "helper.py").write_text("from sepv.schemes._midpoint import step\n")
    (folder / "mine.py").write_text(
        "import random\nfrom helper import step as right\n"
        "def step(problem, y, h, dW):\n    return 1.001 * right(problem, y, h, dW)\n"
    )
    words = ["verify", target, "--law", "identity,energy", "-j", "2", "-q", "--examples", "2"]
    done = subprocess.run(
        [sys.executable, *(["-P"] if start[0] == "-c" else []), *start, *words], cwd=folder, capture_output=True,
        text=True, timeout=6 * SOON, check=False,
    )  # fmt: skip
    assert "2 laws: " in done.stdout, done.stdout + done.stderr
    assert done.returncode == 0
    assert not (folder / "ran").exists()
