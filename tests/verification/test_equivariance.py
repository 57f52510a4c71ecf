"""Equivariance is affine: a fault that linear maps keep is seen by translations."""

from __future__ import annotations

import numpy as np
import pytest
from sepv.properties import test_equivariance as equivariance
from sepv.reference.faults.saboteurs import SABOTEURS

from sepv import problems, schemes, verify
from sepv.problem import PolynomialSystem
from sepv.record import _polynomial as poly
from sepv.verification import Case, Effort, Verdict

H = poly.polynomial(2, [((2, 0), 0.5), ((0, 2), 0.5), ((1, 2), 0.25)])
SYSTEM = PolynomialSystem(2, H, ((0, 1, poly.polynomial(2, [((0, 0), -1.0), ((1, 0), 0.5)])),), (1.0,))


def test_a_term_in_y_is_seen_by_the_translation(monkeypatch: pytest.MonkeyPatch) -> None:
    case = Case(SYSTEM, (0.5, -0.25), 0.03125, (0.0625,))
    scheme = SABOTEURS["term-in-y"].scheme
    assert equivariance.check(scheme, case).violates
    linear = [t for t in equivariance.transformations(np.array(case.y)) if not t[3].any()]
    assert len(linear) == 3
    monkeypatch.setattr(equivariance, "transformations", lambda y: linear)
    assert not equivariance.check(scheme, case).violates


def test_the_transformed_system_is_the_same_system_in_other_variables() -> None:
    problem, y = problems.build(SYSTEM), np.array([0.5, -0.25])
    for name, P, inverse, b in equivariance.transformations(y):
        other = problems.build(equivariance.transformed(SYSTEM, P, inverse, b))
        z = P @ y + b
        assert other.hamiltonian(z) == problem.hamiltonian(y), name
        assert np.array_equal(P @ problem.structure(y) @ P.T, other.structure(z)), name
        assert np.array_equal(inverse.T @ problem.gradient(y), other.gradient(z)), name


@pytest.mark.parametrize(
    "scheme", [schemes.energy_preserving, schemes.milstein, schemes.euler_maruyama, schemes.explicit(8)]
)
def test_methods_of_the_field_alone_are_affine(scheme) -> None:  # type: ignore[no-untyped-def]
    (finding,) = verify(scheme, laws=["equivariance"], effort=Effort(examples=15)).findings
    assert finding.verdict is Verdict.HOLDS, finding.message


def test_the_rounding_of_itos_correction_accuses_nobody() -> None:
    """ΔW far below √h: ½c²hf′f moves y by 1 and Δf by 0.01, and H has terms that cancel in moved coordinates."""
    H = poly.polynomial(4, [((0, 0, 0, 2), -98304.0), ((1, 1, 1, 0), 262144.0)])
    system = PolynomialSystem(4, H, ((1, 3, poly.constant(4, 1.0)),), (2.0,))
    y = (1.0, -0.7017122627277087, 0.00034158379798636206, 0.9723055064388266)
    case = Case(system, y, 2.976779282863654e-08, (2.0656965763279653e-08,))
    measured = equivariance.check(schemes.euler_maruyama, case)
    assert not measured.violates
    assert measured.defect > 1000  # ulp of y
