"""Bad input to commands, class by class: each ends in an error of sepv that says what to do,
or in a right result.

A row is a file, a scheme, a module, a program or a command. Nothing may hang (an alarm rings after
some seconds), show a traceback from inside, or leave half a file. What problem files, tokens and
reports may say is in test_hostile.py, programs on their pipes are in test_external.py, functions of
sepv in test_bad_input.py.
"""

import shlex
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from doors import command

Check = Callable[[Path], None]


def cli(arguments: str, code: int, *words: str, **files: str | bytes) -> Check:
    """The command ends with this exit code and these words; the folder holds what it held
    before.
    """

    def check(folder: Path) -> None:
        for name, content in files.items():
            file = folder / name.replace("_", ".")
            file.write_bytes(content if isinstance(content, bytes) else content.encode())
        sys.modules.pop("mine", None)
        before = sorted(p.name for p in folder.iterdir())
        shown = command(arguments, code).output
        for word in (*words, ""):
            assert word in shown
        assert "Traceback" not in shown
        after = sorted(p.name for p in folder.iterdir() if p.name != "__pycache__")
        assert after == before, "left something behind"

    return check


CONTRACT = "--law contract --examples 2 --shrink-checks 10"


def scheme(body: str, code: int, *words: str, options: str = CONTRACT) -> Check:
    """`sepv verify` of a step with this body."""
    text = f"import numpy as np, os, sys, time\n\nHISTORY = []\n\ndef step(problem, y, h, dW):\n    {body}\n"
    return cli(f"verify mine:step {options}", code, *words, mine_py=text)


def module(arguments: str, code: int, *words: str, text: str = "") -> Check:
    """A command about the module `mine`, which has this text."""
    head = "import numpy as np\nimport sepv\nfrom sepv.schemes._energy_preserving import step as correct\n"
    return cli(arguments, code, *words, mine_py=f"{head}{text}\n")


EXITS = shlex.quote(f"{shlex.quote(sys.executable)} -c 'raise SystemExit(7)'")


VERIFY = "verify energy-preserving --law identity --examples 2"
QUICK, STEP = "--steps 4,8 --paths 32 --repeats 1", "def step(problem, y, h, dW):"
NO_START = (
    "import dataclasses\np = dataclasses.replace(sepv.problems.rigid_body(), initial=None, check=False)"
)
FOR_EVER, ONE_LAW = "time.sleep(3600)", "--law energy --timeout 0.5"
CATCHES = (
    "while True:\n        try:\n            time.sleep(0.01)\n        except Exception:\n            pass"
)
COROUTINE = "import asyncio\n    async def later(): return y\n    c = later()\n    c.close()\n    return c"
ONE_BUFFER = (
    "HISTORY.append(np.empty(3)) if not HISTORY else None\n    b = HISTORY[0][:y.shape[0]] if y.shape[0] < 4 "
    "else y.copy()\n    b[...] = y\n    return b"
)


def disk_full(folder: Path) -> None:
    """Files may grow to 64 bytes: the report does not fit, and no part of it stays."""
    code = (
        "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (64, 64)); from sepv.commands._cli import main; "
        "main(['hard', '--case', 'rank-0', '--steps', '2', '--laws', '0', '--json', 'r.json'])"
    )
    # -B: bytecode is a file too, and would be cut off.
    words = [sys.executable, "-B", "-c", code]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False, timeout=30)
    assert done.returncode == 2, done.stderr
    assert "sepv:" in done.stderr
    assert "Traceback" not in done.stderr
    assert list(folder.iterdir()) == []


