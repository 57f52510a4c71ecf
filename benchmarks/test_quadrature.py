"""The cost of the averaged gradient by closed form, Gauss rule and adaptive rule,
with evaluations and errors.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sepv import problems
from sepv.problem import average_gradient
from sepv.record import gauss_legendre
from sepv.studies import bench_cases

QUARTIC = replace(problems.build(bench_cases.quartic_body()), initial=(0.8, 0.6, 0.1), check=False)
QUADRATURE_PROBLEMS = {
    "closed form": problems.pendulum(),
    "closed form, logarithms": problems.lotka_volterra(),
    "Gauss, two nodes": QUARTIC,
    "adaptive": replace(problems.pendulum(), mean_gradient=None, check=False),
    "adaptive, logarithms": replace(problems.lotka_volterra(), mean_gradient=None, check=False),
}


@pytest.mark.parametrize("way", QUADRATURE_PROBLEMS)
def test_average(benchmark: Any, way: str) -> None:
    problem = QUADRATURE_PROBLEMS[way]
    y0 = np.repeat(np.asarray(problem.initial, dtype=np.float64)[:, None], 1024, axis=1)
    y1 = y0 * (1 + np.random.default_rng(0).uniform(-0.25, 0.25, y0.shape))
    mean = benchmark(average_gradient, problem, y0, y1)
    assert np.all(mean.reliable)
    points, weights = gauss_legendre(64)
    fine = sum(w * problem.gradient(y0 + t * (y1 - y0)) for t, w in zip(points, weights, strict=True))
    error = float(np.max(np.abs(mean.value - fine)) / np.max(np.abs(fine)))
    benchmark.extra_info["gradient evaluations"] = int(np.sum(mean.evaluations))
    benchmark.extra_info["largest relative error"] = error
    assert error < 1e-14
