"""Bad input, class by class: each ends in an error of sepv that says what to do, or in a right result.

One parametrised test, a row for each class, grouped by the door the input comes through. Nothing may hang (an
alarm rings after some seconds), show a traceback from inside, or leave half a file. What schemes may do wrong in
a step, and programs on their pipes, is also in test_cli.py and test_external.py.
"""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
import threading
import time
import zlib
from base64 import urlsafe_b64encode
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import sepv
from sepv import case as cases
from sepv import polynomial as poly
from sepv import problems, schemes, strategies, wiener
from sepv.cli import main
from sepv.errors import SepvError
from sepv.files import write_atomically
from sepv.law import Effort
from sepv.problems import hard
from sepv.scheme import Scheme
from sepv.solvability import follow

EP = schemes.energy_preserving
BODY = problems.rigid_body()
Y, DW = np.array([0.8, 0.6, 0.0]), np.array([0.1])
SECONDS = 30
Check = Callable[[Path], None]


@pytest.fixture(autouse=True)
def alarm() -> Iterator[None]:
    """Whatever hangs is a failure, not a wait."""

    def ring(*_: Any) -> None:
        raise AssertionError(f"did not come back within {SECONDS} s")

    # Not SIGALRM, which sepv itself uses for its time limits.
    before = signal.signal(signal.SIGUSR1, ring)
    timer = threading.Timer(SECONDS, signal.pthread_kill, (threading.main_thread().ident, signal.SIGUSR1))
    timer.start()
    yield
    timer.cancel()
    signal.signal(signal.SIGUSR1, before)


def refused(call: Callable[[], Any]) -> Check:
    """The call raises an error of sepv with its three parts, and no other."""

    def check(_: Path) -> None:
        with pytest.raises(SepvError) as caught:
            call()
        message = str(caught.value)
        assert "Remedy" in message, message
        assert "Expected" in message or "not solved" in message, message

    return check


def right(call: Callable[[], Any], answer: Any) -> Check:
    """The call is answered, and rightly."""

    def check(_: Path) -> None:
        assert np.array_equal(call(), answer)

    return check


def cli(arguments: str, code: int, *words: str, files: dict[str, bytes] | None = None) -> Check:
    """The command ends with this exit code and these words; the folder holds what it held before."""

    def check(folder: Path) -> None:
        for name, content in (files or {}).items():
            (folder / name).write_bytes(content)
        sys.modules.pop("mine", None)
        before = sorted(p.name for p in folder.iterdir())
        result = CliRunner().invoke(main, shlex.split(arguments))
        assert result.exit_code == code, f"{result.exit_code}: {result.output} {result.exception!r}"
        for word in words:
            assert word in result.output, result.output
        assert "Traceback" not in result.output
        after = sorted(p.name for p in folder.iterdir() if p.name != "__pycache__")
        assert after == before, "left something behind"

    return check


def scheme(body: str, code: int, *words: str, options: str = "--law contract --examples 3") -> Check:
    """`sepv verify` of a step with this body."""
    text = f"import numpy as np, os, sys, time\n\nHISTORY = []\n\ndef step(problem, y, h, dW):\n    {body}\n"
    return cli(f"verify mine:step {options}", code, *words, files={"mine.py": text.encode()})


def program(body: str, *words: str) -> Check:
    """`sepv verify --exec` of a Python program with this body: an error in words, exit code 3."""

    def check(folder: Path) -> None:
        (folder / "program.py").write_text(f"import sys, os, time\n{body}\n")
        command = shlex.quote(f"{shlex.quote(sys.executable)} program.py")
        cli(f"verify --exec {command} --law contract --examples 2 --call-timeout 1", 3, *words)(folder)

    return check


def made(**changes: Any) -> Callable[[], sepv.Problem]:
    """A problem made by hand with a fault."""
    parts: dict[str, Any] = {
        "dimension": 2,
        "structure": lambda y: np.array([[0 * y[0], -1 + 0 * y[0]], [1 + 0 * y[0], 0 * y[0]]]),
        "hamiltonian": lambda y: y[0] ** 4 / 4 + y[1] ** 2 / 2,
        "gradient": lambda y: np.array([y[0] ** 3, y[1]]),
    }
    return lambda: sepv.Problem(**{**parts, **changes})


def recursion(y: Any) -> Any:
    return recursion(y)


