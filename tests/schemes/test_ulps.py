"""One-step defects in ulps: small for what is kept, of the right size for what is not."""

import json

import numpy as np
import pytest
from doors import command, obeys

import sepv
from sepv import problems, schemes
from sepv.schemes import Scheme
from sepv.studies._ulps import one_step


@pytest.mark.parametrize("name", problems.PAPER)
def test_the_energy_preserving_scheme_stays_within_two_ulps(name: str) -> None:
    """Two is no bound (that is derived, and larger): it is what 10⁶ steps have shown, doubled."""
    found = one_step(schemes.energy_preserving, problems.by_name(name), steps=200)
    assert found.failed == 0
    assert 0 < found.energy_median < found.energy_largest < 2
    assert (found.casimir_largest is not None) == (name == "rigid-body")
    if found.casimir_largest is not None:
        assert found.casimir_largest < 2


def test_a_known_defect_has_a_known_size() -> None:
    """y moved by one part in 2⁴⁰ along itself changes H = |y|²/2 by 2·2⁻⁴⁰ H = eps|∇H||y| 2⁻⁴⁰/eps."""
    scheme = Scheme("stretched", lambda problem, y, h, dW: y * (1 + 2.0**-40))
    found = one_step(scheme, problems.harmonic_oscillator(), steps=20)
    assert found.energy_median == pytest.approx(2.0**12, rel=1e-3)


def test_failures_are_counted_and_left_out() -> None:
    def step(problem, y, h, dW):
        if dW[0] > 0:
            raise RuntimeError("out of order")
        return y * np.nan if dW[0] < -0.1 else y.copy()

    found = one_step(Scheme("mine", step), problems.rigid_body(), steps=100)
    assert 50 < found.failed < 100
    assert found.energy_largest == 0
    nothing = one_step(Scheme("none", lambda p, y, h, dW: y[:1]), problems.rigid_body(), steps=5)
    assert nothing.failed == 5
    assert nothing.energy_median is None


def test_a_problem_of_functions_is_measured_by_its_own_code() -> None:
    mine = sepv.Problem(1, lambda y: np.zeros((1, 1, *y.shape[1:])), lambda y: y[0] ** 2, initial=(1.0,))
    off = Scheme("off", lambda p, y, h, dW: 2 * y)
    at_rest, moved = (one_step(s, mine, steps=5) for s in (schemes.midpoint, off))
    assert at_rest.energy_largest == 0
    # From y = 1 to 2: ΔH = 3 in units of eps |∇H||y| = 8 eps.
    assert moved.energy_largest == pytest.approx(3 / (8 * 2.0**-52))


def test_the_command_prints_a_table_and_writes_json(tmp_path) -> None:
    out = tmp_path / "ulps.json"
    names = "energy-preserving euler-heun -p rigid-body -p pendulum"
    shown = command(f"ulps {names} --steps 20 --json {out}").output
    found = json.loads(out.read_text())
    rows = found["rows"]
    wrong = ({"h": 0}, {"energy_median": -1.0}, {"failed": None}, {"more": 1})
    obeys(found, "ulps", *({"rows": [rows[0] | spoil]} for spoil in wrong))
    assert [(r["scheme"], r["problem"]) for r in rows] == [
        (s, p) for s in ("energy-preserving", "euler-heun") for p in ("rigid-body", "pendulum")
    ]
    assert rows[0]["energy_largest"] < 2
    assert rows[2]["energy_median"] > 1e6
    assert "energy:" in shown
