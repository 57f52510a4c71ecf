"""Mechanical systems: parts of a problem as libraries want them, and the named ones."""

import numpy as np
import pytest

from sepv import problems
from sepv.exact import exact_flow
from sepv.problem import Problem, Systems, mechanics
from sepv.verification._cases.classes import CLASSES

NAMED = (
    "henon-heiles", "pendulum-chain", "lennard-jones", "planets", "figure-eight", "harmonic-trap", "kepler", "pendulum",
    "toda",
)  # fmt: skip


def agrees(problem: Problem, y: np.ndarray) -> None:
    """The parts make H and the field again, for a state and a batch, and conversions are inverse to each other."""
    m = mechanics(problem)
    q, p = m.split(y)
    v, f = m.velocity(p), m.force(q)
    H = problem.hamiltonian(y)
    assert 0.5 * np.sum(p * v, axis=0) + m.potential(q) == pytest.approx(H, rel=1e-13, abs=1e-300)
    field = np.einsum("ij...,j...->i...", problem.structure(y), problem.gradient(y))
    np.testing.assert_allclose(m.join(v, f), field, rtol=1e-12, atol=1e-13 * np.max(np.abs(field)))
    np.testing.assert_allclose(m.momentum(v), p, rtol=1e-12, atol=1e-13 * np.max(np.abs(p)))
    assert np.array_equal(m.join(q, p), y)


@pytest.mark.parametrize("name", NAMED)
def test_named_problems_come_apart(name: str) -> None:
    problem = problems.by_name(name)
    y = np.asarray(problem.initial)
    agrees(problem, y)
    agrees(problem, np.stack([y, y * 1.01], axis=1))


def test_every_member_of_the_family_comes_apart_as_data_and_as_functions() -> None:
    seen = set()
    for _row, case in CLASSES[Systems.MECHANICAL].space.part().cases(5):
        problem, y, *_ = case.build()
        agrees(problem, y)
        m = mechanics(problem)
        assert m is mechanics(problem)
        assert m.positions_first
        assert np.array_equal(m.mass @ m.inverse_mass, np.eye(m.degrees)), "masses are exact"
        assert np.abs(m.mass) @ np.abs(m.inverse_mass) @ np.ones(m.degrees) == pytest.approx(1, abs=15), (
            "M(M⁻¹p) ~ p"
        )
        p = m.split(y)[1]
        assert np.array_equal(m.momentum(m.velocity(p)), p), "and so are velocities"
        seen.add((bool(np.count_nonzero(m.mass - np.diag(np.diag(m.mass)))), case.given))
    assert len(seen) == 6, "diagonal and full masses, given in each way"


def test_a_potential_bounded_below_is_so() -> None:
    space = CLASSES[Systems.MECHANICAL].space.part({"V": ("bounded below",)})
    for _, case in space.cases(1):
        H = case.problem.hamiltonian
        n = H.dimension // 2
        assert all(c > 0 and all(k % 2 == 0 for k in e) for e, c in H.terms if not any(e[n:]))


def test_the_trap_has_its_closed_form() -> None:
    trap = problems.harmonic_trap((1.0, 3.0), noise=())
    flow = exact_flow(trap, np.array([0.7]))
    np.testing.assert_allclose(flow.y[:2, 0], [np.cos(0.7), np.cos(2.1) / 3], rtol=1e-12)
