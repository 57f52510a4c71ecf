"""The order without noise: right orders hold, wrong ones are told by number, in any unit, with any tolerance stated."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from doors import finding
from sepv.properties._orders.without_noise import RATIO, judge

import sepv
from benchmarks.right_schemes.other_formulas import MECHANICAL
from sepv.problem import Problem, mechanics
from sepv.schemes import Scheme
from sepv.schemes._leapfrog import composed
from sepv.schemes._one_step import Explicit
from sepv.verification import Finding, Verdict

LAW = "deterministic-order"
LEAPFROG, YOSHIDA, BLANES_MOAN = (sepv.schemes.by_name(n) for n in ("leapfrog", "yoshida-4", "blanes-moan-4"))


def _runge_kutta(second: float) -> Callable[..., np.ndarray]:
    """The classical method of order 4, or with another weight of the second stage in the third."""

    def step(problem: Problem, y: np.ndarray, h: float, _dW: np.ndarray) -> np.ndarray:
        def field(x: np.ndarray) -> np.ndarray:
            return np.einsum("ij...,j...->i...", problem.structure(x), problem.gradient(x))

        k1 = field(y)
        k2 = field(y + h / 2 * k1)
        k3 = field(y + h * (second * k2 + (0.5 - second) * k1))
        return y + h / 6 * (k1 + 2 * k2 + 2 * k3 + field(y + h * k3))

    return step


def _one_mass_each(problem: Problem, y: np.ndarray, h: float, _dW: np.ndarray) -> np.ndarray:
    """The leapfrog of a library that knows diagonal mass matrices only: a symplectic map of another system."""
    m = mechanics(problem)
    q, p = m.split(y)
    p = p + h / 2 * m.force(q)
    q = q + h * (np.diag(m.inverse_mass) * p.T).T
    return m.join(q, p + h / 2 * m.force(q))


def _own(step: Callable[..., np.ndarray]) -> Scheme:
    return Scheme("own", step, batched=True, systems="mechanical", noise=False)


def found(scheme: Scheme, problems: Any = None, **facts: Any) -> Finding:
    return finding(replace(scheme, **facts), LAW, problems)


@pytest.mark.parametrize("scheme", [*MECHANICAL, LEAPFROG, YOSHIDA, BLANES_MOAN], ids=lambda s: s.name)
def test_right_orders_hold_and_are_stated(scheme: Scheme) -> None:
    finding = found(scheme)
    assert finding.verdict is Verdict.HOLDS, finding.message
    assert finding.claimed
    assert {entry["order"] for entry in finding.witness["measured"]} == {scheme.order}


@pytest.mark.parametrize(
    ("name", "order"),
    [("energy-preserving", 2.0), ("collocation-3", 6.0), ("explicit-8", 8.0), ("euler-maruyama", 1.0)],
)
def test_schemes_with_noise_have_an_order_without_it(name: str, order: float) -> None:
    assert found(sepv.schemes.by_name(name), order=float(order)).verdict is Verdict.HOLDS
    assert found(sepv.schemes.by_name(name)).verdict is Verdict.HOLDS  # unclaimed: consistent


@pytest.mark.parametrize(
    ("scheme", "claimed", "order"),
    [
        (LEAPFROG, 3, 2), (LEAPFROG, 4, 2), (YOSHIDA, 6, 4), (BLANES_MOAN, 5, 4), (MECHANICAL[2], 4, 3),
        (replace(YOSHIDA, step=Explicit(composed((1.35, -1.7, 1.35)))), 4, 2),
        (_own(_runge_kutta(0.5)), 5, 4), (_own(_runge_kutta(0.25)), 4, 2), (_own(_one_mass_each), 2, 0),
        (sepv.schemes.energy_preserving, 3, 2), (sepv.schemes.collocation(2), 6, 4),
    ],
)  # fmt: skip
def test_a_wrong_order_is_told_in_one_line(scheme: Scheme, claimed: float, order: int) -> None:
    finding = found(scheme, order=float(claimed))
    assert finding.verdict is Verdict.VIOLATED
    assert finding.message.splitlines()[0] == f"order {claimed} claimed, {order} found"


def _scaled(time: float, length: float) -> Problem:
    """Hénon and Heiles with other units of time and length: H(y/length) length²/time, B = J."""
    B = sepv.problems.henon_heiles().structure
    H = lambda y: (0.5 * np.sum(y * y, axis=0) + (y[0] ** 2 * y[1] - y[1] ** 3 / 3) / length) / time  # noqa: E731
    return sepv.Problem(4, B, H, initial=length * np.array([0.1, 0.2, 0.4, -0.1]), noise=())


@cache
def usual() -> Finding:
    return found(YOSHIDA, _scaled(1.0, 1.0))


@pytest.mark.parametrize(("time", "length"), [(2.0**-20, 1.0), (2.0**20, 2.0**-10), (1.0, 2.0**20)])
def test_no_verdict_depends_on_units(time: float, length: float) -> None:
    right = found(YOSHIDA, _scaled(time, length))
    wrong = found(YOSHIDA, _scaled(time, length), order=5.0)
    assert right.defect == pytest.approx(usual().defect, abs=0.05)
    assert (right.verdict, wrong.verdict) == (Verdict.HOLDS, Verdict.VIOLATED)


def _stopped_at(tolerance: float) -> Callable[..., np.ndarray]:
    """The midpoint rule, solved to this tolerance."""

    def step(problem: Problem, y: np.ndarray, h: float, _dW: np.ndarray) -> np.ndarray:
        def field(x: np.ndarray) -> np.ndarray:
            return problem.structure(x) @ problem.gradient(x)

        z = y + h * field(y)
        for _ in range(200):
            z, before = y + h * field((y + z) / 2), z
            if np.max(np.abs(z - before)) < tolerance:
                return z
        raise ArithmeticError("no convergence")

    return step


@pytest.mark.parametrize("tolerance", [1e-6, 1e-10])
@pytest.mark.parametrize("stated", [False, True])
def test_a_tolerance_is_no_order(tolerance: float, *, stated: bool) -> None:
    scheme = Scheme("midpoint", _stopped_at(tolerance), order=2.0, solver_tolerance=tolerance * stated)
    assert found(scheme).verdict is Verdict.HOLDS


@pytest.mark.parametrize(
    ("facts", "verdict"),
    [({}, Verdict.VIOLATED), ({"solver_tolerance": 1e-6}, Verdict.HOLDS)],
    ids=["", "stated"],
)
def test_a_step_size_in_32_bits_is_told_from_one_in_64(facts: dict[str, Any], verdict: Verdict) -> None:
    rounded = replace(_own(lambda p, y, h, dW: LEAPFROG.step(p, y, float(np.float32(h)), dW)), **facts)
    finding = found(rounded, order=2.0)
    assert finding.verdict is verdict
    assert ("h or y1 is rounded to 32 bits" in finding.message) is (verdict is Verdict.VIOLATED)


def test_errors_that_do_not_fall_accuse_nobody() -> None:
    h = 4 * RATIO ** -np.arange(31.0)
    flat = judge(h, np.full(31, 1e-7), 4.5, 1e-14, 2e-11)
    assert flat.verdict is Verdict.INCONCLUSIVE
    noise = np.random.default_rng(0).uniform(0, 4e-12, 31)
    assert judge(h, noise, 8.5, 1e-14, 2e-11).verdict is Verdict.HOLDS
    law = 1e-3 * h**3
    assert judge(h, law, 2.5, 1e-14, 2e-11).order == 2
    assert judge(h, law, 4.5, 1e-14, 2e-11).verdict is Verdict.VIOLATED


def test_several_hamiltonians_have_no_such_order() -> None:
    finding = found(sepv.schemes.by_name("stochastic-midpoint"))
    assert finding.verdict is Verdict.NOT_APPLICABLE
