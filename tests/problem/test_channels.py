"""The record of channels: the fields of a system, and the facts that laws and schemes ask for."""

import ast
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import sepv
from sepv.problem import (
    DampedProblem,
    HamiltoniansProblem,
    Problem,
    column,
    combined_field,
    damping_matrix,
    damping_of,
    drift,
    each_noise,
    hamiltonians_of,
    matvec,
    noise_field,
    noise_vectors,
    one_field,
    one_hamiltonian,
    one_structure,
    structures_of,
    uniform_damping,
)
from sepv.problem._channels import field, slope

ROOT = Path(sepv.__file__).parents[1]
CLASSES = {"HamiltoniansProblem", "StructuresProblem", "DampedProblem"}
# Tests of a problem's class that are left outside `sepv.problem`, each with its reason.
LEFT = {"sepv/problems/_several.py": 1}  # the type of what polynomial data with structures build
TRAP = sepv.problems.harmonic_trap((1.0,))

SYSTEMS = {
    "(1.1)": sepv.problems.rigid_body(),
    "without noise": HamiltoniansProblem(2, TRAP.structure, TRAP.hamiltonian, noise=(), initial=(0.5, -0.25)),
    "structures": sepv.problems.by_name("noncommuting-tops"),
    "damped spin": sepv.problems.damped_spin(),
    "commuting": sepv.problems.by_name("kubo-oscillator"),
    "hamiltonians": sepv.problems.by_name("two-spins"),
    "vectors": sepv.problems.by_name("pushed-rigid-body"),
    "damped": sepv.problems.damped_top(),
    "friction": sepv.problem.friction(TRAP, 0.5, 2.0),
}  # fmt: skip


def state(problem: Problem) -> np.ndarray:
    return np.asarray(problem.initial if problem.initial is not None else (0.5, -0.25), dtype=np.float64)


@pytest.mark.parametrize(
    ("name", "facts"),
    [
        # one field, one H, one B, the numbers of structures and of Hamiltonians, γ of −γy
        ("(1.1)", (True, True, True, 1, 1, 0.0)),
        ("without noise", (True, True, True, 1, 1, 0.0)),
        ("structures", (False, True, False, 3, 1, None)),
        ("damped spin", (False, True, False, 4, 1, None)),
        ("commuting", (False, True, True, 2, 1, None)),
        ("hamiltonians", (False, False, True, 1, 3, None)),
        ("vectors", (False, False, False, 1, 1, None)),
        ("damped", (False, True, True, 1, 1, 0.5)),
        ("friction", (False, False, False, 1, 1, None)),
    ],
)
def test_facts_follow_from_the_channels(name: str, facts: tuple[object, ...]) -> None:
    problem = SYSTEMS[name]
    counts = len(structures_of(problem)), len(hamiltonians_of(problem))
    asked = one_field(problem), one_hamiltonian(problem), one_structure(problem)
    assert (*asked, *counts, uniform_damping(problem)) == facts
    assert len(problem.channels) == 1 + problem.noises


@pytest.mark.parametrize("name", SYSTEMS)
def test_fields_and_slopes_are_those_of_the_formula_of_a_channel(name: str) -> None:
    problem = SYSTEMS[name]
    y, size = state(problem), 2.0**-20
    for k, F in enumerate(problem.channels):
        value = np.zeros(problem.dimension) if F.vector is None else np.asarray(F.vector, dtype=float)
        if F.gradient is not None:
            value = value + F.structure(y) @ F.gradient(y)
        value = value - (damping_matrix(problem) @ y if F.damping else 0.0)
        np.testing.assert_allclose(field(problem, k, y), value, rtol=1e-15, atol=1e-16)
        ways = size * np.eye(problem.dimension)
        found = [(field(problem, k, y + e) - field(problem, k, y - e)) / (2 * size) for e in ways]
        np.testing.assert_allclose(slope(problem, k, y), np.transpose(found), atol=1e-7)


@pytest.mark.parametrize("name", SYSTEMS)
def test_the_field_of_a_step_is_the_sum_over_the_channels(name: str) -> None:
    problem, rng = SYSTEMS[name], np.random.default_rng(5)
    y = state(problem)[:, None] * np.array([1.0, 0.75])
    parts = each_noise(problem, 0.25, rng.normal(size=(problem.noises, 2)))
    wanted = parts[0] * drift(problem, y)
    for j, part in enumerate(parts[1:]):
        wanted = wanted + part * noise_field(problem, j, y)
    np.testing.assert_allclose(combined_field(problem, y, parts), wanted, rtol=1e-14, atol=1e-15)


