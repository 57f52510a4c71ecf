"""A problem posed in another library's arrays is the same field."""

from __future__ import annotations

import numpy as np
import pytest

import sepv
from sepv.adapters.posing import field_in
from sepv.candidate import ask
from sepv.fields import vector_field


@pytest.mark.parametrize("name", ["rigid-body", "pendulum", "lotka-volterra", "harmonic-oscillator"])
def test_the_field_of_a_named_problem_is_posed_in_a_namespace(name: str) -> None:
    problem = sepv.problems.by_name(name)
    y = np.asarray(problem.initial, dtype=np.float64)
    np.testing.assert_allclose(field_in(np, name)(y), vector_field(problem, y), rtol=1e-14, atol=1e-15)


def test_a_jitted_step_is_verified() -> None:
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    f = field_in(jax.numpy, "rigid-body")
    step = jax.jit(lambda y, delta: y + delta * f(y + 0.5 * delta * f(y)))

    def scheme(problem: sepv.Problem, y: np.ndarray, h: float, dW: np.ndarray) -> np.ndarray:
        return np.array(step(y, problem.random_step(h, dW)))

    found = sepv.verify(scheme, laws="contract", problems="rigid-body", effort=sepv.Effort(examples=5))
    assert found.findings[0].verdict is sepv.Verdict.HOLDS


def test_single_precision_is_refused_with_the_switch_that_helps() -> None:
    single = sepv.Scheme("single", lambda p, y, h, dW: y.astype(np.float32))
    problem = sepv.problems.pendulum()
    with pytest.raises(sepv.SchemeFault, match="jax_enable_x64"):
        ask(single, problem, np.array([0.2, 1.0]), 0.1, np.zeros(2))
