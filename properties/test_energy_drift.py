"""Trace formula: E[H_0(y1)] = H_0(y0) + hσ if LH_0 = ½ Σ_j c_j² {{H_0, H_j}, H_j} is a constant σ.

L is the generator of dy = B∇H_0 dt + Σ c_j f_j∘dW_j with f_j = B∇H_j or vectors f_j. If LH_0 = σ everywhere, then
d/dt E[H_0] = σ at all times. An example is additive noise along which H_0 is quadratic: σ = ½ Σ c_j² f_jᵀH_0″f_j
(D. Cohen and G. Vilmart, Int. J. Comput. Math. 99, 2022). The expectation is computed by quadrature over increments.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from sepv.properties._trace_formula import Quantity, measured, nodes, short

from sepv import problems
from sepv.errors import Skipped
from sepv.problem import Array, GivenProblem, HamiltoniansProblem, PolynomialSystem, Problem, Systems
from sepv.problems import bracket, planes
from sepv.record import Polynomial, PolynomialMap, poly
from sepv.schemes import Scheme
from sepv.verification import Case, Cases, Effort, Measurement, energy_bound, energy_ulp, require, searched


def steady(case: Case) -> Case | None:
    """Keep a case if E[H_0] of its system changes at a constant rate, with a step as long as `short` allows."""
    data = case.problem
    if isinstance(data, GivenProblem) and isinstance(data.problem.data, PolynomialSystem):
        data = data.problem.data
    if not isinstance(data, PolynomialSystem) or not isinstance(problems.build(data), HamiltoniansProblem):
        return None
    return None if drift_of_energy(data) is None else short(replace(case, problem=data))


def drift_of_energy(data: PolynomialSystem) -> float | None:
    """The constant rate at which the mean of H_0 changes; None if the rate depends on y.

    The rate is LH_0 with the generator L: ½ Σ_j c_j² {{H_0, H_j}, H_j}, or ½ Σ_j c_j² g_jᵀH_0″g_j for vectors g_j.
    """
    noises: list[Callable[[Polynomial], Polynomial]]
    noises = [lambda p, H=H: bracket(data, p, H)[0] for H in data.noise_hamiltonians]  # type: ignore[misc]
    noises += [lambda p, g=g: _along(p, g) for g in data.noise_vectors]  # type: ignore[misc]
    parts = [poly.scale(0.5 * c * c, f(f(data.hamiltonian))) for c, f in zip(data.noise, noises, strict=True)]
    total = poly.add(poly.polynomial(data.dimension, {}), *parts)
    return None if total.degree else sum((c for _, c in total.terms), 0.0)


def _along(p: Polynomial, g: Sequence[float]) -> Polynomial:
    """The derivative ∇pᵀg of a polynomial p along a vector g."""
    parts = [poly.scale(v, slope) for v, slope in zip(g, poly.gradient(p), strict=True)]
    return poly.add(poly.polynomial(p.dimension, {}), *parts)


def check(scheme: Scheme, case: Case) -> Measurement:
    """Measure |E[H_0(y1)] − H_0(y0) − hσ| with the rate σ of `drift_of_energy`, by `sepv.properties._trace_formula`."""
    problem, y, h, _ = case.build()
    if (
        not isinstance(case.problem, PolynomialSystem)
        or not isinstance(problem, HamiltoniansProblem)
        or h <= 0
    ):
        raise Skipped("the law needs several Hamiltonians as data, and h > 0")
    rate = drift_of_energy(case.problem)
    if rate is None:
        raise Skipped("LH_0 is not constant")
    if not scheme.batched:
        problem, rate = affordable(scheme, case.problem, problem, rate, h)
    return measured(scheme, problem, y, h, quantity(problem, rate, y))


def affordable(
    scheme: Scheme, data: PolynomialSystem, problem: Problem, rate: float, h: float
) -> tuple[Problem, float]:
    """Leave out the last noises until the rule has at most MOST_NODES nodes, and return problem and rate.

    A scheme that takes one state a call makes a step for each node. With Lévy areas of 20 noises these are 33,600.
    """
    for count in range(problem.noises, 0, -1):
        fewer = replace(
            data, noise=data.noise[:count], noise_hamiltonians=data.noise_hamiltonians[:count],
            noise_vectors=data.noise_vectors[:count],
        )  # fmt: skip
        built, own = problems.build(fewer), drift_of_energy(fewer)
        if not isinstance(built, HamiltoniansProblem) or own is None:
            continue
        problem, rate = built, own
        if nodes(scheme, problem, h) <= MOST_NODES:
            break
    return problem, rate


def quantity(problem: Problem, rate: float, y: Array) -> Quantity:
    """Return H_0, with its rate σ and the unit of its defects at y, as the quantity of the trace formula."""
    H = problem.hamiltonian
    assert isinstance(H, PolynomialMap)
    return Quantity(
        "H", H, H.majorant, partial(energy_bound, problem), rate, float(energy_ulp(problem, y, y))
    )


def by_degree() -> tuple[Case, ...]:
    """Long steps for H = ½p² + aq^n, y = (p, q), with additive noise on p. Random cases seldom have such long steps.

    The noise is weak, because a strong noise would shorten the step.
    """
    found = []
    for degree in (3, 4, 5, 6, 8, 10):
        a = 2.0 ** -round(math.log2(degree * (degree - 1)))
        H = poly.polynomial(2, {(2, 0): 0.5, (0, degree): a})
        system = PolynomialSystem(2, H, planes(2), (2.0**-5,), noise_vectors=((1.0, 0.0),))
        found.append(Case(system, (1.0, 0.75), 0.25, (0.0,)))
    return tuple(found)


# The most nodes of a rule for a scheme that takes one state a call: 76 s for steps of 76 ms.
MOST_NODES = 1000
_KEPT = "the exact flow keeps H: see the law energy"
law = searched(
    name="energy-drift",
    statement="E[H(y1)] = H(y0) + hσ if the exact E[H] grows at a constant rate σ",
    source="trace formula",
    unit="ulp of H",
    preserves=True,
    steps=5000,
    cases=Cases(
        adapt=steady,
        why="the generator makes no constant of H_0, or the problems are not given as data",
        not_of=dict.fromkeys((Systems.SINGLE, Systems.NAMBU, Systems.SEVERAL), _KEPT),
        instead={Systems.HAMILTONIANS: Systems.SEPARABLE_HAMILTONIANS},
        fixed={Systems.ADDITIVE: by_degree},
    ),
    check=check,
)


def test_energy_drift(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
