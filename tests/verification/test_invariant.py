"""The law *invariant*: functions that a user states change as along the exact flow,
on each path or in the mean.
"""

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from sepv.properties._trace_formula import nodes
from sepv.properties.test_invariant import affordable

import sepv
from sepv.errors import ProblemError
from sepv.law import Case
from sepv.problem import (
    Array,
    DampedProblem,
    HamiltoniansProblem,
    PolynomialSystem,
    Problem,
    StructuresProblem,
    relation,
)
from sepv.problems import from_json, planes, planets, polynomial_problem, to_json
from sepv.record import poly
from sepv.verification import Effort, Finding, Verdict, load_laws

FEW = Effort(examples=2)
PLANE = np.kron([[0.0, 1.0], [-1.0, 0.0]], np.eye(2))


def central(y: Array) -> Array:
    return 0.5 * (y[2] ** 2 + y[3] ** 2) + 0.25 * (y[0] ** 2 + y[1] ** 2) ** 2


def turning(y: Array) -> Array:
    return y[0] * y[3] - y[1] * y[2]


def in_plane(**more: Any) -> Problem:
    """A particle in a central potential, y = (q, p)."""
    return Problem(4, PLANE, central, initial=(1.0, 0.0, 0.2, 0.7), name="central", **more)


def hat(y: Array) -> Array:
    zero = 0 * y[0]
    return np.array([[zero, -y[2], y[1]], [y[2], zero, -y[0]], [-y[1], y[0], zero]])


C = 0.5


def spin() -> Problem:
    """A spin in a field along its third axis, rotated by noises about the first and the second."""
    return HamiltoniansProblem(
        3, hat, lambda y: y[2], noise=(C, C), noise_hamiltonians=(lambda y: y[0], lambda y: y[1]),
        initial=(0.6, 0.0, 0.8), name="spin", invariants={"height": lambda y: y[2], "norm": lambda y: y @ y},
    )  # fmt: skip


def damped(**invariants: Any) -> Problem:
    return DampedProblem(
        3, hat, lambda y: y[0] ** 2 + y[1] ** 2 / 2 + y[2] ** 2 / 4, damping=0.5, initial=(0.8, 0.6, 0.1),
        invariants=invariants, name="damped",
    )  # fmt: skip


def asked(scheme: Any, problem: Problem) -> Finding:
    return sepv.verify(scheme, laws="invariant", problems=problem, effort=FEW).finding("invariant")


def test_constants_and_moving_noises_are_those_of_the_generator() -> None:
    height, norm = (relation(spin(), name) for name in ("height", "norm"))
    assert (height.sigma, height.decay, height.moved) == (0, C * C, (0, 1))
    assert (norm.sigma, norm.decay, norm.moved) == (0, 0, ())
    pushed = HamiltoniansProblem(
        4, PLANE, central, noise=(0.5, 0.25), noise_vectors=np.eye(4)[2:].tolist(), initial=(1.0, 0.0, 0.2, 0.7),
        invariants={"H": central, "angular momentum": turning},
    )  # fmt: skip
    assert relation(pushed, "H").sigma == (0.5**2 + 0.25**2) / 2
    assert relation(pushed, "angular momentum").moved == (0, 1)


def test_damping_gives_decay_and_constant_rates() -> None:
    problem = damped(
        square=lambda y: y @ y, logarithm=lambda y: np.log(y @ y), both=lambda y: 3 + 2 * (y @ y)
    )
    found = {name: relation(problem, name) for name in problem.invariants}
    assert found["square"].decay == 1.0
    assert (found["logarithm"].sigma, found["logarithm"].decay) == (-1.0, 0.0)
    assert (found["both"].sigma, found["both"].decay) == (3.0, 1.0)
    assert asked(sepv.schemes.conformal, problem).verdict is Verdict.HOLDS


def test_a_structure_of_a_noise_counts() -> None:
    turned = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 0.0]])
    problem = StructuresProblem(
        3, lambda y: 0 * hat(y), lambda y: 0.5 * (y @ y), noise_structures=(turned,), initial=(1.0, 0.5, 0.25),
        invariants={"third": lambda y: y[2], "square": lambda y: y[0] ** 2 + y[1] ** 2},
    )  # fmt: skip
    assert [relation(problem, name).moved for name in problem.invariants] == [(), ()]
    with pytest.raises(ProblemError, match="LI ="):  # LI = −½ y_1 y_1 + ½ … of y_1² alone is no σ − λI
        replace(problem, invariants={"first": lambda y: y[0] ** 4})


@pytest.mark.parametrize(
    ("invariants", "words"),
    [
        ({"p": lambda y: y[2]}, r"LI = .* at y = \[1.0, 0.0, 0.2, 0.7\]"),
        ({"p": lambda y: y[:2]}, "shape"),
        ({"p": lambda y: math.sin(y[0])}, "invariants"),
        ({"p": 3}, "names with functions"),
        ((turning,), "names with functions"),
    ],
)
def test_other_functions_are_refused_with_a_state_or_the_reason(invariants: Any, words: str) -> None:
    with pytest.raises(ProblemError, match=words):
        in_plane(invariants=invariants)


