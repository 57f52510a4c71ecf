"""The cost of one step, for one state and for a batch,
with numbers of evaluations and energy defects.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sepv import problems, schemes
from sepv.schemes import Scheme

TIMED_H = 0.01


@pytest.mark.parametrize("paths", [1, 1024])
@pytest.mark.parametrize("name", problems.PAPER)
@pytest.mark.parametrize("scheme", schemes.PAPER.values(), ids=lambda s: s.name)
def test_step(benchmark: Any, scheme: Scheme, name: str, paths: int) -> None:
    problem = problems.by_name(name)
    rng = np.random.default_rng(0)
    y = np.repeat(np.asarray(problem.initial)[:, None], paths, axis=1)
    dW = np.sqrt(TIMED_H) * rng.standard_normal((problem.noises, paths))
    y1 = benchmark(scheme.step, problem, y, TIMED_H, dW)
    defect = np.abs(problem.hamiltonian(y1) - problem.hamiltonian(y))
    benchmark.extra_info["largest energy defect"] = float(defect.max())
    if scheme.solve is not None:
        solution = scheme.solve(problem, y, TIMED_H, dW)
        assert not solution.status.any()
        benchmark.extra_info["iterations"] = int(solution.iterations.sum())
        benchmark.extra_info["gradient evaluations"] = int(solution.gradient_evaluations.sum())
        benchmark.extra_info["structure evaluations"] = int(solution.structure_evaluations.sum())
