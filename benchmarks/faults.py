"""Which faults does sepv survive? ``python -m benchmarks.faults`` prints how many of each kind it
tried and survived.

A fault is a command in a folder of its own with a step, a file, a signal or a system that
misbehaves. It is survived if the command ends in time with its exit code and words, without a
traceback or kilobytes of text; if the laws without the fault have their verdicts; and if no process
is left (Linux). Steps are those of `hostile_steps`. Two faults run at a time, ten minutes in all.
`--only` takes kinds that begin so; each fault that is not survived is printed.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from uuid import uuid4

from benchmarks import arguments, over, start
from sepv.console import markdown

# Seconds after which a command counts as hung; of a law's --timeout; until the processes of a
# command have ended.
HANG_SECONDS, LAW_TIMEOUT, ENDED_SECONDS = 240.0, 8, 5.0
# The most characters that a command may print: a page, but no name of megabytes.
PRINTED_MAX_CHARACTERS = 30_000
SEPV = f"{shlex.quote(sys.executable)} -m sepv"
PYTHON = f"{shlex.quote(sys.executable)} -P"
FAULT_VARIABLE = "SEPV_FAULT"
HOSTILE_STEPS = Path(__file__).with_name("hostile_steps.py").read_text(encoding="utf-8")
VERIFY = f"exec {SEPV} verify energy-preserving --law identity,casimir,truncation -q"


@dataclass(frozen=True)
class FaultyCommand:
    """A command that meets a fault: a line of bash, and what is expected of it."""

    kind: str
    line: str
    codes: tuple[int, ...]
    words: str = ""  # a pattern that the output must have
    files: dict[str, str] = field(default_factory=dict)
    verdicts: dict[str, str] = field(default_factory=dict)  # in the report r.json
    then: str = ""  # another line, which must end with exit code 0
    signal: int = 0  # sent to the command's process group,
    times: int = 1  # at so many moments of its run,
    at: str = ""  # or when this file exists
    hangs: bool = False  # its seconds are shown
    helpers: bool = False  # the step's own process may outlive the command


@dataclass(frozen=True)
class Survival:
    """What came of a fault: why it is not survived, or nothing; and the seconds until its end."""

    why: str
    seconds: float


def law(
    kind: str, step: str, words: str, jobs: int = 1, *, hangs: bool = False, measured: str = "energy"
) -> FaultyCommand:
    """A step that misbehaves in one law: this law is an error, in these words,
    and truncation is measured.
    """
    timeout = LAW_TIMEOUT if hangs else 60
    line = f"exec {SEPV} verify mine:{step} --law {measured},truncation --timeout {timeout} -j {jobs}"
    return FaultyCommand(
        kind, f"{line} --json r.json --shrink-checks 3", (3,), words, hangs=hangs,
        verdicts={measured: "error", "truncation": "holds"},
    )  # fmt: skip


PROGRAM_SOURCE = f"""#!{sys.executable}
import json, os, signal, sys, time
for line in sys.stdin:
    m = json.loads(line)
    if m["type"] == "stop":
        STOP
    hello = {{"protocol": 1, "scheme": "still", "polynomial": True}}
    ACT
    answer = hello if m["type"] == "hello" else {{"y_next": [s["y"] for s in m["steps"]]}}
    print(json.dumps({{"id": m["id"], **answer}}), flush=True)
"""
STORE = """
import sys, sepv
arguments = dict(h=1/16, T=0.5, paths=40_000, chunk=2048, seed=5, times=[0.25, 0.5], engine="numpy")
def computed(**more):
    ep, pendulum = sepv.schemes.energy_preserving, sepv.problems.pendulum()
    return sepv.ensemble(ep, pendulum, **arguments | more)
try:
    there = computed(store="paths.zarr")
    if sys.argv[1:]:
        assert (there.y[...] == computed().y).all()
except sepv.UsageError as error:
    raise SystemExit(f"refused: {error}")
