"""The cost of the implicit solve: small and large steps, few and many components,
with iterations and residual.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sepv import problems, schemes
from sepv.problem import PolynomialSystem, Problem
from sepv.record import Polynomial, poly


def chain(n: int) -> Problem:
    """A chain of n oscillators coupled by quartic springs, d = 2n, y = (q₁ … q_n, p₁ … p_n)."""
    d = 2 * n
    unit = [poly.variable(d, k) for k in range(d)]
    squares = [poly.multiply(u, u) for u in unit]
    stretches = [poly.add(unit[k], poly.scale(-1.0, unit[k + 1])) for k in range(n - 1)]
    quartics = [poly.multiply(poly.multiply(s, s), poly.multiply(s, s)) for s in stretches]
    H = poly.add(*(poly.scale(0.5, s) for s in squares), *(poly.scale(0.25, q) for q in quartics))
    one = Polynomial(d, (((0,) * d, 1.0),))
    return problems.polynomial_problem(PolynomialSystem(d, H, tuple((k, k + n, one) for k in range(n))))


@pytest.mark.parametrize("delta", [2.0**-7, 2.0**-3], ids=["small step", "large step"])
@pytest.mark.parametrize("n", [1, 2, 4], ids=lambda n: f"d = {2 * n}")
def test_solve(benchmark: Any, n: int, delta: float) -> None:
    problem, paths = chain(n), 256
    y = np.random.default_rng(0).uniform(-1, 1, (2 * n, paths))
    dW = np.zeros((1, paths))
    assert schemes.energy_preserving.solve is not None
    solution = benchmark(schemes.energy_preserving.solve, problem, y, delta, dW)
    assert not solution.status.any()
    benchmark.extra_info["iterations"] = int(solution.iterations.sum())
    benchmark.extra_info["gradient evaluations"] = int(solution.gradient_evaluations.sum())
    benchmark.extra_info["largest residual"] = float(solution.residual.max())
    defect = np.abs(problem.hamiltonian(solution.value) - problem.hamiltonian(y))
    benchmark.extra_info["largest energy defect"] = float(defect.max())
    # The bound allows eight terms of H with a few rounded operations in each.
    assert defect.max() < 64 * np.finfo(np.float64).eps * problem.hamiltonian(np.abs(y)).max()
