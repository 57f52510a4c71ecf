"""What a terminal cannot encode is said in ASCII: never a traceback, and never exit code 1 for a crash."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from click.testing import CliRunner

from sepv.commands._cli import main
from sepv.commands._shared import CRASH
from sepv.console import ascii_text


@pytest.mark.parametrize("encoding", ["ascii", "cp1252"])
def test_a_report_is_printed_in_any_encoding(encoding: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "sepv", "verify", "midpoint", "--law", "truncation", "--law", "identity",
         "--examples", "5"],
        env=os.environ | {"PYTHONIOENCODING": encoding}, capture_output=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    shown = done.stdout.decode("ascii")
    assert "<= 0" in shown
    assert "2 laws: 2 hold;" in shown


def test_texts_read_the_same_in_ascii() -> None:
    assert (
        ascii_text("|Δ| ≤ ½·√n, ∇H ≥ 2⁻⁴, naïve ☃") == "|Delta| <= 1/2*sqrt n, grad H >= 2^-4, naive \\u2603"
    )


def test_a_defect_of_our_own_is_no_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise TypeError("a defect")

    monkeypatch.setattr("sepv.verification._report.summary", broken)
    result = CliRunner().invoke(main, ["verify", "midpoint", "--law", "truncation"])
    assert result.exit_code == CRASH == 70
    assert "a defect of sepv itself, and no verdict: TypeError: a defect" in result.output


def test_a_reader_that_goes_away_is_no_verdict() -> None:
    done = subprocess.run(
        ["bash", "-c", f"{sys.executable} -m sepv hard --explain | true; echo ${{PIPESTATUS[0]}}"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.stdout.strip() == "141", done.stderr
    assert "Traceback" not in done.stderr