def counting() -> Callable[[Any], Any]:
    calls = [0]

    def gradient(y: Any) -> Any:
        calls[0] += 1
        return np.array([y[0] ** 3, y[1]]) * (1 + 1e-3 * calls[0])

    return gradient


def by_time(y: Any) -> Any:
    return np.array([y[0] ** 3, y[1]]) * (1 + time.perf_counter())


def spoil(y: Any) -> Any:
    y *= 2
    return np.array([y[0] ** 3, y[1]])


def bomb() -> str:
    """A token of a few kilobytes that unpacks to hundreds of megabytes."""
    squeezer = zlib.compressobj(9)
    packed = b"".join(squeezer.compress(bytes(2**20)) for _ in range(300)) + squeezer.flush()
    return urlsafe_b64encode(packed).decode()


TOKEN = cases.to_token(cases.Case(BODY.data, tuple(Y), 0.1, tuple(DW)))  # type: ignore[arg-type]
SYSTEM = {"dimension": 2, "hamiltonian": [[[2, 0], 0.5]], "structure": [[0, 1, [[[0, 0], -1.0]]]]}


def system(**changes: Any) -> Callable[[], Any]:
    return lambda: problems.polynomial_problem(problems.from_json({**SYSTEM, **changes}))


STEPS: dict[str, Check] = {
    "y: too short": refused(lambda: EP.step(BODY, Y[:2], 0.1, DW)),
    "y: empty": refused(lambda: EP.step(BODY, np.empty(0), 0.1, DW)),
    "y: three axes": refused(lambda: EP.step(BODY, np.zeros((3, 2, 2)), 0.1, DW)),
    "y: transposed batch": refused(lambda: EP.step(BODY, np.zeros((5, 3)), 0.1, np.zeros((1, 5)))),
    "y: NaN": refused(lambda: EP.step(BODY, Y * np.nan, 0.1, DW)),
    "y: infinite": refused(lambda: EP.step(BODY, Y + np.inf, 0.1, DW)),
    "y: words": refused(lambda: EP.step(BODY, ["a", "b", "c"], 0.1, DW)),
    "y: None": refused(lambda: EP.step(BODY, None, 0.1, DW)),
    "y: complex": refused(lambda: EP.step(BODY, Y + 1j, 0.1, DW)),
    "y: ragged": refused(lambda: EP.step(BODY, [[1.0], [1.0, 2.0], []], 0.1, DW)),
    "y: a list": right(lambda: EP.step(BODY, Y.tolist(), 0.1, DW), EP.step(BODY, Y, 0.1, DW)),
    "y: integers": right(
        lambda: EP.step(BODY, np.array([1, 1, 0]), 0.1, DW), EP.step(BODY, np.array([1.0, 1, 0]), 0.1, DW)
    ),
    "y: no lanes": right(lambda: EP.step(BODY, np.empty((3, 0)), 0.1, np.empty((1, 0))), np.empty((3, 0))),
    "y: outside the domain": refused(
        lambda: EP.step(problems.lotka_volterra(), np.array([1.0, -1.0, 1.0]), 0.1, DW)
    ),
    "dW: too long": refused(lambda: EP.step(BODY, Y, 0.1, np.zeros(2))),
    "dW: a scalar": refused(lambda: EP.step(BODY, Y, 0.1, 0.1)),
    "dW: None": refused(lambda: EP.step(BODY, Y, 0.1, None)),
    "dW: infinite": refused(lambda: EP.step(BODY, Y, 0.1, np.array([np.inf]))),
    "h: None": refused(lambda: EP.step(BODY, Y, None, DW)),
    "h: a word": refused(lambda: EP.step(BODY, Y, "0.1", DW)),
    "h: an array": refused(lambda: EP.step(BODY, Y, np.array([0.1, 0.2]), DW)),
    "h: infinite": refused(lambda: EP.step(BODY, Y, float("inf"), DW)),
    "h: complex": refused(lambda: EP.step(BODY, Y, 0.1j, DW)),
    "a step of 1e300": refused(lambda: EP.step(hard.by_name("huge-constant").problem, Y[:2], 1e300, DW)),
}