CHECKS: dict[str, Check] = {
    "expected: empty": cli(f"{VERIFY} --expected e.toml", 0, e_toml=""),
    "expected: not there": cli(f"{VERIFY} --expected no.toml", 2, "No such file"),
    "expected: a folder": cli(f"{VERIFY} --expected .", 2, "is a directory"),
    "problem file: a folder": cli("solvability .json", 2, ".json"),
    "bench records: corrupted": cli("bench energy-preserving --against b.json", 2, "b.json", b_json='{"format": 0}'),
    "output: a folder that is not there": cli(f"{VERIFY} --json no/r.json", 2, "folder"),
    "output: a file for a folder": cli(f"{VERIFY} --json f/r.json", 2, "folder", f=""),
    "output: a folder for a file": cli(f"{VERIFY} --json .", 2, "directory"),
    "output: picture of unknown kind": cli("solvability rigid-body --picture p.gif", 2, ".svg"),
    "disk full": disk_full,
    "step: raises": scheme("raise RuntimeError('out of order')", 3, "out of order"),
    "step: recurses": scheme("return step(problem, y, h, dW)", 3, "RecursionError"),
    "step: exits": scheme("sys.exit(0)", 3, "SystemExit"),
    "step: sleeps for ever": scheme(FOR_EVER, 3, "did not come back", options=ONE_LAW),
    "step: spins and catches everything": scheme(CATCHES, 3, "did not come back", options=ONE_LAW),
    "step: returns a generator": scheme("yield y", 1, "generator"),
    "step: returns a coroutine": scheme(COROUTINE, 1, "coroutine"),
    "step: returns NaN": scheme("return y * np.nan", 1, "finite"),
    "step: returns infinity": scheme("return y / 0.0", 1, "finite"),
    "step: returns another shape": scheme("return y[:1]", 1, "shape"),
    "step: returns an axis more": scheme("return y[None]", 1, "shape"),
    "step: returns a list": scheme("return list(y)", 1, "NumPy array"),
    "step: returns nothing": scheme("pass", 1, "NoneType"),
    "step: returns single precision": scheme("return y.astype(np.float32)", 1, "float32"),
    "step: returns integers": scheme("return np.ones(y.shape, dtype=int)", 1, "int64"),
    "step: returns complex numbers": scheme("return y + 0j", 1, "complex128"),
    "step: fails to solve": scheme("import sepv; raise sepv.StepFailure('gave up')", 3, "not solved:", "gave up"),
    "step: returns objects": scheme("return y.astype(object)", 1, "object"),
    "step: returns a masked array": scheme("return np.ma.masked_invalid(y)", 1, "MaskedArray"),
    "step: returns its own argument": scheme("return y", 0, "holds"),
    "step: returns one buffer": scheme(ONE_BUFFER, 1, "violated", options="--law contract --shrink-checks 10"),
    "step: changes y": scheme("y[...] = 0\n    return y.copy()", 1, "unchanged"),
    "step: changes dW": scheme("dW += 1.0\n    return y.copy()", 1, "dW unchanged"),
    "step: changes the problem":
        scheme("problem.c.setflags(write=True); problem.c[:] = 7\n    return y.copy()", 3, "ValueError"),
    "step: depends on time": scheme("return y + 1e-9 * time.perf_counter()", 1, "one answer"),
    "step: counts its calls": scheme("HISTORY.append(1)\n    return y + len(HISTORY)", 1, "one answer"),
    "step: keeps everything": scheme("HISTORY.append(bytearray(10**5))\n    return y.copy()", 0, "holds"),
    "step: prints": scheme("print('noise')\n    return y.copy()", 0, "holds"),
    "step: warns": scheme("import warnings; warnings.warn('odd')\n    return y.copy()", 0, "holds"),
    "step: sets NumPy's error state":
        scheme("np.seterr(all='raise')\n    return y.copy()", 1, "NumPy's error handling"),
    "step: wrong arguments":
        module("verify mine:step", 3, "(problem, y, h, dW)", "(y, h)", text="def step(y, h): pass"),
    "step: arguments in another order": module(
        "verify mine:step --law energy", 3, "step(problem, y, h, dW)",
        "Received mine:step(y, problem, h, dW): the same names in another order.",
        text="def step(y, problem, h, dW):\n    return y"),
    "step: refused by a function of sepv": module(  # not a usage error of the command, which would end the run
        "verify mine:step --law energy --examples 2", 3, "raised UsageError: Expected", "mine.py, line",
        text="def step(problem, y, h, dW):\n    return sepv.exact_flow(problem, 'x', y).y[:, 0]"),
    "module: does not parse": module("verify mine:step", 3, "SyntaxError", text="def step(:"),
    "module: raises": module("verify mine:step", 3, "RuntimeError", "broken", text="raise RuntimeError('broken')"),
    "module: lacks a library": module("verify mine:step", 3, "install nosuchlibrary", text="import nosuchlibrary"),
    "module: not there": cli("verify no.such.module:step", 3, "no module named 'no'", "Remedy"),
    "module: a file": module("verify mine.py:step", 3, "mine:step", text="step = correct"),
    "module: a path":
        module("verify ./mine.py", 3, "name it as mine:mine", text="def mine(problem, y, h, dW): return y"),
    "module: alone": module("verify mine", 3, "name it as mine:step", text="step = correct"),
    "module: exits when imported": cli("verify mine:step", 3, "SystemExit", mine_py="import sys; sys.exit(0)"),
    "module: null bytes": cli("verify mine:step", 3, "mine", mine_py="step = 1\x00"),
    "module: without a name": cli("verify :step", 3, "module:attribute"),
    "module: a path and an attribute": cli("verify /etc/passwd:step", 3, "module:attribute"),
    "attribute: not there": module("verify mine:nosuch", 3, "attribute 'nosuch'", "correct"),
    "attribute: misspelt": module("verify mine:stp", 3, "did you mean 'step'", text="step = correct"),
    "attribute: a number": module("verify mine:step", 3, "step(problem, y, h, dW)", "int", text="step = 3"),
    "attribute: a class": module("verify mine:Step", 3, "a class", text="class Step: pass"),
    "attribute: a Scheme of a number":
        module("verify mine:step", 3, "Scheme(step=…)", text="step = sepv.Scheme(name='x', step=5)"),
    "program: not there": cli("verify --exec ./nosuch --law contract", 3, "nosuch"),
    "program: nothing": cli("verify --exec '' --law contract", 2),
    "program: unbalanced quotes": cli("""verify --exec '"./a' --law contract""", 2, "quot"),
    "program: exits at once": cli(f"verify --exec {EXITS} --law contract --examples 1 --call-timeout 1", 3, "7"),
    "verify: no target": cli("verify", 2, "TARGET"),
    "verify: unknown scheme": cli("verify nosuch", 3, "built-in scheme", "nosuch"),
    "verify: a misspelt scheme": cli("verify midpiont", 3, "did you mean 'midpoint'"),
    "verify: a misspelt law": cli("verify midpoint --law enrgy", 2, "Expected a law", "did you mean 'energy'"),
    "verify: an unknown claim": cli("verify midpoint --claim nosuch", 2, "Expected a law", "nosuch"),
    "verify: a law without a name": cli("verify midpoint --law ''", 2, "expected a name"),
    "verify: a requirement without a name": cli("verify midpoint --require ''", 2),
    "verify: a claim without a name": cli("verify midpoint --claim ,", 2, "expected a name"),
    "verify: a replay of no law": cli("verify midpoint --replay xyz", 2, "one --law"),
    "verify: a file for two": cli("verify energy-preserving midpoint --json x.json", 2, "one TARGET"),
    "verify: no examples": cli("verify energy-preserving --examples 0", 2, "--examples"),
    "verify: no time": cli("verify midpoint --timeout nan", 2, "'nan' is not a finite number"),
    "verify: time without end": cli("verify midpoint --timeout inf", 2, "--timeout"),
    "verify: no problem file": cli("verify midpoint -p no.json", 2, "no.json: No such file"),
    "step: h NaN": cli("step energy-preserving rigid-body --h nan", 2, "finite numbers"),
    "step: two h": cli("step energy-preserving rigid-body --h 1,2", 2, "1 number after --h"),
    "step: h a word": cli("step midpoint pendulum --h x", 2, "numbers separated by commas"),
    "step: y too short": cli("step midpoint pendulum --h 0.1 --y 1", 2, "2 numbers after --y", "Remedy"),
    "step: y outside": cli("step midpoint lotka-volterra --h 0.1 --y=-1,1,1", 2, "domain", "Remedy"),
    "step: unknown scheme": cli("step nosuch pendulum --h 1", 2, "nosuch", "Remedy"),
    "step: digits and a proof": cli(
        "step energy-preserving rigid-body --h 0.1 --dW 0.05 --digits 30 --certify", 0,
        "y1 = 0.802313691387643825092815834210\n", "ulp", "F has exactly one zero in X"),
    "step: without a scheme in float64":
        cli("step averaged-vector-field pendulum --h 0.1 --y 0x1p-3,1", 0, "no float64 result"),
    "step: no solution": cli("step energy-preserving lotka-volterra --h 2", 3, "end at Δ = 1.139191", "residual"),
    "exact: digits and a proof": cli(
        "exact harmonic-oscillator --theta 8 --digits 40 --certify", 0,
        "y1 = -0.1280358314240608900619970373916446665972\n", "in float64, off by", "y1 in [-0.128"),
    "exact: unknown problem": cli("exact nosuch --theta 1", 2, "nosuch", "Remedy"),
    "exact: no digits": cli("exact pendulum --theta 1 --digits 0", 2, "between 1 and 2000", "Remedy"),
    "exact: theta infinite": cli("exact pendulum --theta inf", 2, "finite"),
    "bench: no scheme": cli("bench", 2, "a scheme, or a program"),
    "bench: unknown scheme": cli("bench nosuch", 3, "built-in scheme"),
    "bench: unknown case": cli("bench energy-preserving --case nosuch", 2, "a case, one of"),
    "bench: records that are not there": cli("bench midpoint --against no.json", 2, "--save", "no.json"),
    "bench: two others": cli("bench midpoint --against a --against-ref .", 2, "one of"),
    "compare: no scheme": cli("compare", 2, "a SCHEME, --exec or --peers"),
    "compare: unknown scheme": cli("compare nosuch", 3, "built-in scheme"),
    "compare: a misspelt problem":
        cli("compare midpoint -p rigid-bdy", 2, "a problem by name", "did you mean 'rigid-body'"),
    "compare: a problem that is a number":
        module("compare midpoint -p mine:h", 2, "a sepv.Problem", "float", text="h = 1.0"),
    "compare: fewer steps": cli("compare midpoint --steps 8,4", 2, "each dividing the last"),
    "compare: steps that do not divide": cli("compare midpoint --steps 8,12", 2, "each dividing the last"),
    "compare: no steps": cli("compare midpoint --steps 0", 2, "each dividing the last"),
    "compare: steps of words": cli("compare midpoint --steps 8,x", 2, "commas"),
    "compare: few paths": cli("compare midpoint --paths 8", 2, "--paths"),
    "compare: picture of unknown kind": cli("compare midpoint --picture c.gif", 2, ".svg, .png, .pdf"),
    "compare: another shape": module(f"compare mine:step {QUICK}", 3, "shape", text=f"{STEP} return y[:1]"),
    "compare: a step that raises later":
        module(f"compare mine:step {QUICK}", 3, "AttributeError",
               text=f"{STEP} return y + 0 * (y.nosuch() if h > 0.01 else 0)"),
    "compare: another initial state": cli(f"compare midpoint {QUICK} --y 1,2", 2, "shape"),
    "growth: a chaotic problem":
        cli("growth leapfrog -p henon-heiles --time 8 --no-noise", 0, "theory speaks of one degree of freedom"),
    "growth: a short time": cli("growth --h 0.1 --time 1", 2, "Remedy: T = 1.6"),
    "hard: unknown case": cli("hard --case nosuch", 2, "nosuch"),
    "reproduce: unknown figure": cli("reproduce 4.9", 2, "4.1, 4.2", "'4.9'", "Remedy: sepv reproduce 4.3"),
    "solvability: unknown problem": cli("solvability nosuch", 2, "nosuch"),
    "solvability: no range": cli("solvability rigid-body --range 0", 2, "--range"),
    "solvability: no time": cli("solvability rigid-body --time nan", 2, "not a finite number"),
    "solvability: another scheme": cli("solvability rigid-body --scheme discrete-gradient", 2, "Δ alone"),
    "solvability: another initial state": cli("solvability rigid-body --y 1,2", 2, "(3,)"),
    "solvability: no initial state": module("solvability mine:p", 2, "initial", text=NO_START),
    "solvability: negative noise": cli("solvability rigid-body --noise=-1", 2, "≥ 0"),
    "solvability: noise in words": cli("solvability rigid-body --noise 1,x", 2, "1,x"),
    "run: no scheme": cli("run", 2, "a scheme, or a program with --exec"),
    "command: misspelt": cli("compair midpoint", 2, "did you mean 'compare'", "solvability, teeth"),
    "command: unknown": cli("validate", 2, "validate"),
    "option: unknown": cli("verify energy-preserving --fast", 2, "--fast"),
    "number: a word": cli("verify energy-preserving --examples many", 2, "many"),
    "number: beyond range": cli("hard --steps 0", 2, "--steps"),
    "number: a billion digits": cli(f"hard --steps {'9' * 5000}", 2),
    "seed: negative": cli("hard --seed -1", 2, "--seed"),
}  # fmt: skip


@pytest.mark.usefixtures("alarm")
@pytest.mark.parametrize("name", CHECKS)
def test_bad_input_ends_in_an_error_of_ours_or_a_right_result(name, reader):
    with np.errstate():
        CHECKS[name](reader.folder)
    # What came in has an end: no time limit of sepv's is left to go off later, and nobody went to
    # another folder.
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    assert Path.cwd() == reader.folder.resolve()