"""
SMALL_STORE = STORE.replace("40_000", "4096")
# Ways to harm a file of a store.
HARMS = (
    ("zarr.json", "write_text('no JSON')"), ("zarr.json", "write_text('')"), ("y/zarr.json", "write_text('{')"),
    ("work/zarr.json", "write_bytes(b'\\xff\\xfe')"), ("y/zarr.json", "write_text(t.replace('float64', 'int32'))"),
    ("y/zarr.json", "write_text(t.replace('shape', 'form'))"),
    ("y/zarr.json", "write_text(t.replace('float', 'flaot'))"),
)  # fmt: skip
OFF_MAIN = """
import sys, threading, mine, sepv
def work():
    sepv.verify(getattr(mine, sys.argv[1]), laws="energy,truncation", timeout=20)
threading.Thread(target=work, daemon=True).start()
threading.Event().wait()
"""
# It ends when a line says how it is ended.
OFF_MAIN_LINE = f"{shlex.quote(sys.executable)} off.py %s & "
OFF_MAIN_LINE += "until grep -q 'kill -9' out; do sleep 0.2; done; kill -9 $!; wait $!"


def program(act: str = "pass", stop: str = "break") -> str:
    """A program that keeps the protocol, but does something else at each message, or at its end."""
    return PROGRAM_SOURCE.replace("ACT", act).replace("STOP", stop)


def signals() -> list[FaultyCommand]:
    """Signals from outside, at moments of a run, or while a step hangs."""
    lines = (VERIFY, f"{VERIFY} -j 2", f"exec {SEPV} compare midpoint euler-heun --paths 64 --repeats 1 -q")
    spins = f"exec {SEPV} verify mine:spins --law energy,truncation -q -j"
    two = {
        name: program("open('begun', 'a'); m['type'] == 'step' and time.sleep(3)") for name in ("one", "two")
    }
    both = f"exec {SEPV} verify --exec ./one --agrees-with exec:./two --law agreement -q"
    return [
        FaultyCommand("kill -9 of a store", f"exec {PYTHON} store.py", (-9,), files={"store.py": STORE}, times=5,
              signal=signal.SIGKILL, then=f"{PYTHON} store.py whole"),
        *(FaultyCommand("kill -9", line, (-9,), signal=signal.SIGKILL, times=4) for line in lines),
        *(FaultyCommand("kill -9", f"{spins} {jobs}", (-9,), signal=signal.SIGKILL, at="begun") for jobs in (1, 2)),
        *(FaultyCommand("Ctrl-C", line, (130,), signal=signal.SIGINT, times=7) for line in lines),
        FaultyCommand("Ctrl-C", f"exec {SEPV} verify mine:eats --law identity -q", (130,),
            signal=signal.SIGINT, at="begun",
              hangs=True),
        *(FaultyCommand("SIGTERM", line, (-15,), signal=signal.SIGTERM, times=3) for line in lines),
        FaultyCommand("SIGTERM", both, (-15,), files=two, signal=signal.SIGTERM, at="begun"),
    ]  # fmt: skip


def hangs() -> list[FaultyCommand]:
    """Steps that do not return, and programs that do not end."""
    endless = {
        "spins": "endless loop in C", "spins_compiled": "endless loop of numba", "is_deaf": "SIGALRM ignored",
        "swallows": "except: around the iteration", "stops": "SIGSTOP",
    }  # fmt: skip
    ends = (("time.sleep(300)", "no end within 2 s"), ("sys.exit(5)", "exit code 5"))
    return [
        *(law(kind, step, f"no end within {LAW_TIMEOUT} s", jobs, hangs=True)
          for step, kind in endless.items() for jobs in (1, 2)),
        *(FaultyCommand("sepv.verify in a thread", OFF_MAIN_LINE % step, (-9, 137), "`sepv verify`, or jobs=2",
                {"off.py": OFF_MAIN}, hangs=True) for step in ("swallows", "spins")),
        *(FaultyCommand("rule 7 of the protocol", f"exec {SEPV} verify --exec ./stays --law identity -q", (0,),
                f"broke rule 7 .*{how}", {"stays": program(stop=stop)}) for stop, how in ends),
    ]  # fmt: skip


def crashes() -> list[FaultyCommand]:
    """Steps that end or copy their process, and what they raise, return, remove and leave
    behind.
    """
    kills = {"kills": program("os.kill(os.getppid(), signal.SIGKILL); time.sleep(300)")}
    untold = "its text cannot be made"
    return [
        *(law("segmentation fault", "falls", "SIGSEGV", jobs, measured="casimir") for jobs in (1, 2)),
        *(law("os._exit in a step", "leaves", "exit code 0", jobs) for jobs in (1, 2)),
        *(law("fork in a step", "forks", "came back in the copy too", jobs) for jobs in (1, 2)),
        *(law("panic", "panics", "raised Panic", jobs) for jobs in (1, 2)),
        law("repr or str that raises", "raises_untold", untold, measured="casimir"),
        law("repr or str that raises", "returns_untold", untold, measured="casimir"),
        law("name removed from NumPy", "removes", r"changed\s+numpy.isfinite", measured="casimir"),
        FaultyCommand("leftover thread and process", f"exec {SEPV} verify mine:leaves_helpers --law energy -q", (0,),
              "1 law: 1 violated", hangs=True, helpers=True),
        FaultyCommand("program that kills sepv", f"exec {SEPV} verify --exec ./kills --law identity -q", (3,),
              "SIGKILL", kills),
    ]  # fmt: skip


def files() -> list[FaultyCommand]:
    """Files that never end, that are damaged, or that Python would import."""
    own = {f"{name}.py": "open('ran', 'a').write(__name__)" for name in ("queue", "random", "secrets")}
    rest = "-q -j 2 --law identity,truncation"
    main_of = "-c 'from sepv.commands import main; main()'"
    names = ('"name": "%s"', '"name": "pendulum", "parameters": {"%s": [1]}', '"%s": 1', '"dimension": "%s"')
    return [
        *(FaultyCommand("-p a FIFO or /dev/zero", f"{made} p.json; exec {SEPV} {command} -p p.json", (2,),
            "a pipe, a socket")
          for made in ("mkfifo", "ln -s /dev/zero") for command in ("verify midpoint --law identity", "run midpoint")),
        *(FaultyCommand("damaged description of a store",
            f"{PYTHON} store.py && {harmed(*harm)} && exec {PYTHON} store.py",
                (1,), "refused: Expected", {"store.py": SMALL_STORE}) for harm in HARMS),
        *(FaultyCommand("queue.py, random.py in the folder", f"exec {SEPV} verify {target} {rest}", (0,),
            "2 laws: 2 hold",
                own, then="test ! -e ran") for target in FAULTY_TARGETS),
        *(FaultyCommand("sepv.py in the folder", f"exec {PYTHON} {main_of} verify {target} {rest}", (0,),
            "2 laws: 2 hold",
                own | {"sepv.py": own["queue.py"]}, then="test ! -e ran") for target in FAULTY_TARGETS),
        *(FaultyCommand("name of 60 MB", f"{made_of('{' + where + '}')} && exec {SEPV} run midpoint -p p.json", (2,),
                "Received p.json") for where in names),
    ]  # fmt: skip


FAULTY_TARGETS = ("energy-preserving", "mine:midpoint")


def harmed(file: str, harm: str) -> str:
    """A line of bash that harms a file of the store."""
    code = f"from pathlib import Path; p = Path('paths.zarr/{file}'); t = p.read_text(); p.{harm}"
    return f"{PYTHON} -c {shlex.quote(code)}"


def made_of(text: str) -> str:
    """A line of bash that writes a problem file with a long name."""
    code = f"open('p.json', 'w').write({text!r} % ('x' * 60_000_000))"
    return f"{PYTHON} -c {shlex.quote(code)}"


def systems() -> list[FaultyCommand]:
    """Streams, encodings and limits of the system; numbers and addresses that are none."""
    verify, windows = f"{SEPV} verify midpoint --law identity", "PYTHONIOENCODING=cp1252 exec"
    report = shlex.quote("import sepv; print(sepv.verify('midpoint', laws='energy'))")
    terms = '"hamiltonian": [[[2, 0], 0.5]], "structure": [[0, 1, [[[0, 0], -1.0]]]]'
    infinite = {"p.json": f'{{"dimension": 2, {terms}, "initial": [1e200, 1]}}'}
    return [
        *(FaultyCommand("closed or full output", f"exec {verify} {redirected}", (70,))
          for redirected in (">&-", "2>&-", ">/dev/full", ">&- 2>&-")),
        FaultyCommand("closed or full output", f"{verify} | true; exit ${{PIPESTATUS[0]}}", (0, 141)),
        *(FaultyCommand("few descriptors", f"ulimit -n {count}; exec {verify}", (70,) if count < 7 else (0, 70))
          for count in (5, 6, 7, 8, 10, 16)),
        *(FaultyCommand("little memory", f"ulimit -v {size}000; exec {verify}", (70,) if size <= 150 else (0, 70))
          for size in (60, 100, 150, 300, 500)),
        *(FaultyCommand("cp1252", f"{windows} {SEPV} {words}", (0,))
          for words in ("--help", "verify midpoint --law energy", "list")),
        FaultyCommand("cp1252", f"{windows} {PYTHON} -c {report}", (0,), "energy"),
        FaultyCommand("FORCE_COLOR into a file", f"FORCE_COLOR=1 {verify} > shown 2>&1", (0,),
              then=r"! grep -qP '\r|\x1b\[[0-9;?]*[^0-9;m]' shown"),
        FaultyCommand("H(y0) = inf", f"exec {SEPV} run midpoint --steps 4 -p p.json", (2,), r"H\(y0\) = inf", infinite),
        FaultyCommand("tls:// without certificates",
            f"exec {SEPV} reproduce 4.4 --quick --workers tls://127.0.0.1:1", (2,),
              "Expected certificates"),
    ]  # fmt: skip


def met(fault: FaultyCommand, folder: Path, moment: float = 0.0) -> Survival:
    """Run a fault's command in a folder, with its signal after so many seconds,
    and say what came of it.
    """
    for name, text in {"mine.py": HOSTILE_STEPS, **fault.files}.items():
        (folder / name).write_text(text, encoding="utf-8")
        (folder / name).chmod(0o755)
    mark, out = uuid4().hex, folder / "out"
    with out.open("wb") as file:
        begun = time.monotonic()
        child = subprocess.Popen(
            ["bash", "-c", fault.line], cwd=folder, stdin=subprocess.DEVNULL, stdout=file, stderr=file,
            start_new_session=True, env=os.environ | {FAULT_VARIABLE: mark},
        )  # fmt: skip
        try:
            if fault.signal and (moment or fault.at):
                wait_for(folder / fault.at if fault.at else None, moment)
                begun = time.monotonic()
                with suppress(ProcessLookupError):
                    os.killpg(child.pid, fault.signal)
            code: int | None = child.wait(HANG_SECONDS)
        except subprocess.TimeoutExpired:
            code = None
        seconds = time.monotonic() - begun
    try:
        left = remaining(mark, ENDED_SECONDS) if not fault.helpers else []
    finally:
        for pid in (child.pid, *remaining(mark, 0.0)):
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        child.wait()
    shown = out.read_text(encoding="utf-8", errors="replace")
    # A run that ended before its signal, or while it came, is as good.
    codes = (*fault.codes, 0) if fault.signal and not fault.at else fault.codes
    if fault.signal and not moment and not fault.at:
        codes = (0,)
    why = [
        "no end" if code is None else "" if code in codes else f"exit code {code}",
        f"left: {left}" if left else "",
        ""
        if re.search(fault.words, shown, re.DOTALL) or (0 in codes and fault.signal)
        else f"no words {fault.words!r}",
        "traceback" if "Traceback" in shown else "",
        f"{len(shown)} characters" if len(shown) > PRINTED_MAX_CHARACTERS else "",
        *judged(fault, folder),
    ]
    if fault.then:
        after = subprocess.run(
            ["bash", "-c", fault.then], cwd=folder, capture_output=True, text=True, check=False
        )
        why.append(f"then: {after.returncode} {after.stderr[-300:]}" if after.returncode else "")
    said = "; ".join(filter(None, why))
    return Survival(f"{said}\n{shown[-600:]}" if said else "", seconds)


def judged(fault: FaultyCommand, folder: Path) -> Iterator[str]:
    """What is wrong in the verdicts of the report r.json."""
    if fault.verdicts:
        file = folder / "r.json"
        laws = json.loads(file.read_text(encoding="utf-8"))["laws"] if file.exists() else []
        found = {one["law"]: one["verdict"] for one in laws}
        if found != fault.verdicts:
            yield f"verdicts {found}"


def wait_for(file: Path | None, seconds: float) -> None:
    """Wait for so many seconds, or for a file."""
    end = time.monotonic() + (HANG_SECONDS if file else seconds)
    while time.monotonic() < end and not (file and file.exists()):
        time.sleep(0.01)


def remaining(mark: str, seconds: float) -> list[str | int]:
    """The numbers of the processes with this mark in their environment that have not ended after so
    many seconds.
    """
    end = time.monotonic() + seconds
    while True:
        found = [pid for pid in running() if marked(pid, mark)]
        if not found or time.monotonic() > end:
            return found
        time.sleep(0.1)


def running() -> Iterable[int]:
    """The numbers of all processes; none where /proc does not tell."""
    return map(int, filter(str.isdecimal, os.listdir("/proc") if os.path.isdir("/proc/self") else ()))


def marked(pid: int, mark: str) -> bool:
    """True if a process that runs has this mark in its environment."""
    try:
        state = (
            Path(f"/proc/{pid}/stat")
            .read_text(encoding="ascii", errors="replace")
            .rpartition(")")[2]
            .split()[0]
        )
        return (
            state != "Z" and f"{FAULT_VARIABLE}={mark}".encode() in Path(f"/proc/{pid}/environ").read_bytes()
        )
    except OSError:
        return False


def trials(fault: FaultyCommand) -> list[Survival]:
    """The outcomes of all trials of a fault. Signals come at moments spread over the run,
    whose length is measured.
    """
    with TemporaryDirectory(prefix="fault-") as folder:
        first = met(fault, Path(folder))
    if not fault.signal or fault.at:
        return [first]
    outcomes = [first] if first.why else []
    # Before a quarter of a second Python itself starts, and answers a signal as Python does.
    for n in range(fault.times):
        with TemporaryDirectory(prefix="fault-") as folder:
            moment = 0.25 + (0.9 * first.seconds - 0.25) * n / fault.times
            outcomes.append(met(fault, Path(folder), max(moment, 0.25)))
    return outcomes


def main() -> None:
    """Print the table as Markdown; exit code 1 if a fault is not survived."""
    options = arguments(__doc__, only={"default": "", "help": "kinds that begin so"})
    chosen = [
        fault
        for fault in (*signals(), *hangs(), *crashes(), *files(), *systems())
        if fault.kind.startswith(options.only)
    ]
    kinds: dict[str, list[tuple[FaultyCommand, Survival]]] = {fault.kind: [] for fault in chosen}
    # A shell lets what it starts in the background ignore Ctrl-C, and so would the commands.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with ThreadPoolExecutor(2) as pool:
        futures = {pool.submit(trials, fault): fault for fault in chosen}
        done = as_completed(futures)
        for _ in over(range(len(chosen)), lambda n: f"{n} of {len(chosen)}"):
            future = next(done)
            kinds[futures[future].kind] += [(futures[future], outcome) for outcome in future.result()]
    rows = []
    for kind, found in kinds.items():
        ended = [outcome.seconds for fault, outcome in found if fault.hangs]
        spread = f"{min(ended):.1f} … {max(ended):.1f}" if ended else ""
        rows.append([kind, str(len(found)), str(sum(not outcome.why for _, outcome in found)), spread])
    print(markdown(["fault", "tried", "survived", "ends after s"], rows))
    lost = [(fault, outcome) for found in kinds.values() for fault, outcome in found if outcome.why]
    for fault, outcome in lost:
        print(f"\n{fault.kind}: {fault.line}\n  {outcome.why}", file=sys.stderr)
    raise SystemExit(bool(lost))


if __name__ == "__main__":
    start(main)
