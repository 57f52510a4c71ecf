"""Tables of states: what their digits explain is no accusation; drift and wrong rows are found."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import sepv
from sepv import UsageError, problems, schemes
from sepv.commands._trajectory import trajectory as command
from sepv.studies import trajectory as study

PENDULUM = problems.pendulum()
QUIET = replace(PENDULUM, noise=(), data=None, check=False)
FORMATS = ["%.3g", "%.6g", "%.6f", "%.9e", "%.17g"]


def table(steps: int = 400, scheme: str = "midpoint", h: float = 0.05) -> np.ndarray:
    path = sepv.integrate(scheme, QUIET, h=h, steps=steps, dW=np.zeros((steps, 0)), y0=(0.2, 1.0))
    return np.column_stack([path.t, path.y.T])


def run(*words: Any) -> tuple[int, str]:
    done = CliRunner().invoke(command, [str(w) for w in words])
    return done.exit_code, done.output


@pytest.mark.parametrize("digits", FORMATS)
@pytest.mark.parametrize("scheme", ["midpoint", "energy-preserving", "leapfrog", "explicit-4"])
def test_rows_of_a_scheme_are_steps_whatever_digits_were_printed(
    tmp_path: Path, digits: str, scheme: str
) -> None:
    np.savetxt(tmp_path / "a.csv", table(60, scheme), fmt=digits, delimiter=",", header="t,p,q")
    rows = study.read_rows(tmp_path / "a.csv", QUIET)
    assert study.first_mismatch(rows, QUIET, schemes.by_name(scheme)) is None


@pytest.mark.parametrize("digits", FORMATS[1:])
def test_the_first_row_that_is_no_step_is_named(tmp_path: Path, digits: str) -> None:
    values = table(60)
    values[33:, 1] += 2e-3
    np.savetxt(tmp_path / "a.txt", values, fmt=digits)
    wrong = study.first_mismatch(study.read_rows(tmp_path / "a.txt", QUIET), QUIET, schemes.midpoint)
    assert wrong is not None
    assert (wrong.row, wrong.component) == (34, 1)
    assert abs(wrong.found - wrong.expected) > wrong.bound


def test_rows_with_increments_are_steps_of_the_scheme_that_made_them(tmp_path: Path) -> None:
    path = sepv.integrate("energy-preserving", PENDULUM, h=0.05, T=5.0, seed=3)
    np.save(tmp_path / "a.npy", np.column_stack([path.t, path.y.T, np.vstack([np.zeros((1, 2)), path.dW])]))
    rows = study.read_rows(tmp_path / "a.npy", PENDULUM)
    assert study.first_mismatch(rows, PENDULUM, schemes.energy_preserving) is None
    wrong = study.first_mismatch(rows, PENDULUM, schemes.midpoint)
    assert wrong is not None
    assert wrong.row == 2
    (energy,) = study.drifts(rows, PENDULUM)
    assert energy.kind == "rounding"


def test_kinds_of_growth_are_told_apart_or_left_open(tmp_path: Path) -> None:
    """A bounded error of period 1, a random walk, a linear drift;
    all are of H = y1 of a still problem.
    """
    still = sepv.Problem(
        2, ((0.0, 1.0), (-1.0, 0.0)), lambda y: y[0] + 0 * y[1], noise=(), initial=(0.0, 0.0)
    )
    t, random = np.arange(16385) / 8, np.random.default_rng(5)
    walk = np.cumsum(random.standard_normal(t.size))
    for errors, kind in (
        (np.sin(2 * np.pi * t / 3), "bounded"), (walk - walk[0], "a random walk"), (t, study.TREND),
        (t**2, study.TREND),
    ):  # fmt: skip
        np.save(tmp_path / "a.npy", np.column_stack([t, 1e-3 * errors, 0 * t]))
        (found,) = study.drifts(study.read_rows(tmp_path / "a.npy", still), still)
        assert found.kind == kind
    np.save(tmp_path / "a.npy", np.column_stack([t, 1e-3 * walk, 0 * t])[:100])
    (found,) = study.drifts(study.read_rows(tmp_path / "a.npy", still), still)
    assert found.kind == "inconclusive"


def test_a_drift_below_the_digits_is_not_called_one(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "a.csv", table(400, "energy-preserving"), fmt="%.6g", delimiter=",")
    (energy,) = study.drifts(study.read_rows(tmp_path / "a.csv", QUIET), QUIET)
    assert energy.largest > 1e-8
    assert energy.kind == "digits"


def test_the_command_reads_what_sepv_run_writes_and_draws(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    path = sepv.long_path(schemes.energy_preserving, problems.rigid_body(), h=0.05, steps=800, every=1)
    record = {"times": path.times.tolist(), "states": path.states.T.tolist()}
    (tmp_path / "run.json").write_text(json.dumps(record))
    code, text = run(tmp_path / "run.json", "-p", "rigid-body", "-o", tmp_path / "a.svg")
    assert code == 0, text
    assert "rounding" in text
    assert (tmp_path / "a.svg").read_text().startswith("<?xml")


def test_exit_code_1_is_a_row_that_is_no_step(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "a.csv", table(30), delimiter=",")
    asked = (tmp_path / "a.csv", "-p", "pendulum", "--no-noise", "--scheme")
    assert run(*asked, "midpoint")[0] == 0
    code, text = run(*asked, "euler-heun")
    assert code == 1
    assert "Row 2 is not a step of euler-heun from row 1" in text
    assert "dW" not in text


def test_increments_one_row_too_early_are_named_as_a_reason(tmp_path: Path) -> None:
    path = sepv.integrate("midpoint", "pendulum", h=0.05, steps=30, seed=3)
    none = np.zeros((1, 2))
    for dW, code, words in (
        ([none, path.dW], 0, "All 30"),
        ([path.dW, none], 1, "the dW of the step that ends in"),
    ):
        np.save(tmp_path / "a.npy", np.column_stack([path.t, path.y.T, np.vstack(dW)]))
        given, text = run(tmp_path / "a.npy", "-p", "pendulum", "--scheme", "midpoint")
        assert given == code
        assert words in text


WRONG = {
    "another number of columns": ("0 1\n1 2\n", "2 columns"),
    "rows of other lengths": ("0 1 2\n1 2\n", "line 2"),
    "one row": ("0 1 2\n", "1 rows"),
    "words": ("t p q\nzero one two\n", "no row of numbers"),
    "nan": ("0 1 2\n1 nan 2\n", "row 2, column 2"),
    "times that go back": ("1 1 2\n0 1 2\n", "t = 0.0 after 1.0"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_table_that_cannot_be_read_says_where(tmp_path: Path, name: str) -> None:
    text, words = WRONG[name]
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(UsageError, match="Remedy") as error:
        study.read_rows(tmp_path / "a.csv", replace(QUIET, dimension=2))
    assert words in str(error.value)


def test_increments_that_are_missing_are_asked_for(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "a.csv", table(30), delimiter=",")
    with pytest.raises(UsageError, match="dW_1"):
        study.first_mismatch(study.read_rows(tmp_path / "a.csv", PENDULUM), PENDULUM, schemes.midpoint)


# McLachlan's third-order splitting, as in SUNDIALS' ARKODE_SPRK_MCLACHLAN_3_3; the coefficients of
# q are those of p, last first.
OF_P = np.array([0.2683300957817599, -0.18799161879915982, 0.919661523017399857])
# H(p, q) − H0 at t = 50 by step size, from examples/arkode/C_serial/ark_kepler_…MCLACHLAN_3_3….out
# of SUNDIALS (LLNL/sundials at 0df4cce2, BSD-3-Clause).
SUNDIALS = {0.1: 8.9881034690120210e-04, 0.05: 1.2012096161595487e-04, 0.025: 1.3406075334732037e-05}
# Energies at every 100th step of 1e-4, from src/ts/tutorials/hamiltonian/output/ex1_1.out of PETSc
# (petsc/petsc at 905158c6, BSD-2-Clause): symplectic Euler on a spring with ω = 64.
PETSC = ("81.92", "81.6695", "81.7775", "82.09", "82.1612", "81.8895", "81.6625", "81.8041", "82.1122", "82.1473",
         "81.8593")  # fmt: skip


@pytest.mark.parametrize("h", SUNDIALS)
def test_the_drift_of_a_published_kepler_orbit_is_the_one_that_sundials_printed(
    tmp_path: Path, h: float
) -> None:
    """The log has energies and no states, so its scheme is written here,
    and its states are read as a table.
    """
    kepler = replace(problems.kepler(), noise=(), data=None, check=False)
    y = np.array(kepler.initial)
    p, q = y[:2], y[2:]
    rows = [(0.0, *p, *q)]
    for n in range(round(50 / h)):
        for of_p, of_q in zip(OF_P, OF_P[::-1], strict=True):
            p = p - h * of_p * q / (q @ q) ** 1.5
            q = q + h * of_q * p
        rows.append(((n + 1) * h, *p, *q))
    np.save(tmp_path / "kepler.npy", np.array(rows))
    drift = study.drifts(study.read_rows(tmp_path / "kepler.npy", kepler), kepler)[0]
    # Roundings of at most 2,000 steps, √N eps times a condition of the pericentre of about 20;
    # 5e-15 were seen.
    assert drift.errors[-1] == pytest.approx(SUNDIALS[h], abs=1e-13)
    assert drift.kind not in ("rounding", "digits", "a random walk")


def test_the_energies_of_a_published_spring_are_those_that_petsc_printed(tmp_path: Path) -> None:
    spring = sepv.Problem(
        dimension=2, structure=np.array([[0.0, -1.0], [1.0, 0.0]]), noise=(), initial=(0.0, 0.2), name="spring",
        hamiltonian=lambda y: 0.5 * (y[0] * y[0] + 4096.0 * y[1] * y[1]),
    )  # fmt: skip
    v, x, rows = 0.0, 0.2, [(0.0, 0.0, 0.2)]
    for n in range(1000):
        v -= 1e-4 * 4096.0 * x
        x += 1e-4 * v
        rows.append(((n + 1) * 1e-4, v, x))
    np.save(tmp_path / "spring.npy", np.array(rows))
    (drift,) = study.drifts(study.read_rows(tmp_path / "spring.npy", spring), spring)
    assert tuple(f"{81.92 + e:.6g}" for e in drift.errors[::100]) == PETSC
    assert drift.kind == "inconclusive"  # a line in blocks of 64 rows, where H has a period of 491
    assert run(tmp_path / "spring.npy", "-p", "harmonic-oscillator", "--no-noise")[0] == 0
