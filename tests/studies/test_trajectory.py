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
    """A bounded error of period 1, a random walk, a linear drift; all are of H = y1 of a still problem."""
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
