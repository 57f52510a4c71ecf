"""The cost of the exact flow at 5000 random times, with the error that it states."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sepv import problems
from sepv.exact import exact_flow


@pytest.mark.parametrize("name", problems.PAPER)
@pytest.mark.parametrize("dense", [False, True], ids=["closed form", "dense"])
def test_exact_flow(benchmark: Any, name: str, dense: bool) -> None:
    problem, theta = problems.by_name(name), np.linspace(-5, 8, 5000)
    flow = benchmark(exact_flow, problem, theta, dense=dense)
    benchmark.extra_info["stated error"] = flow.error
    assert flow.error < 1e-12
