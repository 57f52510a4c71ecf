"""Equations of the midpoint alone are multiplied out, and the compiled engine's first steps solve those."""

from typing import Any

import numpy as np
import pytest

import sepv
from sepv import problems, schemes
from sepv.schemes import _energy_preserving, _midpoint
from sepv.schemes._one_step import implicit
from sepv.solve._recorded import Recorded


def longer(fields: Any, y: Any, z: Any, step: Any) -> Any:
    """Δ B(ȳ)∇̄H, three halves of it."""
    return 1.5 * _energy_preserving.formula(fields, y, z, step)


def off_the_middle(fields: Any, y: Any, z: Any, step: Any) -> Any:
    """Δ f(y + z/4): its z is not seen through ȳ."""
    return step[0] * fields.field(y + 0.25 * z)


def with_a_square(fields: Any, y: Any, z: Any, step: Any) -> Any:
    """Δ f(ȳ) + Δ² f(ȳ)."""
    return (step[0] + step[0] * step[0]) * fields.field(y + 0.5 * z)


@pytest.mark.parametrize(
    ("name", "formula", "multiplied"),
    [
        ("rigid-body", _energy_preserving.formula, True), ("rigid-body", longer, True),
        ("harmonic-oscillator", _midpoint.formula, True), ("rigid-body", off_the_middle, False),
        ("rigid-body", with_a_square, False), ("pendulum", _energy_preserving.formula, False),
        ("lotka-volterra", _energy_preserving.formula, False), ("kepler", _energy_preserving.formula, False),
    ],
)  # fmt: skip
def test_right_sides_of_the_midpoint_alone_are_multiplied_out(name, formula, multiplied) -> None:
    assert (Recorded(problems.by_name(name)).of_middle(formula) is not None) == multiplied


@pytest.mark.parametrize("formula", [longer, off_the_middle, with_a_square])
@pytest.mark.parametrize("h", [2.0**-7, 2.0**-2])
def test_the_engines_agree_on_formulas_of_each_kind(formula: Any, h: float) -> None:
    pytest.importorskip("numba")
    scheme = sepv.Scheme("probe", implicit(formula))
    ends = [
        sepv.ensemble(scheme, problems.rigid_body(), h=h, steps=8, paths=150, engine=engine)
        for engine in ("numpy", "compiled")
    ]
    assert (ends[0].status == 0).all()
    assert (ends[1].status == 0).all()
    assert np.abs(ends[0].y - ends[1].y).max() <= 1e-14


@pytest.mark.parametrize(
    "scheme", [schemes.energy_preserving, schemes.stochastic_midpoint], ids=lambda s: s.name
)
def test_given_increments_are_read_where_they_are_whatever_their_number(scheme: sepv.Scheme) -> None:
    pytest.importorskip("numba")
    problem = problems.rigid_body()
    dW = 0.1 * np.random.default_rng(3).standard_normal((20, problem.noises, 300))
    whole = sepv.ensemble(scheme, problem, h=0.01, steps=20, dW=dW, engine="compiled")
    assert np.array_equal(whole.W, np.add.accumulate(dW)[-1])
    for part in (slice(0, 128), slice(0, 131), slice(5, 9), slice(40, 300)):
        alone = sepv.ensemble(scheme, problem, h=0.01, steps=20, dW=dW[:, :, part], engine="compiled")
        assert np.array_equal(alone.y, whole.y[:, part])
