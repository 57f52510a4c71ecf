"""Bad input, class by class: each ends in an error of sepv that says what to do, or in a right result.

A row is a call of a function of sepv; test_bad_commands.py has files, programs and commands. Nothing may hang: an alarm
rings after some seconds.
"""

import signal
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawn import J, by_hand
from sepv.reference import hard

import sepv
from sepv import problems, schemes
from sepv.errors import SepvError, StepFailure
from sepv.record import _polynomial as poly
from sepv.schemes import Scheme
from sepv.simulate import _wiener as wiener
from sepv.studies._solvability.branch import follow
from sepv.verification import Effort
from sepv.verification._cases import case as cases

EP = schemes.energy_preserving
BODY, VOLTERRA = problems.rigid_body(), problems.lotka_volterra()
Y, DW = np.array([0.8, 0.6, 0.0]), np.array([0.1])
Check = Callable[[], None]


def refused(call: Callable[[], Any], words: str = "") -> Check:
    """The call raises an error of sepv with its three parts and these words, and no other."""

    def check() -> None:
        with pytest.raises(SepvError, match=words or None) as caught:
            call()
        message = str(caught.value)
        assert "Remedy" in message, message
        assert "Expected" in message or "not solved" in message, message

    return check


def right(call: Callable[[], Any], answer: Any) -> Check:
    """The call is answered, and rightly."""

    def check() -> None:
        assert np.array_equal(call(), answer)

    return check


def step(y: Any = Y, h: Any = 0.1, dW: Any = DW, problem: sepv.Problem = BODY) -> Any:
    return EP.step(problem, y, h, dW)


def path(problem: Any = BODY, **arguments: Any) -> Check:
    """`sepv.integrate` refuses these arguments."""
    words = arguments.pop("words", "")
    return refused(lambda: sepv.integrate(EP, problem, **{"h": 0.1, "steps": 1, **arguments}), words)


def paths(**arguments: Any) -> Check:
    """`sepv.ensemble` refuses these arguments."""
    words = arguments.pop("words", "")
    return refused(lambda: sepv.ensemble(EP, BODY, **{"h": 0.1, "T": 1.0, "paths": 1, **arguments}), words)


def made(words: str = "", **changes: Any) -> Check:
    """A problem with this fault is refused."""
    return refused(lambda: by_hand(**changes), words)


def body(words: str, **changes: Any) -> Check:
    """The rigid body with another derivative is refused."""
    return refused(lambda: replace(BODY, check=True, **changes), words)


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


SYSTEM = {"dimension": 2, "hamiltonian": [[[2, 0], 0.5]], "structure": [[0, 1, [[[0, 0], -1.0]]]]}


def system(words: str = "", **changes: Any) -> Check:
    """Polynomial data with this fault are refused."""
    return refused(lambda: problems.polynomial_problem(problems.from_json({**SYSTEM, **changes})), words)


def token(text: str) -> Check:
    return refused(lambda: cases.from_token(text))


def scheme(words: str = "", **facts: Any) -> Check:
    return refused(lambda: Scheme("x", EP.step, **facts), words)


def verified(words: str = "", **arguments: Any) -> Check:
    return refused(lambda: sepv.verify(EP, **arguments), words)


