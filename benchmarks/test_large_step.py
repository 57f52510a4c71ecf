"""The cost of one step of large sparse systems, with iterations and the defect of H; see also `benchmarks.large`."""

from __future__ import annotations

from typing import Any

import pytest

from sepv import large
from sepv.solve import Status

CHAINS = {
    "volterra": lambda: large.volterra_lattice(1001),
    "toda": lambda: large.toda_chain(500),
    "schroedinger": lambda: large.nonlinear_schroedinger(500),
    "spins": lambda: large.spin_chain(333),
}


@pytest.mark.parametrize("name", CHAINS)
def test_large_step(benchmark: Any, name: str) -> None:
    problem = CHAINS[name]()
    solution = benchmark(large.energy_preserving, problem, problem.initial, 0.05)
    assert solution.status is Status.CONVERGED
    defect = abs(problem.energy_difference(solution.value, problem.initial))
    benchmark.extra_info["iterations"] = solution.iterations
    benchmark.extra_info["energy defect"] = defect
    assert defect < 1e-13 * problem.dimension
