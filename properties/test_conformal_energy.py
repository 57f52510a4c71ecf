"""With damping −γy dt, a Hamiltonian H that is homogeneous of degree p decays as e^{−pγt} along each path."""

from __future__ import annotations

from sepv.properties._decay import damped, factor, residual
from sepv.reference.problem import exact_problem

from sepv.errors import Skipped
from sepv.problem import PolynomialSystem, Systems
from sepv.schemes import Scheme, ask
from sepv.verification import Case, Cases, Effort, Measurement, energy_bound, energy_ulp, require, searched


def degree_of(case: Case) -> int:
    """Return the degree of H if H is a homogeneous polynomial, else 0."""
    if not isinstance(case.problem, PolynomialSystem):
        return 0
    degrees = {sum(e) for e, _ in case.problem.hamiltonian.terms}
    return degrees.pop() if len(degrees) == 1 else 0


def homogeneous(case: Case) -> Case | None:
    """Keep a case if its system is damped and its H is homogeneous."""
    return damped(case) if degree_of(case) else None


def check(scheme: Scheme, case: Case) -> Measurement:
    """Measure H(y1) − e^{−pγh}H(y0) for H of degree p, with the bound of `sepv.properties._decay`."""
    problem, y, h, dW = case.build()
    p = degree_of(case)
    if not p:
        raise Skipped("H is not homogeneous")
    y1 = ask(scheme, problem, y, h, dW)
    exact = exact_problem(case.problem, 40)
    r = residual(scheme, problem, y, y1, h, dW)
    before, after = (exact.hamiltonian(exact.state(v)) for v in (y, y1))
    expected = factor(exact, problem, h, p) * before
    unit = float(energy_ulp(problem, y, y1))
    detail = (
        f"H(y1) = {float(after)!r}, expected e^(−{p}γh)H(y0) = {float(expected)!r}, H(y0) = {float(before)!r}, "
        f"y1 = {y1.tolist()}"
    )
    bound = float(energy_bound(problem, y, y1, r))
    return Measurement(abs(float(after - expected)) / unit, bound / unit, detail)


law = searched(
    name="conformal-energy",
    statement="with damping −γy a homogeneous H of degree p decays by the factor e^(−pγh)",
    source="arXiv 2503.01540",
    unit="ulp of H",
    preserves=True,
    cost=0.3,
    steps=60,
    cases=Cases(
        blind={"degree of H": ("1–2",)},
        adapt=homogeneous,
        why="the problems have no damping, or no homogeneous H, as data",
        not_of={s: "the systems have no damping" for s in Systems if s is not Systems.DAMPED},
        damped=True,
    ),
    check=check,
)


def test_conformal_energy(scheme: Scheme, effort: Effort) -> None:
    require(law, scheme, effort)
