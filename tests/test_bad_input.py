"""Bad input, class by class: each ends in an error of sepv that says what to do,
or in a right result.

A row is a call of a function of sepv; test_bad_commands.py has files, programs and commands.
Nothing may hang: an alarm rings after some seconds.
"""

import signal
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawn import J, by_hand
from sepv.reference.elliptic import closed_form
from sepv.reference.flow import taylor
from sepv.reference.problem import exact_problem
from sepv.reference.steps import reference_step

import sepv
from sepv import PolynomialSystem, SepvError, Skipped, StepFailure, hard_cases, problems, schemes
from sepv.faults import detection
from sepv.law.cases import case as cases
from sepv.paper.several_with_areas import step_with_areas
from sepv.posing import pose, pose_fields
from sepv.problem import HamiltoniansProblem, NamedProblem, StructuresProblem, Systems, mechanics
from sepv.problems._common import canonical
from sepv.record import _polynomial as poly
from sepv.schemes import Orders, PointLaw, Scheme, continued, divided
from sepv.simulate import _truncation as bounded
from sepv.simulate import _wiener as wiener
from sepv.studies._solvability.branch import End, follow
from sepv.verification import Cases, Effort, requirements

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


def each(values: Iterable[Any], call: Callable[[Any], Any], words: str = "") -> Check:
    """The call is refused with each of these values."""
    checks = [refused(lambda value=value: call(value), words) for value in values]

    def check() -> None:
        for one in checks:
            one()

    return check


def skipped(call: Callable[[], Any], words: str) -> Check:
    """A system that the call is not for is left out with a reason, and no fault of anyone."""

    def check() -> None:
        with pytest.raises(Skipped, match=words):
            call()

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


def other_structure(y: Any) -> Any:
    """A skew matrix of which |y|² is no Casimir."""
    B = np.zeros((3, 3, *y.shape[1:]))
    B[0, 1], B[1, 0] = y[2], -y[2]
    return B


def structures(
    words: str, *, noise: Any = (1.0,), structure: Any = BODY.structure, casimirs: Any = ()
) -> Check:
    """Several structures with this fault are refused."""
    parts = (3, BODY.structure, BODY.hamiltonian, BODY.gradient)
    facts = {"noise": noise, "noise_structures": (structure,), "casimirs": casimirs}
    return refused(lambda: StructuresProblem(*parts, **facts), words)


def pushed(words: str, **facts: Any) -> Check:
    """Several Hamiltonians with this fault are refused."""
    parts = (3, BODY.structure, BODY.hamiltonian, BODY.gradient)
    facts = {"noise": (1.0,), "noise_hamiltonians": (lambda y: y[0],), "initial": BODY.initial} | facts
    return refused(lambda: HamiltoniansProblem(*parts, **facts), words)


def bare(words: str, **changes: Any) -> Check:
    """B and H of which nothing can be derived are refused."""
    parts = {"structure": J, "hamiltonian": lambda y: 0.5 * y[0] ** 2 - np.cos(y[1])} | changes
    return refused(lambda: sepv.Problem(2, **parts), words)


def mechanical(words: str, *terms: tuple[tuple[int, int], float]) -> Check:
    """H of the plane that is not T(p) + V(q) with a mass is refused."""
    problem = problems.build(PolynomialSystem(2, poly.polynomial(2, dict(terms)), canonical(2, 1.0)))
    return refused(lambda: mechanics(problem), f"(?s)a mechanical problem.*{words}")


def spins(scheme: Any, words: str, problem: Any, *rows: Any) -> Check:
    """A scheme for several Hamiltonians leaves out a problem that it does not take."""
    y = np.resize(problem.initial, problem.dimension)
    return skipped(lambda: scheme.step(problem, y, 0.1, *rows), words)


