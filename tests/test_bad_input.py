"""Bad input, class by class: each ends in an error of sepv that says what to do, or in a right result.

One parametrised test, a row for each class, grouped by the door the input comes through: here functions of sepv, in
test_bad_commands.py files, programs and commands. Nothing may hang: an alarm rings after some seconds.
"""

from __future__ import annotations

import signal
import sys
import time
import zlib
from base64 import urlsafe_b64encode
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sepv
from sepv import problems, schemes
from sepv.errors import SepvError
from sepv.problems import hard
from sepv.record import _polynomial as poly
from sepv.schemes import Scheme
from sepv.simulate import _wiener as wiener
from sepv.studies._solvability.branch import follow
from sepv.verification import Effort, strategies
from sepv.verification._cases import case as cases

EP = schemes.energy_preserving
BODY = problems.rigid_body()
Y, DW = np.array([0.8, 0.6, 0.0]), np.array([0.1])
Check = Callable[[Path], None]


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


SCHEMES: dict[str, Check] = {
    "claims: not words": refused(lambda: Scheme("x", EP.step, claims=[1, 2])),
    "claims: unknown": refused(lambda: sepv.verify(EP, claims=["speed"])),
    "laws: none": right(lambda: sepv.verify(EP, laws=[]).exit_code, 1),
    "laws: unknown": refused(lambda: sepv.verify(EP, laws=["speed"])),
    "effort: no examples": refused(lambda: sepv.verify(EP, laws=["identity"], effort=Effort(examples=0))),
    "target: a number": refused(lambda: sepv.verify(3)),  # type: ignore[arg-type]
}

GROUPS = {"step": STEPS, "path": PATHS, "made": MADE, "data": DATA, "scheme": SCHEMES}
CLASSES = {f"{group}: {name}": check for group, table in GROUPS.items() for name, check in table.items()}


@pytest.mark.usefixtures("alarm")
@pytest.mark.parametrize("name", CLASSES)
def test_bad_input_ends_in_an_error_of_ours_or_a_right_result(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with np.errstate():
        CLASSES[name](tmp_path)
    # What came in has an end: no time limit of sepv's is left to go off later, and nobody went to another folder.
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    assert Path.cwd() == tmp_path.resolve()
