"""What other repositories use of this one: the action, the projects of examples/ci, the hook, the form, the citation.

Each project is built, and the step of its workflow run as the action runs it, green and red. What a workflow does
beside the action (checkout, interpreters, `pip install .`) is the runner's; here the folder is on the path instead.
"""

import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import yaml
from doors import ROOT

from sepv._version import __version__
from sepv.commands._verify import verify

PROJECTS = ROOT / "examples" / "ci"
SCHEME = """
import sepv


def step(problem, y, h, dW):
    delta = problem.random_step(h, dW)
    return y + delta * (problem.structure(y) @ problem.gradient(y)){wrong}


scheme = sepv.Scheme("own", step, claims=["identity"], batched=False)
"""


def load(file: Path) -> Any:
    return yaml.safe_load(file.read_text(encoding="utf-8"))


def environment(home: Path) -> dict[str, str]:
    """A runner's, where sepv is installed."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return {**os.environ, "PATH": path, "PYTHONPATH": f"{home}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}


def act(home: Path, **inputs: str) -> subprocess.CompletedProcess[str]:
    """The action's own step in a folder, with inputs as a workflow gives them."""
    action = load(ROOT / "action.yml")
    install, step = action["runs"]["steps"]
    assert install["run"] == 'python -m pip install "$ACTION"'
    assert set(inputs) <= set(action["inputs"])
    values = {name: str(inputs.get(name, about["default"])) for name, about in action["inputs"].items()}
    own = {
        key: values[text.removeprefix("${{ inputs.").removesuffix(" }}")] for key, text in step["env"].items()
    }
    return subprocess.run(
        ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"]],
        cwd=home, env=environment(home) | own, capture_output=True, text=True, check=False,
    )  # fmt: skip


@pytest.mark.parametrize(("wrong", "code"), [("", 0), (" + 1e-9 * h", 1)])
def test_the_action_is_green_and_red(tmp_path: Path, wrong: str, code: int) -> None:
    (tmp_path / "own_rule.py").write_text(SCHEME.format(wrong=wrong))
    done = act(tmp_path, target="own_rule:scheme", arguments="--law identity,truncation --seed 3")
    assert done.returncode == code, done.stdout + done.stderr
    report = json.loads((tmp_path / "sepv-report" / "laws.json").read_text())
    assert [f["law"] for f in report["laws"]] == ["identity", "truncation"]
    assert report["suite"]["seed"] == 3
    made = {p.name for p in (tmp_path / "sepv-report").iterdir()}
    assert made == {"laws.json", "laws.xml", "badge.json", "laws.html"}


# As `arguments: |` gives them: a claim in the second line must not be lost, and * is no pattern.
@pytest.mark.parametrize(("inputs", "code", "words"), [
    ({}, 2, "Expected a TARGET, or a program with --exec"),
    ({"target": "midpoint", "arguments": "--law energy\n--claim energy\n"}, 1, "not found to hold: energy"),
    ({"target": "midpoint", "arguments": "--law *"}, 2, "'*'"),
])  # fmt: skip
def test_the_action_says_what_is_wrong(tmp_path: Path, inputs: dict[str, str], code: int, words: str) -> None:
    (tmp_path / "laws.json").touch()
    done = act(tmp_path, **inputs)
    assert done.returncode == code, done.stdout + done.stderr
    assert words in done.stdout + done.stderr


def test_every_input_is_used_once() -> None:
    action = load(ROOT / "action.yml")
    used = re.findall(r"inputs\.(\w+)", yaml.safe_dump(action["runs"]))
    assert sorted(used) == sorted(action["inputs"])


def test_the_hook_runs_a_command_that_there_is() -> None:
    (hook,) = load(ROOT / ".pre-commit-hooks.yaml")
    assert hook["entry"].split() == ["sepv", verify.name]
    assert hook["pass_filenames"] is False


def test_the_form_asks_for_what_shows_a_verdict_again() -> None:
    form = load(ROOT / ".github" / "ISSUE_TEMPLATE" / "wrong-verdict.yml")
    needed = {part["id"] for part in form["body"] if part.get("validations", {}).get("required")}
    assert {"law", "replay", "scheme", "reason", "versions"} <= needed


def test_the_citation_names_this_version() -> None:
    citation = load(ROOT / "CITATION.cff")
    assert citation["version"] == __version__
    assert citation["license"] == "BSD-3-Clause"


class Project(NamedTuple):
    """A folder, the tool that it needs, a fault (text of a file, and what is put in its place), a law that sees it."""

    folder: str
    needs: str
    file: str
    right: str
    wrong: str
    law: str = "casimir"


# Each fault is one sign or factor in the scheme itself.
ALL = (
    Project("numpy-package", "numpy", "spinning/midpoint.py", "middle = (y + y1) / 2", "middle = y + 0.49 * (y1 - y)"),
    Project("jax-package", "jax", "flowing/heun.py", "y + 0.5 * delta * (first", "y + 0.49 * delta * (first",
            "local-mean-square"),
    Project("cpp-program", "c++", "scheme.hpp", "0.5 * (y[i] + next[i])", "y[i] + 0.49 * (next[i] - y[i])"),
    Project("node-program", "node", "heun.js", "0.5 * delta * (first[i]", "0.49 * delta * (first[i]", "right-limit"),
)  # fmt: skip


def test_every_project_is_tested_and_listed() -> None:
    folders = {p.name for p in PROJECTS.iterdir() if p.is_dir()}
    assert folders == {project.folder for project in ALL}
    text = (PROJECTS / "README.md").read_text(encoding="utf-8")
    assert all(f"[{name}]({name})" in text for name in folders)


def ran(home: Path, **changes: str) -> subprocess.CompletedProcess[str]:
    """The workflow's own commands, then the action's step with the workflow's inputs, but for what is changed."""
    inputs: dict[str, str] = {}
    for step in load(home / ".github" / "workflows" / "laws.yml")["jobs"]["verify"]["steps"]:
        if "run" in step and not step["run"].startswith("pip install"):
            subprocess.run(step["run"], shell=True, cwd=home, env=environment(home), check=True)
        if step.get("uses", "").startswith("OWNER/sepv@"):
            inputs = step["with"] | changes
    return act(home, **inputs)


# One program over `--exec`, that in C++, is run each time.
@pytest.mark.parametrize("project", [
    pytest.param(project, id=project.folder, marks=[pytest.mark.deep] * (project.needs == "node")) for project in ALL
])  # fmt: skip
def test_a_project_is_green_and_with_a_fault_red(project: Project, tmp_path: Path) -> None:
    found = shutil.which(project.needs) or importlib.util.find_spec(project.needs.replace("c++", "cxx"))
    if not found:
        pytest.skip(f"{project.needs} is not installed")
    home = tmp_path / project.folder
    shutil.copytree(PROJECTS / project.folder, home)
    green = ran(home)
    assert green.returncode == 0, green.stdout + green.stderr
    assert json.loads((home / "sepv-report" / "laws.json").read_text())["counts"]["holds"] >= 2
    file = home / project.file
    text = file.read_text(encoding="utf-8")
    assert text.count(project.right) == 1
    file.write_text(text.replace(project.right, project.wrong), encoding="utf-8")
    # Of the workflow's laws the one that sees it soonest.
    red = ran(home, arguments=f"--law {project.law}")
    assert red.returncode == 1, red.stdout + red.stderr
    assert "not found to hold" in red.stdout
