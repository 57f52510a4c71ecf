"""The cost of verification itself: laws with a small effort,
and one step of the reference in 50 digits.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from sepv.reference.steps import reference_step

import sepv
from sepv import problems, schemes
from sepv.law import Effort, Verdict
from sepv.problem import NamedProblem


@pytest.mark.parametrize("law", ["energy", "symmetry", "reference"])
def test_a_law(benchmark: Any, law: str) -> None:
    effort = Effort(examples=10)
    report = benchmark(sepv.verify, schemes.energy_preserving, laws=[law], effort=effort)
    finding = report.finding(law)
    assert finding.verdict is Verdict.HOLDS
    benchmark.extra_info["checks"] = finding.checks
    benchmark.extra_info["largest defect"] = finding.defect
    benchmark.extra_info["bound"] = finding.bound


@pytest.mark.parametrize("name", ["rigid-body", "pendulum", "lotka-volterra"])
def test_a_reference_step(benchmark: Any, name: str) -> None:
    problem = problems.by_name(name)
    y, h = np.asarray(problem.initial, dtype=np.float64), 0.01
    dW = [0.05] * problem.noises
    assert isinstance(problem.data, NamedProblem)
    found = benchmark(reference_step, "energy-preserving", problem.data, y.tolist(), h, dW)
    ours = schemes.energy_preserving.step(problem, y, h, np.array(dW))
    error = max(abs(float(a) - b) for a, b in zip(found.y1, ours, strict=True))
    benchmark.extra_info["error of the binary64 step"] = error
    assert error < 1e-14