CHECKS: dict[str, Check] = {
    "y: too short": refused(lambda: step(Y[:2])),
    "y: empty": refused(lambda: step(np.empty(0))),
    "y: three axes": refused(lambda: step(np.zeros((3, 2, 2)))),
    "y: transposed batch": refused(lambda: step(np.zeros((5, 3)), dW=np.zeros((1, 5)))),
    "y: NaN": refused(lambda: step(Y * np.nan)),
    "y: infinite": refused(lambda: step(Y + np.inf)),
    "y: words": refused(lambda: step(["a", "b", "c"])),
    "y: None": refused(lambda: step(None)),
    "y: complex": refused(lambda: step(Y + 1j)),
    "y: ragged": refused(lambda: step([[1.0], [1.0, 2.0], []])),
    "y: a list": right(lambda: step(Y.tolist()), step()),
    "y: integers": right(lambda: step(np.array([1, 1, 0])), step(np.array([1.0, 1.0, 0.0]))),
    "y: no lanes": right(lambda: step(np.empty((3, 0)), dW=np.empty((1, 0))), np.empty((3, 0))),
    "y: outside the domain": refused(lambda: step(np.array([1.0, -1.0, 1.0]), problem=VOLTERRA)),
    "dW: too long": refused(lambda: step(dW=np.zeros(2))),
    "dW: a scalar": refused(lambda: step(dW=0.1)),
    "dW: None": refused(lambda: step(dW=None)),
    "dW: infinite": refused(lambda: step(dW=np.array([np.inf]))),
    "h: None": refused(lambda: step(h=None)),
    "h: a word": refused(lambda: step(h="0.1")),
    "h: an array": refused(lambda: step(h=np.array([0.1, 0.2]))),
    "h: infinite": refused(lambda: step(h=float("inf"))),
    "h: complex": refused(lambda: step(h=0.1j)),
    "a step of 1e300": refused(lambda: step(Y[:2], 1e300, problem=hard.by_name("huge-constant").problem)),
    "a step of a name": refused(lambda: schemes.midpoint.step("pendulum", [0, 1], 0.1, [0, 0]), "by_name"),
    "integrate: h = 0": path(h=0.0),
    "integrate: h NaN": path(h=float("nan")),
    "integrate: h a word": path(h="a", words="a number such as h=0.01"),
    "integrate: h negative": path(h=-0.1, words="forwards in time"),
    "integrate: T no multiple of h": path(h=0.3, steps=None, T=1.0),
    "integrate: T a word": path(steps=None, T="1"),
    "integrate: T beyond counting": path(h=1e-300, steps=None, T=1e300, words="a larger h"),
    "integrate: neither T nor steps": path(steps=None),
    "integrate: half a step": path(steps=1.5),
    "integrate: y0 of another problem": path(y0=[1.0]),
    "integrate: y0 words": path(y0=["a"] * 3),
    "integrate: y0 text for a number": path(y0=["1", "2", "3"], words="text"),
    "integrate: y0 outside the domain": path(VOLTERRA, h=0.01, y0=[-1.0, 1.0, 1.0]),
    "integrate: dW too short": path(steps=2, dW=[[0.1]]),
    "integrate: dW NaN": path(dW=[[np.nan]]),
    "integrate: k = 0": path(truncation=0),
    "integrate: k a word": path(truncation="2", words="truncation k"),
    "integrate: h = 1 truncated": path(h=1.0),
    "integrate: no steps": path(steps=0),
    "integrate: steps a word": path(steps="2"),
    "integrate: steps and T": path(steps=3, T=1.0),
    "integrate: negative seed": path(seed=-1),
    "integrate: seed a word": path(seed="x"),
    "ensemble: no paths": paths(paths=0),
    "ensemble: infinite T": paths(T=float("inf")),
    "ensemble: unknown engine": paths(engine="steam"),
    "ensemble: compensated a word": paths(compensated="yes", words="compensated, True or False"),
    "ensemble: no workers": paths(workers=0),
    "ensemble: times beyond T": paths(times=[2.0]),
    "ensemble: times a word": paths(times="x", words="times: real"),
    "ensemble: negative T": paths(T=-1.0),
    "ensemble: more paths than memory holds": paths(paths=10**15, words="paths whose ends fit into memory"),
    "ensemble: one increment NaN":
        paths(dW=np.where(np.arange(30).reshape(10, 1, 3) == 14, np.nan, 0.0), words=r"dW\[4, 0, 2\] = nan"),
    "ensemble: y0 with an axis more": paths(y0=np.zeros((3, 1))),
    "ensemble: no initial state":
        refused(lambda: sepv.ensemble(EP, by_hand(), h=0.25, T=1.0, paths=3), "an initial state"),
    "long path: compensated a word":
        refused(lambda: sepv.long_path(EP, BODY, h=0.1, steps=1, compensated="yes"), "compensated, True or False"),
    "increments: half a step": refused(lambda: wiener.increments(0, T=1.0, steps=0, noises=1)),
    "increments: negative T": refused(lambda: wiener.increments(0, T=-1.0, steps=1, noises=1)),
    "exact flow: theta NaN": refused(lambda: sepv.exact_flow(BODY, float("nan")), "theta"),
    "exact flow: one theta infinite": refused(lambda: sepv.exact_flow(BODY, [1.0, np.inf]), "theta"),
    "exact flow: nothing asked": refused(lambda: sepv.exact_flow(BODY, []), "theta"),
    "exact flow: a table of times": refused(lambda: sepv.exact_flow(BODY, np.zeros((2, 2))), "theta"),
    "exact flow: words": refused(lambda: sepv.exact_flow(BODY, "soon")),
    "exact flow: y0 of another problem": refused(lambda: sepv.exact_flow(BODY, 1.0, np.zeros(2)), "y0"),
    "exact flow: y0 NaN": refused(lambda: sepv.exact_flow(BODY, 1.0, Y * np.nan), "y0"),
    "branch: range NaN": refused(lambda: follow(BODY, Y[:, None], float("nan"))),
    "hard case: unknown": refused(lambda: hard.by_name("easy")),
    "dimension: a word": made(dimension="2"),
    "dimension: a fraction": made(dimension=2.0),
    "dimension: none": made("d ≥ 1", dimension=0),
    "structure: raises": made(structure=lambda y: 1 / 0),
    "structure: returns None": made(structure=lambda y: None),
    "structure: returns a generator": made(structure=lambda y: (v for v in y)),
    "structure: not callable": made("structure=lambda y: …", structure=np.eye(2)),
    "structure: of two arguments": made("structure=lambda y: …", structure=lambda y, t: y),
    "structure: NaN": made(structure=lambda y: np.full((2, 2, *y.shape[1:]), np.nan)),
    "structure: recurses": made(structure=recursion),
    "structure: not skew":
        made(r"structure\(y\)\[1, 1\]", structure=lambda y: np.array([[0 * y[0], 1 + 0 * y[0]]] * 2)),
    "structure: off by 1e-9":
        made("skew-symmetric", structure=lambda y: J(y) + 1e-9 * np.array([[0 * y[0]] * 2, [1 + 0 * y[0], 0 * y[0]]])),
    "structure_derivative: of another shape":
        body(r"structure_derivative\(y\) of shape \(3, 3, 3\)", structure_derivative=lambda y: np.zeros((3, 3))),
    "hamiltonian: a word": made(hamiltonian=lambda y: "energy"),
    "hamiltonian: a vector": made(hamiltonian=lambda y: y),
    "gradient: NaN": made(gradient=lambda y: y * np.nan),
    "gradient: raises SystemExit": made(gradient=lambda y: sys.exit(0)),
    "gradient: counts its calls": made(gradient=counting()),
    "gradient: looks at the clock": made(gradient=by_time),
    "gradient: changes y": made(gradient=spoil),
    "gradient: of another H":
        made(r"gradient\(y\)\[1\].*∂H/∂y\[1\]", gradient=lambda y: np.array([y[0] ** 3, 2 * y[1]])),
    "gradient: wrong by 1e-6": made(r"gradient\(y\)\[1\]", gradient=lambda y: np.array([y[0] ** 3, y[1] + 1e-6])),
    "gradient: of wrong shape": made("shape", gradient=lambda y: y[:1]),
    "gradient: for one state":
        made("component first", gradient=lambda y: np.array([float(y[0]) ** 3, float(y[1])])),
    "mean_gradient: of the midpoint, off by the cube of the distance":
        made(r"\(x − y\)ᵀmean_gradient = H\(x\) − H\(y\)", degree=4,
             mean_gradient=lambda y, x: np.stack([((x[0] + y[0]) / 2) ** 3, (x[1] + y[1]) / 2])),
    "hessian: of another H":
        made("hessian", hessian=lambda y: np.array([[y[0], 0 * y[0]], [0 * y[0], 1 + 0 * y[0]]])),
    "hessian: a vector": body(r"hessian\(y\) of shape \(3, 3\)", hessian=lambda y: np.ones(3)),
    "degree: below that of H":
        refused(lambda: sepv.Problem(2, J, lambda y: y[0] ** 4, degree=2), "the degree of the polynomial"),
    "domain: raises": made(domain=lambda y: 1 / 0),
    "domain: returns None": made(domain=lambda y: None),
    "domain: excludes everything": made("domain", domain=lambda y: y[0] > 1e9),
    "initial: NaN": made(initial=(np.nan, 1.0)),
    "initial: words": made(initial=("a", "b")),
    "initial: of wrong shape": made(r"\(2,\)", initial=(1.0,)),
    "initial: outside the domain": made(initial=(-1.0, 1.0), domain=lambda y: y[0] > 0),
    "casimirs: none": made("Casimir", casimirs=(np.eye(2),)),
    "casimirs: no linear one": made("Casimir", linear_casimirs=((1.0, 0.0),)),
    "casimirs: not symmetric": made("symmetric", casimirs=(((0.0, 1.0), (0.0, 0.0)),)),
    "casimirs: of wrong shape": made(r"\(2, 2\)", casimirs=(np.eye(3),)),
    "casimirs: a matrix": made(r"casimirs=\(only,\)", casimirs=np.eye(2)),
    "noise: words": made(noise=("a",)),
    "noise: infinite": made("finite", noise=(np.inf,)),
    "noise: NaN": refused(lambda: problems.pendulum(noise=(np.nan,)), "give a number for each noise"),
    "noise: a table": refused(lambda: problems.pendulum(noise=[[1, 2], [3, 4]]), "in one row"),
    "noise: negative": made("≥ 0", noise=(-1.0,)),
    "rigid body: negative inertia": refused(lambda: problems.rigid_body(inertia=(1, -1, 1))),
    "rigid body: two moments": refused(lambda: problems.rigid_body(inertia=(1, 1))),
    "kepler: a hyperbola": refused(lambda: problems.kepler(eccentricity=1.5)),
    "planets: an axis for two": refused(lambda: problems.planets(axes=(1.0,)), "axis"),
    "toda: one particle": refused(lambda: problems.toda(particles=1), "particles"),
    "toda: half a particle": refused(lambda: problems.toda(particles=2.5), "particles"),
    "lotka-volterra: NaN": refused(lambda: problems.lotka_volterra(nu=float("nan"))),
    "a name that is none": refused(lambda: problems.by_name("three-body")),
    "polynomial: negative exponent": refused(lambda: poly.polynomial(2, {(1, -1): 1.0}), "≥ 0"),
    "polynomial: too few exponents": refused(lambda: poly.polynomial(2, {(1,): 1.0}), "2 exponents"),
    "polynomial: infinite coefficient": refused(lambda: poly.polynomial(1, {(1,): np.inf}), "finite"),
    "polynomial: exponent of a billion": refused(lambda: poly.polynomial(1, {(10**9,): 1.0}), "degree"),
    "system: no dimension": refused(lambda: problems.from_json({"hamiltonian": [], "structure": []})),
    "system: zero dimensions": system(dimension=0, hamiltonian=[], structure=[]),
    "system: exponents of another dimension": system(hamiltonian=[[[2], 0.5]]),
    "system: a coefficient that is a word": system(hamiltonian=[[[2, 0], "half"]]),
    "system: structure below the diagonal": system("above the diagonal", structure=[[1, 0, [[[0, 0], 1.0]]]]),
    "system: an entry twice": system(structure=[[0, 1, []], [0, 1, []]]),
    "system: index beyond d": system(structure=[[0, 5, []]]),
    "system: a Casimir that is none": system(casimirs=[[[1.0, 0.0], [0.0, 1.0]]]),
    "system: a number": refused(lambda: problems.from_json(3)),
    "case: no increments": refused(lambda: cases.from_json({"problem": SYSTEM, "y": [1, 1], "h": 0.1})),
    "case: a list": refused(lambda: cases.from_json([1, 2])),
    "token: empty": token(""),
    "claims: not words": scheme("names of laws", claims=[1, 2]),
    "claims: a number": scheme("claims, names", claims=5),
    "order: a text": scheme("mean_square_order, a number", mean_square_order="1"),
    "tolerance: NaN": scheme("solver_tolerance", solver_tolerance=np.nan),
    "claims: unknown": verified(claims=["speed"]),
    "laws: none": right(lambda: sepv.verify(EP, laws=[]).exit_code, 1),
    "laws: unknown": verified(laws=["speed"]),
    "laws: a number": verified("names of laws", laws=5),
    "timeout: NaN": verified("timeout=600", laws="identity", timeout=np.nan),
    "effort: no examples": refused(lambda: Effort(examples=0)),
    "effort: NaN": refused(lambda: Effort(paths=np.nan), "paths, an integer"),
    "target: a number": refused(lambda: sepv.verify(3)),
}  # fmt: skip


@pytest.mark.usefixtures("alarm")
@pytest.mark.parametrize("name", CHECKS)
def test_bad_input_ends_in_an_error_of_ours_or_a_right_result(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with np.errstate():
        CHECKS[name]()
    # What came in has an end: no time limit of sepv's is left to go off later, and nobody went to another folder.
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    assert Path.cwd() == tmp_path.resolve()


def test_a_failed_step_of_a_batch_has_its_message() -> None:
    failure = StepFailure("no convergence", y=np.zeros((3, 5)), delta=0.5, residual=1.0, iterations=7)
    assert "no convergence after 7 iterations" in str(failure)
    assert "a batch of 5 states" in str(failure)
    assert "y = [1.0, 2.0], Δ = 0.5, residual 1.000e+00" in str(
        StepFailure("no convergence", y=np.array([1.0, 2.0]), delta=0.5, residual=1.0)
    )