def test_a_function_of_one_state_is_taken() -> None:
    problem = in_plane(
        invariants={"square": lambda y: (y[:2] @ y[:2]) * (y[2:] @ y[2:]) - (y[:2] @ y[2:]) ** 2}
    )
    assert problem.invariants["square"](np.ones((4, 3))).shape == (3,)


@pytest.mark.parametrize(
    ("scheme", "verdict"), [("midpoint", Verdict.HOLDS), ("energy-preserving", Verdict.VIOLATED)]
)
def test_angular_momentum_is_kept_by_the_midpoint_rule_alone(scheme: str, verdict: Verdict) -> None:
    problem = in_plane(invariants={"angular momentum": turning})
    found = asked(scheme, problem)
    assert found.verdict is verdict
    if verdict is Verdict.VIOLATED:
        assert "angular momentum" in found.message
        assert found.witness is not None
        (law,) = load_laws(["invariant"])
        again = law.replay(law, replace(sepv.schemes.by_name(scheme), problems=(problem,)), found.witness)
        assert again.verdict is verdict


def test_a_quintillionth_of_angular_momentum_is_seen() -> None:
    """The defect of one step, 2⁻⁴⁰ of L, is thousands of times its bound."""

    def faulty(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        return sepv.schemes.midpoint.step(problem, y, h, dW) * (1 + 2.0**-40)

    scheme = sepv.Scheme("faulty", faulty)
    assert asked(scheme, in_plane(invariants={"angular momentum": turning})).verdict is Verdict.VIOLATED


def rotated(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Rotations about the axes 3, 1 and 2 by the angles h, c_1ΔW_1 and c_2ΔW_2: the flows of y_3,
    y_1 and y_2.
    """
    for axis, angle in ((2, h), (0, problem.c[0] * dW[0]), (1, problem.c[1] * dW[1])):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        y = y.copy()
        y[i], y[j] = np.cos(angle) * y[i] + np.sin(angle) * y[j], np.cos(angle) * y[j] - np.sin(angle) * y[i]
    return y


def louder(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return rotated(problem, y, h, dW * (1 + 2.0**-20))


@pytest.mark.parametrize(("step", "verdict"), [(rotated, Verdict.HOLDS), (louder, Verdict.VIOLATED)])
def test_a_mean_that_decays_is_judged_by_quadrature(step: Any, verdict: Verdict) -> None:
    """E[cos(cΔW)] = e^(−c²h/2) for each of both noises, so rotations have the exact mean;
    noise 2⁻²⁰ larger has not.
    """
    found = asked(sepv.Scheme("rotations", step, systems="hamiltonians"), spin())
    assert found.verdict is verdict, found.message
    assert verdict is Verdict.HOLDS or "E[height(y1)]" in found.message


def test_both_momenta_of_planets_are_stated() -> None:
    assert set(planets().invariants) == {"momentum in x", "momentum in y", "angular momentum"}
    for name in planets().invariants:
        assert relation(planets(), name) == relation(planets(), "angular momentum")
    assert (
        asked("leapfrog", planets(masses=(50.0, 1.0), axes=(1.0,), eccentricities=(0.1,))).verdict
        is Verdict.HOLDS
    )


def root(q: Array) -> Array:
    return np.sqrt(1 + 0.5 * q**2 + 0.25 * q**4)


def auxiliary(structure: Any = None) -> Problem:
    """The extended system of a scalar auxiliary variable r = √V(q): B(y) with the slope g = dr/dq,
    H = ½p² + r².
    """

    def B(y: Array) -> Array:
        zero = 0 * y[0]
        g = (y[0] + y[0] ** 3) / (2 * root(y[0]))
        return np.array([[zero, 1 + zero, zero], [-1 + zero, zero, -g], [zero, g, zero]])

    q = 0.8
    return Problem(
        3, B, lambda y: 0.5 * y[1] ** 2 + y[2] ** 2, initial=(q, 0.3, float(root(np.array(q)))), name="auxiliary",
        invariants={"modified energy": lambda y: 0.5 * y[1] ** 2 + y[2] ** 2} | (structure or {}),
    )  # fmt: skip


def sav(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """The scalar auxiliary variable step, linear in y1: g is taken at y0, and ∇H at the middle."""
    A = 0.5 * problem.random_step(h, dW) * problem.structure(y) @ np.diag([0.0, 1.0, 2.0])
    return np.asarray(np.linalg.solve(np.eye(3) - A, y + A @ y))


def test_the_modified_energy_of_a_scalar_auxiliary_variable_is_kept_and_its_definition_is_not() -> None:
    scheme = sepv.Scheme("sav", sav, batched=False)
    assert asked(scheme, auxiliary()).verdict is Verdict.HOLDS
    strayed = asked(scheme, auxiliary({"r − √V(q)": lambda y: y[2] - root(y[0])}))
    assert strayed.verdict is Verdict.VIOLATED
    assert "r − √V(q)" in strayed.message


def test_impulses_of_vortices_are_kept() -> None:
    strengths = np.array([1.0, 0.5, -0.75])

    def energy(y: Array) -> Array:
        total = 0 * y[0]
        for k, m in ((0, 1), (0, 2), (1, 2)):
            square = (y[2 * k] - y[2 * m]) ** 2 + (y[2 * k + 1] - y[2 * m + 1]) ** 2
            total = total - strengths[k] * strengths[m] / (4 * np.pi) * np.log(square)
        return total

    B = np.kron(np.diag(1 / strengths), [[0.0, 1.0], [-1.0, 0.0]])
    problem = Problem(
        6, B, energy, initial=(0.0, 0.0, 1.0, 0.25, 0.25, 1.0), name="vortices",
        invariants={
            "impulse in x": lambda y: strengths @ y[::2],
            "angular impulse": lambda y: strengths @ (y[::2] ** 2 + y[1::2] ** 2),
        },
    )  # fmt: skip
    assert asked("midpoint", problem).verdict is Verdict.HOLDS
    assert asked("euler-heun", problem).verdict is Verdict.VIOLATED


def test_polynomials_of_a_file_are_stated_and_refused_too(tmp_path: Any) -> None:
    H = poly.polynomial(2, {(2, 0): 0.5, (0, 2): 0.5})
    data = sepv.PolynomialSystem(
        2, H, ((0, 1, poly.constant(2, 1.0)),), invariants=(("twice H", poly.scale(2.0, H)),)
    )
    written = to_json(polynomial_problem(data))
    assert from_json(written) == data
    (tmp_path / "right.json").write_text(json.dumps(written | {"initial": [1.0, 0.5]}))
    assert asked("midpoint", str(tmp_path / "right.json")).verdict is Verdict.HOLDS
    written["invariants"]["twice H"] = [[[1, 0], 1.0]]
    (tmp_path / "wrong.json").write_text(json.dumps(written))
    with pytest.raises(ProblemError, match=r"wrong.json: LI = "):
        sepv.verify("midpoint", laws="invariant", problems=str(tmp_path / "wrong.json"))


def test_without_stated_functions_the_law_says_how_to_state_some() -> None:
    found = sepv.verify("midpoint", laws="invariant").finding("invariant")
    assert found.verdict is Verdict.NOT_APPLICABLE
    assert "invariants={" in found.message
    assert asked("midpoint", in_plane()).verdict is Verdict.NOT_APPLICABLE


def test_single_states_are_asked_for_means_of_few_noises_and_all_noises_come() -> None:
    """With 20 noises and a step of 76 ms the law takes minutes: 64 steps a mean, and not 160."""
    rng = np.random.default_rng(1)
    coefficients = tuple((0.01 * np.arange(1, 21)).tolist())
    momentum = poly.polynomial(4, {(2, 0, 0, 0): 0.5, (0, 2, 0, 0): 0.5})
    H = poly.polynomial(4, {(2, 0, 0, 0): 0.5, (0, 2, 0, 0): 0.5, (0, 0, 2, 0): 0.5, (0, 0, 4, 0): 0.25})
    pushes = tuple((float(a), float(b), 0.0, 0.0) for a, b in rng.normal(size=(20, 2)))
    many = PolynomialSystem(
        4, H, planes(4), coefficients, noise_vectors=pushes, invariants=(("p²/2", momentum),)
    )
    batched = sepv.schemes.by_name("drift-preserving")
    alone = replace(batched, batched=False, solve=None)
    seen = set()
    for y in rng.normal(size=(12, 4)):
        case = Case(many, tuple(y.tolist()), 0.1, (0.0,) * 20)
        fewer = affordable(alone, case)
        assert affordable(batched, case) is case
        assert nodes(alone, fewer.build()[0], 0.1) <= 32
        assert isinstance(fewer.problem, PolynomialSystem)
        seen |= set(fewer.problem.noise)
    assert seen == set(coefficients)

    def step(problem: Problem, y: Array, h: float, *increments: Array) -> Array:
        """A noise too weak by half, which only some of the means have."""
        weak = np.where(problem.c == coefficients[12], 0.5, 1.0)
        rows = increments[0].reshape(-1, problem.noises) * weak
        return np.asarray(batched.step(problem, y, h, rows.reshape(increments[0].shape), *increments[1:]))

    found = sepv.verify(
        replace(alone, step=step),
        laws="invariant:energy",
        problems=many,
        effort=replace(FEW, shrink_checks=5),
    )
    assert found.finding("invariant:energy").verdict is Verdict.VIOLATED