PATHS: dict[str, Check] = {
    "integrate: h = 0": refused(lambda: sepv.integrate(EP, BODY, h=0.0, T=1.0)),
    "integrate: h NaN": refused(lambda: sepv.integrate(EP, BODY, h=float("nan"), T=1.0)),
    "integrate: h a word": refused(lambda: sepv.integrate(EP, BODY, h="0.1", T=1.0)),
    "integrate: T no multiple of h": refused(lambda: sepv.integrate(EP, BODY, h=0.3, T=1.0)),
    "integrate: T a word": refused(lambda: sepv.integrate(EP, BODY, h=0.5, T="1")),
    "integrate: neither T nor steps": refused(lambda: sepv.integrate(EP, BODY, h=0.1)),
    "integrate: half a step": refused(lambda: sepv.integrate(EP, BODY, h=0.1, steps=1.5)),
    "integrate: y0 of another problem": refused(lambda: sepv.integrate(EP, BODY, h=0.1, steps=1, y0=[1.0])),
    "integrate: y0 words": refused(lambda: sepv.integrate(EP, BODY, h=0.1, steps=1, y0=["a"] * 3)),
    "integrate: y0 outside the domain": refused(
        lambda: sepv.integrate(EP, problems.lotka_volterra(), h=0.01, steps=1, y0=[-1.0, 1.0, 1.0])
    ),
    "integrate: dW too short": refused(lambda: sepv.integrate(EP, BODY, h=0.1, steps=2, dW=[[0.1]])),
    "integrate: dW NaN": refused(lambda: sepv.integrate(EP, BODY, h=0.1, steps=1, dW=[[np.nan]])),
    "integrate: k = 0": refused(lambda: sepv.integrate(EP, BODY, h=0.1, steps=1, truncation=0)),
    "integrate: h = 1 truncated": refused(lambda: sepv.integrate(EP, BODY, h=1.0, steps=1)),
    "integrate: negative seed": refused(lambda: sepv.integrate(EP, BODY, h=0.1, steps=1, seed=-1)),
    "integrate: seed a word": refused(lambda: sepv.integrate(EP, BODY, h=0.1, steps=1, seed="x")),
    "ensemble: no paths": refused(lambda: sepv.ensemble(EP, BODY, h=0.1, T=1.0, paths=0)),
    "ensemble: paths a word": refused(lambda: sepv.ensemble(EP, BODY, h=0.1, T=1.0, paths="x")),
    "ensemble: infinite T": refused(lambda: sepv.ensemble(EP, BODY, h=0.1, T=float("inf"), paths=1)),
    "ensemble: unknown engine": refused(
        lambda: sepv.ensemble(EP, BODY, h=0.1, T=1.0, paths=1, engine="steam")
    ),
    "ensemble: workers a word": refused(
        lambda: sepv.ensemble(EP, BODY, h=0.1, T=1.0, paths=1, workers="two")
    ),
    "ensemble: no workers": refused(lambda: sepv.ensemble(EP, BODY, h=0.1, T=1.0, paths=1, workers=0)),
    "ensemble: times beyond T": refused(lambda: sepv.ensemble(EP, BODY, h=0.1, T=1.0, paths=1, times=[2.0])),
    "ensemble: a worker that dies": lambda _: dead_worker(),
    "increments: half a step": refused(lambda: wiener.increments(0, T=1.0, steps=0, noises=1)),
    "increments: negative T": refused(lambda: wiener.increments(0, T=-1.0, steps=1, noises=1)),
    "exact flow: theta NaN": refused(lambda: sepv.exact_flow(BODY, float("nan"))),
    "exact flow: nothing asked": refused(lambda: sepv.exact_flow(BODY, [])),
    "exact flow: a table of times": refused(lambda: sepv.exact_flow(BODY, np.zeros((2, 2)))),
    "exact flow: words": refused(lambda: sepv.exact_flow(BODY, "soon")),
    "branch: range NaN": refused(lambda: follow(BODY, Y[:, None], float("nan"))),
    "hard case: unknown": refused(lambda: hard.by_name("easy")),
}


def dead_worker() -> None:
    """A pool whose process is killed: what it did not finish is computed here, and the answer is the same."""

    def killed(function: Any, tasks: Any) -> Iterator[Any]:
        raise ConnectionError("killed")
        yield

    arguments = {"h": 0.125, "T": 1.0, "paths": 10, "engine": "numpy"}
    ends = sepv.ensemble(EP, BODY, workers=killed, **arguments)
    assert ends.repeated > 0
    assert np.array_equal(ends.y, sepv.ensemble(EP, BODY, **arguments).y)


