"""Both invariants in dimension three, and systems given by g and C."""

import numpy as np
from drawn import steps
from hypothesis import given
from sepv.reference.equations_by_class import BOTH_INVARIANTS
from sepv.reference.steps import reference_step

import sepv
from sepv import problems, schemes
from sepv.problem import Systems
from sepv.verification import Case, state_ulp

# States of size one: these are about formulas, and not about the ends of binary64.
ONE = {"|y|": ("1",)}


@given(steps(Systems.NAMBU, **ONE))
def test_structure_is_what_the_factor_and_the_casimir_say(case: Case) -> None:
    problem, y, _, _ = case.build()
    v, nambu = np.array([0.3, -1.1, 0.7]), problem.nambu
    assert nambu is not None
    expected = nambu.factor(y) * np.cross(v, nambu.gradient(y))
    size = 1 + np.abs(expected).max()
    assert np.allclose(problem.structure(y) @ v, expected, rtol=1e-13, atol=1e-13 * size)
    for k in range(3):  # C″ against the complex step
        z = y.astype(complex)
        z[k] += 1e-30j
        assert np.allclose(nambu.hessian(y)[:, k], nambu.gradient(z).imag / 1e-30, rtol=1e-12, atol=1e-12)
        assert np.allclose(nambu.gradient(y)[k], nambu.casimir(z).imag / 1e-30, rtol=1e-12, atol=1e-12)


@given(steps(Systems.NAMBU, degree_of_C=("2",), **ONE))
def test_for_a_quadratic_casimir_it_is_the_energy_preserving_scheme(case: Case) -> None:
    """To 40 digits as an equation, to two ulps as a step."""
    args = (case.problem, case.y, case.h, case.dW)
    both, plain = (
        reference_step(BOTH_INVARIANTS, *args, 40).y1,
        reference_step("energy-preserving", *args, 40).y1,
    )
    assert max(abs(a - b) for a, b in zip(both, plain, strict=True)) < 1e-38 * (1 + max(map(abs, plain)))
    problem, y, h, dW = case.build()
    found = schemes.both_invariants.step(problem, y, h, dW)
    plain = schemes.energy_preserving.step(problem, y, h, dW)
    assert np.max(np.abs(found - plain)) <= 2 * state_ulp(y, found)


def test_lotka_volterra_keeps_both_where_the_paper_keeps_one() -> None:
    problem, C = problems.lotka_volterra(), problems.lotka_volterra().nambu.casimir
    drifts = {}
    for scheme in (schemes.both_invariants, schemes.energy_preserving):
        path = sepv.integrate(scheme, problem, h=2.0**-8, T=2.0, seed=1)
        drifts[scheme.name] = (np.ptp(problem.hamiltonian(path.y)), np.ptp(C(path.y)))
    assert drifts["both-invariants"][0] < 1e-13
    assert drifts["both-invariants"][1] < 1e-13
    assert drifts["energy-preserving"][0] < 1e-13
    assert drifts["energy-preserving"][1] > 1e-4