def test_damping_of_a_spin_is_a_structure_times_the_gradient_of_half_its_square() -> None:
    """αy × (y × ∇E) = S∇(½|y|²) with S = −hat(αy × ∇E): no further kind of channel."""
    y = np.array([0.48, -0.6, 0.64])
    free, damped = (sepv.problems.damped_spin(damping=a).channels[0] for a in (0.0, 0.5))
    S = damped.structure(y) - free.structure(y)
    slope_of_E = np.array([0.0, -0.25, -0.5 - y[2]])
    assert np.array_equal(S, -S.T)
    assert np.array_equal(damped.gradient(y), y)
    np.testing.assert_allclose(S @ y, 0.5 * np.cross(y, np.cross(y, slope_of_E)), atol=1e-16)
    assert damped.damping == 0.0
    assert damped.vector is None


def test_a_structure_of_a_commuting_hamiltonian_has_its_field_at_critical_points() -> None:
    """S_j is undefined where ∇H_0 = 0, B∇H_j is not: the channel has both forms."""
    problem = sepv.problems.by_name("kubo-oscillator")
    F = problem.channels[1]
    assert F.keeping is not F.structure
    assert F.structure is problem.structure
    y = np.array([0.25, 0.5])
    np.testing.assert_allclose(F.keeping(y) @ problem.gradient(y), field(problem, 1, y), rtol=1e-15)
    assert np.array_equal(field(problem, 1, np.zeros(2)), np.zeros(2))


def test_damping_beside_noise_of_the_same_field_is_uniform_and_beside_vectors_is_not() -> None:
    B, H = TRAP.structure, TRAP.hamiltonian
    damped = DampedProblem(2, B, H, noise=(0.5,), damping=0.375)
    rows = ((0.375, 0.0), (0.0, 0.375))
    pushed = HamiltoniansProblem(2, B, H, noise=(0.5,), noise_vectors=((0.0, 1.0),), damping=rows)
    assert (uniform_damping(damped), uniform_damping(pushed)) == (0.375, None)
    assert damping_of(damped) == damping_of(pushed) == 0.375
    assert np.array_equal(damping_matrix(damped), damping_matrix(pushed))
    assert noise_vectors(damped).shape == (0, 2)
    assert noise_vectors(pushed).tolist() == [[0.0, 1.0]]
    y = np.array([0.5, -0.25])
    assert np.array_equal(drift(damped, y), drift(pushed, y))
    np.testing.assert_allclose(drift(damped, y), matvec(B(y), damped.gradient(y)) - 0.375 * y)
    assert column(pushed) == "additive"


def _of_class(node: ast.AST) -> bool:
    """True for isinstance(x, C), and type(x) is C, of one of the CLASSES or a tuple with one."""
    if isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("isinstance", "issubclass"):
        return bool(CLASSES & {getattr(n, "id", getattr(n, "attr", "")) for n in ast.walk(node.args[1])})
    if isinstance(node, ast.Compare) and isinstance(node.left, ast.Call):
        others = {getattr(n, "id", "") for other in node.comparators for n in ast.walk(other)}
        return getattr(node.left.func, "id", "") == "type" and bool((CLASSES | {"Problem"}) & others)
    return False


def test_no_code_outside_the_problems_asks_for_a_class_of_problems() -> None:
    found = {}
    for room in ("sepv", "properties", "reference", "benchmarks"):
        for path in (ROOT / room).rglob("*.py"):
            name = path.relative_to(ROOT).as_posix()
            if not name.startswith("sepv/problem/"):
                count = sum(map(_of_class, ast.walk(ast.parse(path.read_text()))))
                found |= {name: count} if count else {}
    assert found == LEFT


def test_the_search_for_tests_of_a_class_sees_each_form() -> None:
    for text in ("isinstance(p, DampedProblem)", "isinstance(p, (int, problem.StructuresProblem))",
                 "type(p) is Problem", "issubclass(type(p), HamiltoniansProblem)"):  # fmt: skip
        assert any(map(_of_class, ast.walk(ast.parse(text)))), text
    assert not any(map(_of_class, ast.walk(ast.parse("isinstance(p, Problem) and type(p) is int"))))


def test_a_copy_with_other_noise_has_channels_of_its_own() -> None:
    problem = sepv.problems.rigid_body()
    assert problem.channels is problem.channels
    copy = replace(problem, noise=(0.5, 0.25, 0.125), check=False)
    assert (len(problem.channels), len(copy.channels)) == (1 + problem.noises, 4)
    spins = sepv.problems.two_spins()
    assert len(spins.channels) == 3
    assert one_structure(pickle.loads(pickle.dumps(spins)))