MADE: dict[str, Check] = {
    "dimension: a word": refused(made(dimension="2")),
    "dimension: a fraction": refused(made(dimension=2.0)),
    "structure: raises": refused(made(structure=lambda y: 1 / 0)),
    "structure: returns None": refused(made(structure=lambda y: None)),
    "structure: returns a generator": refused(made(structure=lambda y: (v for v in y))),
    "structure: not callable": refused(made(structure=np.eye(2))),
    "structure: NaN": refused(made(structure=lambda y: np.full((2, 2, *y.shape[1:]), np.nan))),
    "structure: recurses": refused(made(structure=recursion)),
    "hamiltonian: a word": refused(made(hamiltonian=lambda y: "energy")),
    "hamiltonian: a vector": refused(made(hamiltonian=lambda y: y)),
    "gradient: NaN": refused(made(gradient=lambda y: y * np.nan)),
    "gradient: raises SystemExit": refused(made(gradient=lambda y: sys.exit(0))),
    "gradient: counts its calls": refused(made(gradient=counting())),
    "gradient: looks at the clock": refused(made(gradient=by_time)),
    "gradient: changes y": refused(made(gradient=spoil)),
    "domain: raises": refused(made(domain=lambda y: 1 / 0)),
    "domain: returns None": refused(made(domain=lambda y: None)),
    "initial: NaN": refused(made(initial=(np.nan, 1.0))),
    "initial: words": refused(made(initial=("a", "b"))),
    "initial: outside the domain": refused(made(initial=(-1.0, 1.0), domain=lambda y: y[0] > 0)),
    "noise: words": refused(made(noise=("a",))),
    "noise: infinite": refused(made(noise=(np.inf,))),
    "rigid body: negative inertia": refused(lambda: problems.rigid_body(inertia=(1, -1, 1))),
    "rigid body: two moments": refused(lambda: problems.rigid_body(inertia=(1, 1))),
    "kepler: a hyperbola": refused(lambda: problems.kepler(eccentricity=1.5)),
    "toda: half a particle": refused(lambda: problems.toda(particles=2.5)),
    "lotka-volterra: NaN": refused(lambda: problems.lotka_volterra(nu=float("nan"))),
    "a name that is none": refused(lambda: problems.by_name("three-body")),
}

