"""Momenta reversed and volume kept: the systems that the laws speak of, and schemes on both sides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.right_schemes import RIGHT
from sepv import Scheme, Skipped, problems, verify
from sepv.problem import Array, Problem, mechanics
from sepv.problem._reversal import momentum_flip
from sepv.verification import Effort

FEW = Effort(examples=2)


@pytest.mark.parametrize(
    ("name", "momenta"),
    [
        ("pendulum", [0]),
        ("harmonic-oscillator", [0]),
        ("henon-heiles", [2, 3]),
        ("lennard-jones", range(6, 12)),
        ("rigid-body", None),
        ("lotka-volterra", None),
    ],
)
def test_momenta_are_the_half_of_y_that_b_names(name: str, momenta: list[int] | None) -> None:
    rho = momentum_flip(problems.by_name(name))
    assert (None if rho is None else np.flatnonzero(rho < 0).tolist()) == (momenta and list(momenta))


def test_a_hamiltonian_odd_in_the_momenta_has_no_reversal() -> None:
    pendulum = problems.pendulum()
    drifting = Problem(2, pendulum.structure, lambda y: pendulum.hamiltonian(y) + y[0] * 1e-9, check=False)
    assert momentum_flip(drifting) is None


def verlet(problem: Problem, y: Array, h: float, dW: Array, friction: float = 0.0, halves: int = 2) -> Array:
    """Verlet's method, with friction for a factor of the momenta; with one half it is symplectic Euler."""
    if h < 0:
        raise ArithmeticError("no step backward in time")
    system, dt = mechanics(problem), problem.random_step(h, dW)
    q, p = system.split(y)
    p = (1 - friction * dt) * p + (dt / 2 if halves == 2 else dt) * system.force(q)
    q = q + dt * system.velocity(p)
    return system.join(q, p + dt / 2 * system.force(q) if halves == 2 else p)


@pytest.mark.parametrize(
    ("changes", "reversible", "volume"),
    [
        ({}, "holds", "holds"),
        ({"halves": 1}, "violated", "holds"),
        ({"friction": 1e-7}, "violated", "violated"),
    ],
)
def test_verlet_is_reversible_though_it_makes_no_step_backward(
    changes: dict[str, float], reversible: str, volume: str
) -> None:
    scheme = Scheme("verlet", lambda *step: verlet(*step, **changes), systems="mechanical")
    report = verify(scheme, laws="reversibility,volume,symmetry", effort=FEW)
    assert report.finding("symmetry").verdict.text == "not applicable"
    assert report.finding("reversibility").verdict.text == reversible
    assert report.finding("volume").verdict.text == volume


def test_a_charge_in_a_magnetic_field_keeps_volume_with_boris_and_not_with_another_turn() -> None:
    boris = RIGHT["boris"]
    assert verify(boris, laws="volume", effort=FEW).finding("volume").verdict.text == "holds"

    def stretched(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        """The turn by I + ΔW instead of Cayley's transform."""
        v = y[3:] + problem.random_step(h, dW) * (problem.structure(y) @ problem.gradient(y))[3:]
        return np.concatenate([y[:3] + problem.random_step(h, dW) * v, v])

    wrong = replace(boris, step=stretched)
    assert verify(wrong, laws="volume", effort=FEW).finding("volume").verdict.text == "violated"


def test_a_flow_that_changes_volume_is_not_asked() -> None:
    """Lotka and Volterra's system stretches volumes."""

    def refused(*_: object) -> Array:
        raise Skipped("never asked")

    finding = verify(Scheme("none", refused, problems=["lotka-volterra"]), laws="volume").finding("volume")
    assert finding.verdict.text == "not applicable"
    assert "changes volume" in finding.message