FOR_ONE = [*schemes.PAPER.values(), schemes.collocation(2), schemes.gauss(2), schemes.explicit(4)]
FIRST, FEW = {"q": lambda ends: ends.y[0]}, Effort(examples=2)
TOPS, INERTIA, VORTICES = problems.noncommuting_tops(), problems.random_inertia(), problems.point_vortices()
SU3, SPINS, KIND = problems.su3_top(), problems.two_spins(), "energy-preserving"
ONE, TWO, NOTHING = poly.constant(3, 1.0), poly.constant(2, 1.0), np.zeros(2)
NAMBU = problems.nambu_system(poly.variable(3, 0), ONE, poly.variable(3, 1))
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
    "a step of 1e300": refused(lambda: step(Y[:2], 1e300, problem=hard_cases.by_name("huge-constant").problem)),
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
    "dimension: a word": made(dimension="2"),
    "dimension: a fraction": made(dimension=2.0),
    "dimension: none": made("d ≥ 1", dimension=0),
    "structure: raises": made(structure=lambda y: 1 / 0),
    "structure: returns None": made(structure=lambda y: None),
    "structure: returns a generator": made(structure=lambda y: (v for v in y)),
    "structure: not callable": made("structure=lambda y: …", structure=3.0),
    "structure: a matrix that is not skew": made("skew-symmetric", structure=np.eye(2)),
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
    "polynomial: a degree too high": refused(lambda: poly.polynomial(1, {(poly.MAX_DEGREE + 1,): 1.0}), "degree"),
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
    "claims: misspelt": scheme("did you mean 'energy'", claims=["enrgy"]),
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
    "another scheme: y, h and dW": each(
        product((schemes.midpoint, schemes.euler_heun), ((Y[:2], 0.1, DW), (Y, np.nan, DW), (Y, 0.1, DW + np.inf))),
        lambda asked: asked[0].step(BODY, *asked[1])),
    "exact flow: no initial state":
        refused(lambda: sepv.exact_flow(by_hand(), 1.0), "or initial= when making the problem"),
    "exact flow: several structures": each((TOPS, INERTIA), lambda p: sepv.exact_flow(p, 1.0), "several structures"),
    "closed form: none": refused(lambda: closed_form(VOLTERRA.data, (1.0, 1.9, 0.5), 1.0), "closed form"),
    "closed form: equal moments":
        refused(lambda: closed_form(problems.rigid_body((1.0, 1.0, 2.0)).data, (0.1, 0.2, 0.3), 1.0), "moments"),
    "series: theta NaN": refused(lambda: taylor(BODY.data, (0.8, 0.6, 0.0), float("nan")), "finite θ"),
    "reference: y and dW": each(
        (((0.8, 0.6), 0.1, (0.1,)), ((0.8, 0.6, 0.0), 0.1, ()), ((0.8, float("nan"), 0.0), 0.1, (0.1,))),
        lambda asked: reference_step(KIND, BODY.data, *asked), "one number for each component"),
    "reference: unknown problem": refused(lambda: exact_problem(NamedProblem("nosuch"), 50), "known to the references"),
    "reference: no solution":
        refused(lambda: reference_step(KIND, VOLTERRA.data, [1.0, 1.9, 0.5], 0.5, [3.0]), "extended precision"),
    "teeth: unknown saboteur": refused(lambda: detection.run(["b-at-y2"], [0]), "Expected a saboteur"),
    "areas: one structure": refused(
        lambda: step_with_areas(problems.pendulum(), np.ones(2), 0.1, NOTHING, np.zeros((2, 2))), "several structures"),
    "divided: an explicit scheme": refused(lambda: divided(schemes.euler_heun), "implicit scheme"),
    "divided: depth": each((0, 21, 1.5, True), lambda depth: divided(schemes.midpoint, depth), "depth"),
    "continued: a scheme without a start":
        each((schemes.euler_heun, schemes.collocation(2), divided(EP), replace(EP, solve=None)), continued, "start"),
    "points: no law": each(
        (((), ()), ((1, -1), (0.5, 0.5)), ((-1, 1), (0.5, 0.4)), ((-1, 1), (1.0,)), ((0, np.inf), (0.5, 0.5))),
        lambda law: PointLaw("mine", *law), "such as PointLaw"),
    "points: misspelt": scheme("three-point", increments="tree-point"),
    "family: order": each((0, 3, 5, "4"), schemes.explicit, "one of 4, 8"),
    "family: order of a projection": each((3, "8", 5), schemes.projected, "one of 4, 8"),
    "family: stages": each((0, 7, 1.5, True, "2"), schemes.collocation, "stages"),
    "family: name": each(
        ("collocation-0", "collocation-7", "collocation", "gauss-x"), schemes.by_name, "collocation-1"),
    "scheme: a name for a function": refused(lambda: Scheme("mine", "step"), "hand over the function itself"),
    "scheme: half precision": scheme("float32", dtype="float16"),
    "scheme: a type for its name": right(lambda: Scheme("s", EP.step, dtype=np.float32).dtype, "float32"),
    "scheme: longest step": each(
        (0.0, -1.0, float("nan"), "1"), lambda limit: Scheme("x", EP.step, longest_step=limit),
        "longest_step, a number > 0"),
    "scheme: an order of paths without noise": scheme("without noise", noise=False, mean_square_order=1.0),
    "scheme: additive without noise": scheme("without noise", noise=False, systems=Systems.ADDITIVE),
    "scheme: an order below zero": scheme("order, a number", order=-1),
    "scheme: a weaker order for less noise": refused(lambda: Orders(1.0, commutative=0.5), "weaker"),
    "scheme: paths of a few points":
        refused(lambda: replace(schemes.midpoint, increments="two-point"), "weak order alone"),
    "ensemble: areas that are not drawn": refused(
        lambda: sepv.ensemble("drift-preserving", "noisy-henon-heiles", h=0.125, T=1.0, paths=3), "asks for halves"),
    "scheme: unknown class": scheme("single, nambu", systems="double"),
    "scheme: asks for all": scheme("areas", asks="all"),
    "reduce: no name": paths(reduce=lambda ends: ends.y[0], words="functionals by name"),
    "reduce: nothing": paths(reduce={}, words="functionals by name"),
    "reduce: a bound alone": paths(until={"q": 1e-3}, words="functionals by name"),
    "reduce: a bound for another": paths(reduce=FIRST, until={"p": 1e-3}, words="among q"),
    "reduce: a bound of zero": paths(reduce=FIRST, until={"q": 0}, words="a standard error > 0"),
    "reduce: no number for a path": paths(
        paths=64, reduce={"q": lambda ends: ends.y}, words=r"one real number for each path .* shape \(64,\)"),
    "increments: wrong arguments": each(
        ({"seed": -1}, {"seed": 1.5}, {"T": 0.0}, {"T": np.inf}, {"steps": 0}, {"noises": -1}, {"paths": 0},
         {"paths": range(-1, 3)}, {"refine": 3}, {"refine": -1}),
        lambda wrong: wiener.increments(**{"seed": 0, "T": 1.0, "steps": 4, "noises": 1, "paths": 1, **wrong})),
    "increments: too few to add": refused(lambda: wiener.coarsen(np.zeros((5, 1)), 2), "divisible"),
    "truncation: h": each(
        (1.0, 1.5, 0.0, -0.1, np.nan), lambda h: bounded.truncate(np.zeros(3), h), "0 < h < 1"),
    "truncation: k": each((0, -1, 1.5), lambda k: bounded.truncate(np.zeros(3), 0.1, k), "integer ≥ 1"),
    "structure: off by 1e-12": refused(
        lambda: replace(hard_cases.by_name("nearly-skew-1e-12").problem, check=True), "skew"),
    "structure: off by 1e-16": right(
        lambda: replace(hard_cases.by_name("nearly-skew-1e-16").problem, check=True).dimension, 2),
    "branch: of the midpoint rule":
        right(lambda: follow(BODY, Y[:, None], 0.1, schemes.midpoint).end, [End.RANGE]),
    "branch: no range": refused(lambda: follow(BODY, Y[:, None], 0.0), "not 0"),
    "profile: none": each(
        ("", ",", "nonsense", "order", "order-0", "order--1", "order-nan", "order-1/0", "order-1e9", "energy-1", [],
         [3]), requirements, "profile|an order after"),
    "profile: beside laws": verified("profiles to require, or a list of laws", require="energy", laws=["energy"]),
    "jobs: none": verified("jobs", jobs=0),
    "jobs: a scheme that cannot travel": refused(
        lambda: sepv.verify(lambda problem, y, h, dW: y, laws=["energy", "casimir"], jobs=2),
        "another process can import"),
    "replay: of a law that holds":
        refused(lambda: sepv.verify(EP, laws="identity", effort=FEW).replay("identity"), "which ended in: holds"),
    "stratum: unknown axis": refused(lambda: Cases(where={"dimension": ("2",)}), "an axis of cases"),
    "stratum: unknown": refused(lambda: Cases(where={"d": ("1000",)}), "a stratum of d"),
    "case: shown in no way": refused(
        lambda: cases.from_json({"problem": SYSTEM, "y": [1, 1], "h": 0.1, "dW": [], "given": "hearsay"}),
        "a way to show the problem"),
    "problem: a misspelt family": verified("did you mean 'canonical-separable'", problems="canonical-seperable"),
    "problem: an attribute that is none": verified("which is float", problems="math:pi"),
    "problem: none at all": verified("problems, one at least", problems=[]),
    "problem: a number": verified("which is int", problems=3),
    "problem: as data without any": refused(lambda: problems.to_json(VORTICES), "made of Python functions"),
    "damping: none": skipped(lambda: schemes.conformal.step(BODY, Y, 0.1, DW), "has no damping"),
    "damping: NaN": refused(lambda: replace(problems.damped_top(), damping=float("nan")), "finite number"),
    "damping: beside Hamiltonians":
        refused(lambda: problems.build(replace(INERTIA.data, damping=0.5)), "give the matrix γI"),
    "several Hamiltonians: one for two noises": pushed("2 noise_hamiltonians", noise=(1.0, 1.0)),
    "several Hamiltonians: another gradient":
        pushed("gradient to be that of hamiltonian", noise_gradients=(lambda y: 0 * y,)),
    "several Hamiltonians: a random step": refused(lambda: SPINS.random_step(0.1, NOTHING), "no such step"),
    "splitting: two spins": spins(schemes.stochastic_splitting, "noise_flows", SPINS, NOTHING),
    "drift-preserving: two spins": spins(schemes.drift_preserving, "not additive", SPINS, NOTHING, NOTHING),
    "darboux-lie: a body": spins(schemes.darboux_lie, "b_ij y_i y_j", INERTIA, NOTHING),
    "isospectral: species": spins(schemes.isospectral_midpoint, "so", problems.random_lotka_volterra(), np.zeros(3)),
    "isospectral: another structure": spins(
        schemes.isospectral_midpoint, "not that of so",
        replace(SU3, structure=lambda y: 2 * SU3.structure(y), data=None, check=False), NOTHING),
    "midpoint: several structures": spins(schemes.stochastic_midpoint, "several structures", TOPS, NOTHING),
    "midpoint: vectors": spins(schemes.stochastic_midpoint, "vectors", problems.pushed_rigid_body(), NOTHING),
    "both invariants: a pendulum":
        spins(schemes.both_invariants, "pendulum is not given as", problems.pendulum(), NOTHING),
    "leapfrog: a body": spins(schemes.leapfrog, "not mechanical", BODY, np.zeros(1)),
    "flows: kepler":
        spins(schemes.splitting, "kepler gives no exact flows of parts of H", problems.kepler(), np.zeros(1)),
    "polynomial casimirs: none": refused(
        lambda: problems.build(replace(SU3.data, polynomial_casimirs=(poly.squares((1.0,) * 7 + (2.0,)),))),
        r"polynomial_casimirs\[0\] to be a Casimir"),
    "polynomial casimirs: of one variable": refused(
        lambda: problems.build(replace(SU3.data, polynomial_casimirs=(poly.squares((1.0,)),))), "8 variables"),
    "mechanics: a body": refused(lambda: mechanics(BODY), r"(?s)a mechanical problem.*B = "),
    "mechanics: H with pq": mechanical("p alone", ((2, 0), 1.0), ((0, 2), 0.5), ((1, 1), 1.0)),
    "mechanics: H of degree 4 in p": mechanical("p alone", ((2, 0), 1.0), ((0, 4), 0.5)),
    "mechanics: a negative mass": mechanical("positive definite", ((2, 0), 1.0), ((0, 2), -0.5)),
    "mechanics: a mass that depends on q": refused(
        lambda: mechanics(sepv.Problem(2, lambda y: -J(y), lambda y: y[0] ** 2 + y[1] ** 2 * (1 + y[0] ** 2))),
        r"(?s)a mechanical problem.*∇H"),
    "nambu: of two variables": refused(lambda: problems.nambu_system(ONE, TWO, ONE), "3 variables"),
    "nambu: without its structure": refused(
        lambda: problems.polynomial_problem(PolynomialSystem(3, NAMBU.hamiltonian, (), nambu=NAMBU.nambu)),
        "nambu_system"),
    "commuting: a Hamiltonian that does not": refused(
        lambda: sepv.problem.commuting_hamiltonians(
            problems.harmonic_oscillator(), [lambda y: np.stack([0 * y[0], 1 + 0 * y[1]])]),
        r"\{H_0, H_1\} = -0\.2 at y = \[0\.2, 0\.1\]"),
    "structures: not skew": structures("skew", structure=lambda y: np.zeros((3, 3, *y.shape[1:])) + 1.0),
    "structures: two noises": structures("one for each coefficient", noise=(1.0, 2.0)),
    "structures: a lost Casimir": structures("Casimir", structure=other_structure, casimirs=BODY.casimirs),
    "one structure: several": each(FOR_ONE, lambda s: s.step(TOPS, np.ones(3), 0.1, NOTHING), "several-structures"),
    "one structure: several Hamiltonians": each(
        (*FOR_ONE, schemes.several_structures, schemes.modified_weak_two),
        lambda s: s.step(INERTIA, np.ones(3), 0.1, NOTHING), "several Hamiltonians"),
    "derived: H that branches": bare("branches on a value", hamiltonian=lambda y: y[0] ** 2 if y[1] > 0 else y[1]),
    "derived: a floor": bare("np.floor", hamiltonian=lambda y: np.floor(y[0])),
    "derived: an attribute": bare("AttributeError", hamiltonian=lambda y: y.no_such_thing),
    "derived: H of shape d": bare(r"shape \(\)", hamiltonian=lambda y: y * y),
    "derived: B of values":
        bare("wants the value", structure=lambda y: np.array([[float(y[0]), 1.0], [-1.0, 0.0]])),
    "posing: functions": skipped(lambda: pose(by_hand()), "polynomial_problem"),
    "posing: rotations": skipped(lambda: pose(problems.commuting_rotations()), "polynomial_problem"),
    "posing: fields of functions": skipped(lambda: pose_fields(BODY), "given as data"),
}  # fmt: skip


@pytest.mark.usefixtures("alarm")
@pytest.mark.parametrize("name", CHECKS)
def test_bad_input_ends_in_an_error_of_ours_or_a_right_result(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with np.errstate():
        CHECKS[name]()
    # What came in has an end: no time limit of sepv's is left to go off later, and nobody went to
    # another folder.
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    assert Path.cwd() == tmp_path.resolve()


def test_a_failed_step_of_a_batch_has_its_message() -> None:
    failure = StepFailure("no convergence", y=np.zeros((3, 5)), delta=0.5, residual=1.0, iterations=7)
    assert "no convergence after 7 iterations" in str(failure)
    assert "a batch of 5 states" in str(failure)
    assert "y = [1.0, 2.0], Δ = 0.5, residual 1.000e+00" in str(
        StepFailure("no convergence", y=np.array([1.0, 2.0]), delta=0.5, residual=1.0)
    )