DATA: dict[str, Check] = {
    "polynomial: negative exponent": refused(lambda: poly.polynomial(1, {(-1,): 1.0})),
    "polynomial: infinite coefficient": refused(lambda: poly.polynomial(1, {(1,): np.inf})),
    "polynomial: exponent of a billion": refused(lambda: poly.polynomial(1, {(10**9,): 1.0})),
    "system: a million dimensions": refused(system(dimension=10**6, hamiltonian=[], structure=[])),
    "system: no dimension": refused(lambda: problems.from_json({"hamiltonian": [], "structure": []})),
    "system: zero dimensions": refused(system(dimension=0, hamiltonian=[], structure=[])),
    "system: exponents of another dimension": refused(system(hamiltonian=[[[2], 0.5]])),
    "system: a coefficient that is a word": refused(system(hamiltonian=[[[2, 0], "half"]])),
    "system: NaN coefficient": refused(system(hamiltonian=[[[2, 0], "nan"]])),
    "system: structure below the diagonal": refused(system(structure=[[1, 0, [[[0, 0], 1.0]]]])),
    "system: an entry twice": refused(system(structure=[[0, 1, []], [0, 1, []]])),
    "system: index beyond d": refused(system(structure=[[0, 5, []]])),
    "system: a Casimir that is none": refused(system(casimirs=[[[1.0, 0.0], [0.0, 1.0]]])),
    "system: a number": refused(lambda: problems.from_json(3)),
    "case: no increments": refused(lambda: cases.from_json({"problem": SYSTEM, "y": [1, 1], "h": 0.1})),
    "case: a list": refused(lambda: cases.from_json([1, 2])),
    "token: truncated": refused(lambda: cases.from_token(TOKEN[: len(TOKEN) // 2])),
    "token: a letter changed": refused(lambda: cases.from_token("A" + TOKEN[1:])),
    "token: empty": refused(lambda: cases.from_token("")),
    "token: not ASCII": refused(lambda: cases.from_token("größer")),
    "token: unpacks to gigabytes": refused(lambda: cases.from_token(bomb())),
    "token: JSON a hundred thousand deep": refused(
        lambda: cases.from_token(urlsafe_b64encode(zlib.compress(b"[" * 100_000)).decode())
    ),
    "strategies: what they draw is never refused": lambda _: drawn(),
}


def drawn() -> None:
    from hypothesis import given, settings

    @settings(max_examples=20)
    @given(strategies.any_steps())
    def accepted(case: cases.Case) -> None:
        assert cases.from_token(cases.to_token(case)) == case

    accepted()


VERIFY = "verify energy-preserving --law identity --examples 2"
FILES: dict[str, Check] = {
    "expected: missing": cli(f"{VERIFY} --expected no.toml", 2, "no.toml"),
    "expected: empty": cli(f"{VERIFY} --expected e.toml", 0, files={"e.toml": b""}),
    "expected: binary": cli(f"{VERIFY} --expected e.toml", 2, "TOML", files={"e.toml": bytes(range(256))}),
    "expected: truncated": cli(f"{VERIFY} --expected e.toml", 2, "TOML", files={"e.toml": b"[[expected"}),
    "expected: a folder": cli(f"{VERIFY} --expected .", 2, "expected failures"),
    "expected: unknown law": cli(
        f"{VERIFY} --expected e.toml",
        2,
        "nosuch",
        files={"e.toml": b'[[expected]]\nlaw="nosuch"\nreason="r"\nwitness="w"\n'},
    ),
    "expected: corrupted witness": cli(
        f"{VERIFY} --expected e.toml",
        2,
        "token",
        files={"e.toml": b'[[expected]]\nlaw="identity"\nreason="r"\nwitness="w"\n'},
    ),
    "problem file: missing": cli("solvability no.json", 2, "no.json"),
    "problem file: empty": cli("solvability p.json", 2, "p.json", files={"p.json": b""}),
    "problem file: truncated": cli(
        "solvability p.json", 2, "p.json", files={"p.json": json.dumps(SYSTEM).encode()[:40]}
    ),
    "problem file: binary": cli("solvability p.json", 2, "p.json", files={"p.json": b"\xff\xfe\x00"}),
    "problem file: another schema": cli("solvability p.json", 2, "dimension", files={"p.json": b'{"a": 1}'}),
    "problem file: a list": cli("solvability p.json", 2, "problem", files={"p.json": b"[1]"}),
    "problem file: a hundred thousand deep": cli(
        "solvability p.json", 2, "p.json", files={"p.json": b"[" * 100_000}
    ),
    "problem file: a folder": cli("solvability .json", 2, ".json"),
    "report: missing": cli("report no.json", 2, "no.json"),
    "report: truncated": cli("report r.json", 2, "r.json", files={"r.json": b'{"suite": '}),
    "report: not a report": cli("report r.json", 2, "r.json", files={"r.json": b"[]"}),
    "bench records: corrupted": cli(
        "bench energy-preserving --against b.json", 2, "b.json", files={"b.json": b'{"format": 0}'}
    ),
    "output: a folder that is not there": cli(f"{VERIFY} --json no/r.json", 2, "folder"),
    "output: a file for a folder": cli(f"{VERIFY} --json f/r.json", 2, "folder", files={"f": b""}),
    "output: a folder for a file": cli(f"{VERIFY} --json .", 2, "directory"),
    "output: picture of unknown kind": cli("solvability rigid-body --picture p.gif", 2, ".svg"),
    "disk full": lambda folder: disk_full(folder),  # noqa: PLW0108  (defined below)
    "disk full while replacing a file": lambda folder: nothing_half_written(folder),  # noqa: PLW0108
}


def disk_full(folder: Path) -> None:
    """Files may grow to 64 bytes: the report does not fit, and no part of it stays."""
    code = (
        "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (64, 64)); from sepv.cli import main; "
        "main(['hard', '--case', 'rank-0', '--steps', '2', '--laws', '0', '--json', 'r.json'])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False, timeout=SECONDS
    )
    assert done.returncode == 2, done.stderr
    assert "sepv:" in done.stderr
    assert "Traceback" not in done.stderr
    assert list(folder.iterdir()) == []


def nothing_half_written(folder: Path) -> None:
    """An error on the way leaves the old file as it was."""
    target = folder / "r.json"
    target.write_text("old")
    real, os.replace = os.replace, lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device"))
    try:
        with pytest.raises(OSError, match="No space"):
            write_atomically(str(target), "new")
    finally:
        os.replace = real
    assert target.read_text() == "old"
    assert [p.name for p in folder.iterdir()] == ["r.json"]


SCHEMES: dict[str, Check] = {
    "step: raises": scheme("raise RuntimeError('out of order')", 3, "out of order"),
    "step: recurses": scheme("return step(problem, y, h, dW)", 3, "RecursionError"),
    "step: exits": scheme("sys.exit(0)", 3, "SystemExit"),
    "step: sleeps for ever": scheme(
        "time.sleep(3600)", 3, "did not come back", options="--law energy --timeout 0.5"
    ),
    "step: spins and catches everything": scheme(
        "while True:\n        try:\n            time.sleep(0.01)\n        except Exception:\n            pass",
        3,
        "did not come back",
        options="--law energy --timeout 0.5",
    ),
    "step: returns a generator": scheme("yield y", 1, "generator"),
    "step: returns a coroutine": scheme(
        "import asyncio\n    async def later(): return y\n    c = later()\n    c.close()\n    return c",
        1,
        "coroutine",
    ),
    "step: returns NaN": scheme("return y * np.nan", 1, "finite"),
    "step: returns objects": scheme("return y.astype(object)", 1, "object"),
    "step: returns a masked array": scheme("return np.ma.masked_invalid(y)", 1, "MaskedArray"),
    "step: returns its own argument": scheme("return y", 0, "holds"),
    "step: returns one buffer for all": scheme(
        "HISTORY.append(np.empty(3)) if not HISTORY else None\n    b = HISTORY[0][:y.shape[0]] if y.shape[0] < 4 "
        "else y.copy()\n    b[...] = y\n    return b",
        1,
        "violated",
        options="--law contract --examples 40",
    ),
    "step: changes y": scheme("y[...] = 0\n    return y.copy()", 1, "unchanged"),
    "step: changes the problem": scheme(
        "problem.c.setflags(write=True); problem.c[:] = 7\n    return y.copy()", 3, "ValueError"
    ),
    "step: depends on time": scheme("return y + 1e-9 * time.perf_counter()", 1, "one answer"),
    "step: depends on the number of calls": scheme(
        "HISTORY.append(1)\n    return y + len(HISTORY)", 1, "one answer"
    ),
    "step: keeps everything it sees": scheme(
        "HISTORY.append(bytearray(10**5))\n    return y.copy()", 0, "holds"
    ),
    "step: prints": scheme("print('noise')\n    return y.copy()", 0, "holds"),
    "step: warns": scheme("import warnings; warnings.warn('odd')\n    return y.copy()", 0, "holds"),
    "step: sets NumPy's error state": scheme("np.seterr(all='raise')\n    return y.copy()", 0, "holds"),
    "step: wrong arguments": cli(
        "verify mine:step", 3, "(problem, y, h, dW)", files={"mine.py": b"def step(y): return y"}
    ),
    "module: does not parse": cli("verify mine:step", 3, "SyntaxError", files={"mine.py": b"def step(:"}),
    "module: exits when imported": cli(
        "verify mine:step", 3, "SystemExit", files={"mine.py": b"import sys; sys.exit(0)"}
    ),
    "module: null bytes": cli("verify mine:step", 3, "mine", files={"mine.py": b"step = 1\x00"}),
    "module: no name": cli("verify :step", 3, "module"),
    "claims: not words": refused(lambda: Scheme("x", EP.step, claims=[1, 2])),
    "claims: unknown": refused(lambda: sepv.verify(EP, claims=["speed"])),
    "laws: none": right(lambda: sepv.verify(EP, laws=[]).exit_code, 1),
    "laws: unknown": refused(lambda: sepv.verify(EP, laws=["speed"])),
    "effort: no examples": refused(lambda: sepv.verify(EP, laws=["identity"], effort=Effort(examples=0))),
    "target: a number": refused(lambda: sepv.verify(3)),  # type: ignore[arg-type]
}

PROGRAMS: dict[str, Check] = {
    "program: not there": cli("verify --exec ./nosuch --law contract", 3, "nosuch"),
    "program: nothing": cli("verify --exec '' --law contract", 2),
    "program: unbalanced quotes": cli("""verify --exec '"./a' --law contract""", 2, "quot"),
    "program: exits at once": program("sys.exit(7)", "7"),
    "program: is killed": program("os.kill(os.getpid(), 9)"),
    "program: speaks no JSON": program("print('hello', flush=True); time.sleep(60)", "hello"),
    "program: an endless line": program("sys.stdout.write('x' * 10**7); sys.stdout.flush(); time.sleep(60)"),
    "program: JSON of another kind": program("print('[]', flush=True); time.sleep(60)"),
    "program: bytes that are no text": program(
        "sys.stdout.buffer.write(b'\\xff\\xfe\\n'); sys.stdout.flush(); time.sleep(60)"
    ),
    "program: JSON a hundred thousand deep": program("print('[' * 10**5, flush=True); time.sleep(60)"),
}

COMMANDS: dict[str, Check] = {
    "command: unknown": cli("validate", 2, "validate"),
    "option: unknown": cli("verify energy-preserving --fast", 2, "--fast"),
    "number: a word": cli("verify energy-preserving --examples many", 2, "many"),
    "number: beyond range": cli("hard --steps 0", 2, "--steps"),
    "number: a billion digits": cli(f"hard --steps {'9' * 5000}", 2),
    "seed: negative": cli("hard --seed -1", 2, "--seed"),
    "list of numbers: a word": cli("solvability rigid-body --noise 1,x", 2, "1,x"),
    "ulps: a problem of functions": cli(
        "ulps energy-preserving -p mine:p --steps 2",
        2,
        "extended precision",
        files={
            "mine.py": b"import dataclasses\nfrom sepv import problems\n"
            b"p = dataclasses.replace(problems.rigid_body(), data=None, check=False)\n"
        },
    ),
    "solvability: no initial state": cli(
        "solvability mine:p",
        2,
        "initial",
        files={
            "mine.py": b"import dataclasses\nfrom sepv import problems\n"
            b"p = dataclasses.replace(problems.rigid_body(), initial=None, check=False)\n"
        },
    ),
    "Ctrl-C in sepv hard": lambda folder: interrupted(folder, "hard --steps 1000000 --json r.json"),
    "Ctrl-C in sepv verify": lambda folder: interrupted(
        folder, "verify energy-preserving --json r.json --deep"
    ),
    "Ctrl-C in sepv solvability": lambda folder: interrupted(
        folder, "solvability lotka-volterra --states 4000 --json r.json"
    ),
    "end of the reader": lambda folder: broken_pipe(folder),  # noqa: PLW0108
}


def interrupted(folder: Path, arguments: str) -> None:
    """SIGINT while it works: exit code 130, no traceback, no half file."""
    child = subprocess.Popen(
        [sys.executable, "-m", "sepv", *arguments.split()],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    time.sleep(3)
    child.send_signal(signal.SIGINT)
    out, err = child.communicate(timeout=SECONDS)
    assert child.returncode == 130, f"{child.returncode}: {out} {err}"
    assert "Traceback" not in out + err
    assert [p.name for p in folder.iterdir() if p.name != "r.json"] == []
    if (folder / "r.json").exists():
        json.loads((folder / "r.json").read_text())


def broken_pipe(folder: Path) -> None:
    """``sepv list | head -1``: the reader goes away, and nobody complains."""
    done = subprocess.run(
        ["bash", "-o", "pipefail", "-c", f"{shlex.quote(sys.executable)} -m sepv hard --explain | head -1"],
        cwd=folder, capture_output=True, text=True, check=False, timeout=SECONDS,
    )  # fmt: skip
    assert "Traceback" not in done.stderr, done.stderr


GROUPS = {
    "step": STEPS, "path": PATHS, "made": MADE, "data": DATA, "file": FILES, "scheme": SCHEMES,
    "program": PROGRAMS, "command": COMMANDS,
}  # fmt: skip
CLASSES = {f"{group}: {name}": check for group, table in GROUPS.items() for name, check in table.items()}


@pytest.mark.parametrize("name", CLASSES)
def test_bad_input_ends_in_an_error_of_ours_or_a_right_result(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    monkeypatch.syspath_prepend(str(tmp_path))
    with np.errstate():
        CLASSES[name](tmp_path)
    # What came in has an end: no time limit of sepv's is left to go off later, and nobody went to another folder.
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    assert Path.cwd() == tmp_path.resolve()


def test_there_are_at_least_a_hundred_classes() -> None:
    assert len(CLASSES) >= 100
