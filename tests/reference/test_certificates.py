"""Certificates: what is proved is proved of the right thing, and a wrong value is refused."""

import math

import pytest
from hypothesis import given
from sepv.reference.balls import ball, from_mpf, precision, real_balls
from sepv.reference.certify import NotCertified, certify, krawczyk_image
from sepv.reference.equations import EQUATIONS
from sepv.reference.steps import reference_step

from sepv import PolynomialSystem, UsageError, problems
from sepv.law import strategies
from sepv.verification import Case

pytest.importorskip("flint", reason="the extra certify is not installed")

PAPER = {name: factory().data for name, factory in problems.PAPER.items()}


def start(name: str) -> tuple[tuple[float, ...], float, tuple[float, ...]]:
    problem = problems.by_name(name)
    return tuple(map(float, problem.initial)), 0.1, (0.05,) * problem.noises


@pytest.mark.parametrize("scheme", EQUATIONS)
@pytest.mark.parametrize("name", PAPER)
def test_every_scheme_is_certified_on_every_problem(name: str, scheme: str) -> None:
    y, h, dW = start(name)
    step = reference_step(scheme, PAPER[name], y, h, dW)
    proof = certify(PAPER[name], y, h, dW, step)
    assert proof.width < 1e-90
    with precision(500):
        for value, enclosure in zip(step.y1, proof.y1, strict=True):
            assert abs(from_mpf(value) - enclosure).upper() < 1e-50
    if scheme.startswith(("energy", "collocation", "discrete")):
        assert proof.energy.contains(0)
    if scheme.startswith(("energy", "collocation", "midpoint", "gauss")):
        assert all(c.contains(0) for c in proof.casimirs)


def terms_of_energy(case: Case, y1) -> float:
    """The size of the terms of a polynomial H along a step: from states of 10^±100 they may
    cancel.
    """
    if not isinstance(case.problem, PolynomialSystem):
        return 0.0
    reach = [2 * max(abs(a), abs(float(b.mid()))) for a, b in zip(case.y, y1, strict=True)]
    terms = case.problem.hamiltonian.terms
    return sum(abs(c) * math.prod(r**k for r, k in zip(reach, powers, strict=True)) for powers, c in terms)


@given(strategies.any_steps())
def test_random_steps_are_certified_with_their_invariants(case: Case) -> None:
    step = reference_step("energy-preserving", case.problem, case.y, case.h, case.dW)
    proof = certify(case.problem, case.y, case.h, case.dW, step)
    assert proof.energy.contains(0)
    assert all(c.contains(0) for c in proof.casimirs)
    assert proof.energy.rad() < 1e-45 * max(1.0, terms_of_energy(case, proof.y1))
    # The derivatives of sinc and of log(1 + x)/x near 0 are enclosed to 1e-3 only; 1 is what the
    # proof needs.
    assert proof.contraction < 1e-2


@pytest.mark.parametrize("off", [1e-40, 1e-20, 1e-3])
def test_a_value_that_is_off_is_refused(off: float) -> None:
    y, h, dW = start("rigid-body")
    step = reference_step("energy-preserving", PAPER["rigid-body"], y, h, dW)
    wrong = step._replace(x=[step.x[0] + off, *step.x[1:]])
    with pytest.raises(NotCertified, match="Krawczyk's test fails in unknown 1"):
        certify(PAPER["rigid-body"], y, h, dW, wrong)


def test_a_centre_outside_the_box_proves_nothing() -> None:
    import flint

    # F(x) = (x − 10) + ¼(x − 10)² − ¼ has no zero in X = 10 ± 0.1; F′(X) = 1 ± 0.05 and Y = 1. From
    # x̃ = 9, where F = −1, K(X) = 10 ± 0.055 lies in the interior of X all the same.
    with precision(100):
        arb = flint.arb
        box = [arb(10) + ball(arb("0.1"))]
        defect = flint.arb_mat([[ball(arb("0.05"))]])
        value = lambda x: (x - 10) + (x - 10) ** 2 / 4 - arb("0.25")  # noqa: E731 - the formula of the comment
        assert not value(box[0]).contains(0)
        outside = arb(9)
        image = outside - value(outside) + (defect * flint.arb_mat([[box[0] - outside]]))[0, 0]
        assert box[0].contains_interior(image)
        with pytest.raises(NotCertified, match=r"its centre 9\.0* is not in"):
            krawczyk_image(defect, [value(outside)], [outside], box)
        # From the middle of the box the same test fails for the right reason: it is mapped towards
        # the zero at 10.24.
        with pytest.raises(NotCertified, match="is mapped to"):
            krawczyk_image(defect, [value(arb(10))], [arb(10)], box)


@pytest.mark.parametrize("x", [0.0, 1e-300, 1e-5, 0.0009, 0.0011, 0.3, -0.4])
@pytest.mark.parametrize("width", [1e-40, 1e-6, 0.1])
def test_derivatives_enclose_difference_quotients(x: float, width: float) -> None:
    with precision(300):
        arithmetic = real_balls(300)
        box = arithmetic.number(x) + ball(arithmetic.number(width))
        for f in (arithmetic.sinc, arithmetic.log1p_ratio, arithmetic.sin, arithmetic.cos):
            slope = f(arithmetic.nudged(box, arithmetic.number(1.0)))[1]
            # By the mean value theorem the quotient is a value of the derivative somewhere in the
            # box.
            a, b = arithmetic.number(x) - width / 2, arithmetic.number(x) + width / 2
            assert slope.overlaps((f(b) - f(a)) / (b - a))
            assert slope.is_finite()


def test_without_the_extra_the_error_says_what_still_works(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sepv.reference.balls.available", lambda: False)
    y, h, dW = start("pendulum")
    step = reference_step("midpoint", PAPER["pendulum"], y, h, dW)
    with pytest.raises(UsageError, match=r"python-flint(.|\n)*mpmath"):
        certify(PAPER["pendulum"], y, h, dW, step)


def test_no_global_precision_of_flint_is_touched() -> None:
    import flint

    before = flint.ctx.prec
    y, h, dW = start("pendulum")
    certify(PAPER["pendulum"], y, h, dW, reference_step("midpoint", PAPER["pendulum"], y, h, dW))
    assert flint.ctx.prec == before
