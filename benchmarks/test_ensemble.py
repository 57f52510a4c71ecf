"""The cost of ensembles and of a long path in both engines, with counters,
strong error and invariant defects.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import sepv
from sepv import problems, schemes
from sepv.problem import Problem
from sepv.simulate import wiener

ENSEMBLE_GRIDS = {"rigid-body": (1.0, 32), "pendulum": (1.0, 32), "lotka-volterra": (0.25, 64)}


def engines() -> list[str]:
    """The engines to measure: NumPy's, and the compiled engine if the extra `fast` is installed."""
    from importlib.util import find_spec

    return ["numpy", "compiled"] if find_spec("numba") else ["numpy"]


def tell(benchmark: Any, ends: Any, problem: Problem, T: float) -> None:
    """Store counters, strong error and invariant defects in the record of a benchmark."""
    assert not ends.status.any()
    exact = sepv.exact_flow(problem, T + problem.c @ ends.W)
    benchmark.extra_info["iterations"] = ends.iterations
    benchmark.extra_info["gradient evaluations"] = ends.gradient_evaluations
    benchmark.extra_info["structure evaluations"] = ends.structure_evaluations
    benchmark.extra_info["strong error"] = float(np.sqrt(np.mean(np.sum((ends.y - exact.y) ** 2, axis=0))))
    benchmark.extra_info["largest energy defect"] = float(ends.energy_defect.max())
    benchmark.extra_info["largest Casimir defect"] = float(ends.casimir_defect.max())
    assert ends.energy_defect.max() < 1e-12


@pytest.mark.parametrize("engine", engines())
@pytest.mark.parametrize("drawn", [True, False], ids=["increments drawn", "increments given"])
@pytest.mark.parametrize("name", ENSEMBLE_GRIDS)
def test_ensemble(benchmark: Any, name: str, drawn: bool, engine: str) -> None:
    problem, (T, steps) = problems.by_name(name), ENSEMBLE_GRIDS[name]
    paths = 256
    more: dict[str, Any] = {"paths": paths}
    if not drawn:
        more = {"dW": wiener.increments(0, T=T, steps=steps, noises=problem.noises, paths=paths)}

    def run() -> Any:
        return sepv.ensemble(schemes.energy_preserving, problem, h=T / steps, T=T, engine=engine, **more)

    tell(benchmark, benchmark(run), problem, T)


@pytest.mark.parametrize("engine", engines())
def test_one_long_path(benchmark: Any, engine: str) -> None:
    problem, h, steps = problems.rigid_body(), 0.01, 500

    def run() -> Any:
        return sepv.ensemble(schemes.energy_preserving, problem, h=h, steps=steps, paths=1, engine=engine)

    tell(benchmark, benchmark(run), problem, h * steps)
