"""Equations of the midpoint alone are multiplied out, and the compiled engine's first steps solve those."""

from typing import Any

import numpy as np
import pytest

import sepv
from sepv import problems, schemes
from sepv.record._arrays import evaluator
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


@pytest.mark.parametrize("formula", [_energy_preserving.formula, _midpoint.formula, longer])
@pytest.mark.parametrize("name", ["rigid-body", "harmonic-oscillator"])
def test_a_right_side_of_the_midpoint_is_multiplied_out(name: str, formula: Any) -> None:
    recorded = Recorded(problems.by_name(name))
    P = recorded.of_middle(formula)
    assert P is not None
    found = recorded.equation_of(formula, 1)
    rng = np.random.default_rng(1)
    y, z = rng.standard_normal((2, recorded.dimension))
    R = evaluator([recorded.y, recorded.z, found.step], found.R)(y, z, np.array([0.3]))
    powers = [sum(c * np.prod((y + z / 2) ** np.array(e)) for e, c in p.terms) for p in P]
    assert np.allclose(R, 0.3 * np.array(powers), rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize(
    ("name", "formula"),
    [
        ("rigid-body", off_the_middle), ("rigid-body", with_a_square), ("pendulum", _energy_preserving.formula),
        ("lotka-volterra", _energy_preserving.formula), ("kepler", _energy_preserving.formula),
    ],
)  # fmt: skip
def test_other_equations_are_not(name: str, formula: Any) -> None:
    assert Recorded(problems.by_name(name)).of_middle(formula) is None


@pytest.mark.parametrize("formula", [longer, off_the_middle])
@pytest.mark.parametrize("h", [2.0**-7, 2.0**-2])
def test_the_engines_agree_on_formulas_of_either_kind(formula: Any, h: float) -> None:
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
