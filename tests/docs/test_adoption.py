"""What other repositories use of this one: the action, the hook for pre-commit, the form, the citation."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from sepv._version import __version__
from sepv.commands._verify import verify

ROOT = Path(__file__).resolve().parents[2]
SCHEME = """
import sepv


def step(problem, y, h, dW):
    delta = problem.random_step(h, dW)
    return y + delta * (problem.structure(y) @ problem.gradient(y)){wrong}


scheme = sepv.Scheme("own", step, claims=["identity"], batched=False)
"""


def load(name: str) -> Any:
    return yaml.safe_load((ROOT / name).read_text(encoding="utf-8"))


def act(folder: Path, **inputs: str) -> subprocess.CompletedProcess[str]:
    """The action's own step, in the environment that a runner makes of its inputs; sepv is installed already."""
    action = load("action.yml")
    install, step = action["runs"]["steps"]
    assert install["run"] == 'python -m pip install "$ACTION"'
    values = {name: str(about["default"]) for name, about in action["inputs"].items()}
    assert not set(inputs) - set(values)
    values |= inputs
    own = {
        key: values[re.fullmatch(r"\$\{\{ inputs\.(\w+) \}\}", text)[1]] for key, text in step["env"].items()
    }  # type: ignore[index]  # each is an input: else this fails
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return subprocess.run(
        ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"]],
        cwd=folder, env={**os.environ, **own, "PATH": path}, capture_output=True, text=True, check=False,
    )  # fmt: skip


@pytest.mark.parametrize(("wrong", "code"), [("", 0), (" + 1e-9 * h", 1)])
def test_the_action_is_green_and_red(tmp_path: Path, wrong: str, code: int) -> None:
    (tmp_path / "own_rule.py").write_text(SCHEME.format(wrong=wrong))
    done = act(tmp_path, target="own_rule:scheme", arguments="--law identity,truncation --seed 3")
    assert done.returncode == code, done.stdout + done.stderr
    report = json.loads((tmp_path / "sepv-report" / "laws.json").read_text())
    assert [f["law"] for f in report["laws"]] == ["identity", "truncation"]
    assert report["suite"]["seed"] == 3
    assert {p.name for p in (tmp_path / "sepv-report").iterdir()} == {
        "laws.json", "laws.xml", "badge.json", "laws.html",
    }  # fmt: skip


def test_the_action_says_what_it_lacks(tmp_path: Path) -> None:
    done = act(tmp_path)
    assert done.returncode == 2
    assert "Expected a TARGET, or a program with --exec" in done.stderr


def test_every_input_is_used_once() -> None:
    action = load("action.yml")
    used = re.findall(r"inputs\.(\w+)", yaml.safe_dump(action["runs"]))
    assert sorted(used) == sorted(action["inputs"])


def test_the_hook_runs_a_command_that_there_is() -> None:
    (hook,) = load(".pre-commit-hooks.yaml")
    assert hook["entry"].split() == ["sepv", verify.name]
    assert hook["pass_filenames"] is False


def test_the_form_asks_for_what_shows_a_verdict_again() -> None:
    form = load(".github/ISSUE_TEMPLATE/wrong-verdict.yml")
    needed = {part["id"] for part in form["body"] if part.get("validations", {}).get("required")}
    assert {"law", "replay", "scheme", "reason", "versions"} <= needed


def test_the_citation_names_this_version() -> None:
    citation = load("CITATION.cff")
    assert citation["version"] == __version__
    assert citation["license"] == "BSD-3-Clause"
