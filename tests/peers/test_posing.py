"""A problem posed in another library's arrays is the same system, and compiled steps are verified with it."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from doors import doc
from hypothesis import given, settings
from sepv.reference.peers.posing import field_in, pose

import sepv
from sepv.problem import vector_field
from sepv.schemes import ask
from sepv.schemes._guard import SchemeCrash
from sepv.verification import Case, Verdict
from sepv.verification.strategies import any_steps

NAMES = ["rigid-body", "pendulum", "lotka-volterra", "harmonic-oscillator", "quartic"]
H, B = [[[2, 0, 0], 0.5], [[0, 3, 1], 1.0]], [[0, 1, [[[0, 0, 1], 1.0]]], [1, 2, [[[1, 0, 0], 1.0]]]]
QUARTIC = sepv.problems.build(sepv.problems.from_json({"dimension": 3, "hamiltonian": H, "structure": B}))
ADAPTING = doc("adapting.md")


@given(any_steps())
@settings(max_examples=50)
def test_a_problem_in_another_namespace_is_the_same_problem(case: Case) -> None:
    problem, y, *_ = case.build()
    size = np.abs(problem.structure(y)) @ np.abs(problem.gradient(y)) + np.abs(y).max() + 1
    for padded in (True, False):
        formulas, numbers = pose(problem, padded=padded)
        # Both sum the same few dozen terms, in different orders; cancellation inside B and ∇H is covered by the 1.
        assert np.all(np.abs(formulas.field(np, numbers, y) - vector_field(problem, y)) <= 1e-13 * size)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("lanes", [(), (3,)])
def test_a_named_problem_has_its_parts(name: str, lanes: tuple[int, ...]) -> None:
    problem = QUARTIC if name == "quartic" else sepv.problems.by_name(name)
    start = np.array([0.5, 0.25, 2.0] if problem is QUARTIC else problem.initial)
    y = start if not lanes else start[:, None] * np.array([1.0, 1.1, 0.7])
    formulas, numbers = pose(problem)
    close = {"rtol": 1e-14, "atol": 1e-15}
    for part in ("structure", "gradient", "hamiltonian"):
        posed = getattr(formulas, part)(np, numbers, y)
        np.testing.assert_allclose(posed, getattr(problem, part)(y), **close)
    if problem is not QUARTIC:
        np.testing.assert_allclose(field_in(np, name)(y), vector_field(problem, y), **close)


def test_powers_that_no_monomial_has_do_not_overflow() -> None:
    data = sepv.problems.from_json(
        {"dimension": 2, "hamiltonian": [[[2, 0], 0.5], [[0, 3], 1.0]], "structure": []}
    )
    single = sepv.problems.build(data)
    y = np.float32(np.array([1e15, 1e10]))
    with np.errstate(over="raise"):
        formulas, numbers = pose(single)
        assert formulas.powers > 3, "filled up"
        np.testing.assert_allclose(formulas.gradient(np, numbers, y), [1e15, 3e20], rtol=1e-6)


def test_what_is_not_given_as_data_is_asked_as_data_instead() -> None:
    """A step that needs data skips systems shown as functions: the law then shows the same system as data."""

    def step(problem: sepv.Problem, y: np.ndarray, h: float, dW: np.ndarray) -> np.ndarray:
        formulas, numbers = pose(problem)
        return np.asarray(y + problem.random_step(h, dW) * formulas.field(np, numbers, y))

    effort = sepv.Effort(examples=5, shrink_checks=30)
    contract, energy = sepv.verify(step, laws=["contract", "energy"], effort=effort).findings
    assert contract.verdict is Verdict.HOLDS
    assert contract.skipped == 0
    assert energy.verdict is Verdict.VIOLATED


def test_single_precision_is_refused_with_the_switch_that_helps() -> None:
    single = sepv.Scheme("single", lambda p, y, h, dW: y.astype(np.float32))
    problem = sepv.problems.pendulum()
    with pytest.raises(sepv.SchemeFault, match="jax_enable_x64"):
        ask(single, problem, np.array([0.2, 1.0]), 0.1, np.zeros(2))


def test_numpys_functions_under_a_tracer_end_with_the_way_to_pose_them() -> None:
    class TracerArrayConversionError(TypeError):
        pass

    def step(problem: sepv.Problem, y: np.ndarray, h: float, dW: np.ndarray) -> np.ndarray:
        raise TracerArrayConversionError("called on traced array\nSee https://…")

    with pytest.raises(SchemeCrash, match=r"sepv.reference.peers.posing.pose") as caught:
        ask(sepv.Scheme("traced", step), sepv.problems.pendulum(), np.array([0.2, 1.0]), 0.1, np.zeros(2))
    assert "https" not in str(caught.value)


def program(library: str) -> str:
    """The scheme of docs/adapting.md for this library."""
    if importlib.util.find_spec(library) is None:
        pytest.skip(f"{library} is not installed: the extra `peers`")
    return re.search(rf"^# mine_{library}\.py\n.*?(?=^```$)", ADAPTING, re.MULTILINE | re.DOTALL)[0]


def verified(folder: Path, module: str, laws: str) -> subprocess.CompletedProcess[str]:
    words = ["--examples", "5", "--claim", laws, *(w for law in laws.split(",") for w in ("--law", law))]
    return subprocess.run(
        [sys.executable, "-m", "sepv", "verify", f"{module}:step", *words],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("library", "double", "single", "words", "laws"),
    [
        ("jax", 'jax.config.update("jax_enable_x64", True)', "", "jax_enable_x64", "contract,casimir,symmetry"),
        ("torch", "torch.as_tensor(y)", "torch.as_tensor(y).float()", "torch", "contract,noise-sum,expansion"),
    ],
)  # fmt: skip
def test_a_step_of_another_library_goes_from_refused_to_green(library, double, single, words, laws, tmp_path):
    body = program(library)
    (tmp_path / "single.py").write_text(body.replace(double, single))
    (tmp_path / f"mine_{library}.py").write_text(body)
    refused = verified(tmp_path, "single", "contract")
    assert refused.returncode == 1
    assert words in refused.stdout
    green = verified(tmp_path, f"mine_{library}", laws)
    assert green.returncode == 0, green.stdout
    assert "All 3 claimed laws hold" in green.stdout
