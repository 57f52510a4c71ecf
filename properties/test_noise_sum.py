"""§1 and (2.1): m noises act only through Σ c_j ΔW_j, so their order is irrelevant and one noise
can replace them.
"""

from __future__ import annotations

import numpy as np

from sepv.errors import Skipped
from sepv.law import (
    Case,
    Cases,
    Effort,
    Measurement,
    Middle,
    amplification,
    require,
    searched,
    state_ulp,
    step_residual,
)
from sepv.law.cases.case import with_noise, with_order
from sepv.law.cases.fixed_cases import many
from sepv.problem import (
    GivenProblem,
    NamedProblem,
    Systems,
    one_field,
    one_hamiltonian,
)
from sepv.record import Polynomial
from sepv.schemes import Scheme, ask

# A noise: its coefficient c_j, its structure G_j or Hamiltonian H_j, and its increment ΔW_j.
Noise = tuple[float, tuple[tuple[int, int, Polynomial], ...] | Polynomial, float]


def several_noises(case: Case) -> Case | None:
    """Split a single noise into two with the same Σ c_jΔW_j.
    A case without noise gets two noises with the sum h.
    """
    problem = case.build()[0]
    c = tuple(float(v) for v in problem.c)
    if len(c) > 1 or not one_field(problem):
        return case if len(c) > 1 else None
    first = c[0] if c and c[0] else 1.0
    share = case.dW[0] if case.dW and c[0] else case.h
    return with_noise(case, (first, first / 2), (share / 2, share))


def check(scheme: Scheme, case: Case) -> Measurement:
    """Compare the steps with all noises, with the noises reversed, and with their sum as one noise.

    Noises with structures or Hamiltonians of their own cannot be summed. Instead one step has them
    moved on by one place, and one has a noise with c = 0 before them. If a scheme exchanges two
    noises, both permutations may hide it, but the additional noise reveals it. All steps solve one
    equation y1 = y0 + R(y0, y1). Their residuals, with the rounding of Δ, are at most r. So two
    steps differ by at most 2r‖(I − ∂R/∂y1)⁻¹‖ in the largest component.
    """
    problem, _, _, dW = case.build()
    data, c = case.problem, tuple(float(v) for v in problem.c)
    if not one_field(problem):
        given = isinstance(data, GivenProblem)
        if isinstance(data, NamedProblem) or (given and one_hamiltonian(problem)):
            raise Skipped("its noises cannot be reversed: the problem is not data")
        m = len(c)
        orders = {"reversed": [*range(m)][::-1], "moved on by one": [m - 1, *range(m - 1)]}
        others = {name: with_order(case, order) for name, order in orders.items()}
        if not given:
            more = with_order(case, [0, *range(m)])
            others["after one of c = 0"] = with_noise(more, (0.0, *c), more.dW)
        return _furthest(scheme, case, others)
    total = float(sum(c * w for c, w in zip(problem.c, dW, strict=True)))
    # With this coefficient the increment is at most the largest one. It is a power of two: the
    # product is exact.
    one = 2.0 ** np.ceil(np.log2(np.sum(np.abs(problem.c)))) if np.any(problem.c) else 1.0
    others = {
        "reversed": with_noise(case, c[::-1], case.dW[::-1]),
        "as one": with_noise(case, (float(one),), (total / one,)),
    }
    return _furthest(scheme, case, others)


def _furthest(scheme: Scheme, case: Case, others: dict[str, Case]) -> Measurement:
    """Measure the largest distance of the steps of the cases `others` from the step of `case`."""
    problem, y, h, dW = case.build()
    y1 = ask(scheme, problem, y, h, dW)
    residual = float(step_residual(problem, y, y1, h, dW, scheme).max())
    allowed = 2 * residual * amplification(scheme, case)
    unit, worst = state_ulp(y, y1), Measurement(0.0, 0.0)
    for name, other in others.items():
        answer = ask(scheme, *other.build())
        distance = float(np.max(np.abs(answer - y1)))
        detail = f"y1 = {y1.tolist()}, with the noises {name}: {answer.tolist()}"
        measurement = Measurement(distance / unit, allowed / unit, detail)
        worst = max(worst, measurement, key=lambda m: (m.ratio, m.bound))
    return worst


law = searched(
    name="noise-sum",
    statement="several noises act only through Σ c_j ΔW_j, and their order does not matter",
    source="§1, (2.1)",
    unit="ulp of y",
    cost=0.8,
    steps=171,
    middle=Middle.MAP,
    cases=Cases(
        where={"m": ("2", "3–4", "5–20")},
        adapt=several_noises,
        why="the problems have one structure for each noise",
        fixed={Systems.SINGLE: many},
    ),
    check=check,
)


def test_noise_sum(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
