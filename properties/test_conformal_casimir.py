"""With damping −γy dt, quadratic Casimirs yᵀAy decay as e^{−2γt} along each path, linear Casimirs bᵀy as e^{−γt}."""

from __future__ import annotations

from sepv.properties._decay import damped, factor, residual
from sepv.reference.problem import exact_problem

from sepv.problem import Systems
from sepv.schemes import Scheme, ask
from sepv.verification import Case, Cases, Effort, Measurement, casimir_bound, require, searched
from sepv.verification._tolerance import casimir_ulp


def with_casimirs(case: Case) -> Case | None:
    """Keep a case if its system is damped and has a quadratic or linear Casimir."""
    problem, *_ = case.build()
    return damped(case) if len(problem.casimirs) + len(problem.linear_casimirs) else None


def check(scheme: Scheme, case: Case) -> Measurement:
    """Measure the largest C(y1) − e^{−pγh}C(y0) for C of degree p, with the bound of `sepv.properties._decay`."""
    problem, y, h, dW = case.build()
    y1 = ask(scheme, problem, y, h, dW)
    exact = exact_problem(case.problem, 40)
    r = residual(scheme, problem, y, y1, h, dW)
    before, after = exact.casimir_values(exact.state(y)), exact.casimir_values(exact.state(y1))
    measurements = []
    for A, c0, c1 in zip((*problem.casimirs, *problem.linear_casimirs), before, after, strict=True):
        unit = casimir_ulp(A, y, y1)
        expected = factor(exact, problem, h, A.ndim) * c0
        form = "yᵀAy" if A.ndim == 2 else "bᵀy"
        detail = (
            f"C = {form}: C(y1) = {float(c1)!r}, expected e^(−{A.ndim}γh)C(y0) = {float(expected)!r}, "
            f"C(y0) = {float(c0)!r}, y1 = {y1.tolist()}"
        )
        measurements.append(
            Measurement(abs(float(c1 - expected)) / unit, casimir_bound(A, y, y1, r) / unit, detail)
        )
    return max(measurements, key=lambda m: m.ratio)


law = searched(
    name="conformal-casimir",
    statement="with damping −γy quadratic Casimirs decay by the factor e^(−2γh), linear ones by e^(−γh)",
    source="arXiv 2503.01540",
    unit="ulp of C",
    preserves=True,
    cost=0.3,
    steps=60,
    cases=Cases(
        where={"Casimirs": ("linear", "quadratic", "two")},
        adapt=with_casimirs,
        why="the problems have no damping, or name no Casimir, as data",
        not_of={s: "the systems have no damping" for s in Systems if s is not Systems.DAMPED},
        damped=True,
    ),
    check=check,
)


def test_conformal_casimir(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
