"""The projects of examples/ci: each is built, and the step of its workflow run as the action runs it, green and red.

What a workflow does beside the action (checkout, interpreters, `pip install .`) is the runner's; here the folder is on
the path instead. Everything else is taken from the workflow's own file.
"""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
PROJECTS = ROOT / "examples" / "ci"


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


def test_every_folder_is_tested_and_listed() -> None:
    folders = {p.name for p in PROJECTS.iterdir() if p.is_dir()}
    assert folders == {project.folder for project in ALL}
    text = (PROJECTS / "README.md").read_text(encoding="utf-8")
    assert all(f"[{name}]({name})" in text for name in folders)


def action_step(home: Path, inputs: dict[str, Any]) -> subprocess.CompletedProcess[str]:
    """The action's own shell in a folder, with inputs as a workflow gives them."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "PYTHONPATH": str(home)}
    action = yaml.safe_load((ROOT / "action.yml").read_text(encoding="utf-8"))
    assert set(inputs) <= set(action["inputs"])
    values = {name: str(inputs.get(name, about["default"])) for name, about in action["inputs"].items()}
    step = action["runs"]["steps"][1]
    for key, text in step["env"].items():
        environment[key] = values[text.removeprefix("${{ inputs.").removesuffix(" }}")]
    return subprocess.run(
        ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"]],
        cwd=home, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip


def test_every_line_of_the_arguments_counts(tmp_path: Path) -> None:
    """As `arguments: |` gives them: a claim in the second line must not be lost, and * is no pattern."""
    (tmp_path / "laws.json").touch()
    lost = action_step(tmp_path, {"target": "midpoint", "arguments": "--law energy\n--claim energy\n"})
    assert lost.returncode == 1, lost.stdout + lost.stderr
    assert "Claimed and not found to hold: energy" in lost.stdout
    starred = action_step(tmp_path, {"target": "midpoint", "arguments": "--law *"})
    assert starred.returncode == 2
    assert "'*'" in starred.stderr


def ran(project: Project, home: Path, **changes: str) -> subprocess.CompletedProcess[str]:
    """The workflow's own commands, then the action's step with the workflow's inputs, but for what is changed."""
    workflow = yaml.safe_load((home / ".github" / "workflows" / "laws.yml").read_text(encoding="utf-8"))
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "PYTHONPATH": str(home)}
    inputs: dict[str, Any] = {}
    for step in workflow["jobs"]["verify"]["steps"]:
        if "run" in step and not step["run"].startswith("pip install"):
            subprocess.run(step["run"], shell=True, cwd=home, env=environment, check=True)
        if step.get("uses", "").startswith("OWNER/sepv@"):
            inputs = step["with"] | changes
    return action_step(home, inputs)


# One program over `--exec`, that in C++, is run each time.
@pytest.mark.parametrize(
    "project",
    [
        pytest.param(project, id=project.folder, marks=[pytest.mark.deep] * (project.needs == "node"))
        for project in ALL
    ],
)
def test_a_project_is_green_and_with_a_fault_red(project: Project, tmp_path: Path) -> None:
    found = shutil.which(project.needs) or importlib.util.find_spec(project.needs.replace("c++", "cxx"))
    if not found:
        pytest.skip(f"{project.needs} is not installed")
    home = tmp_path / project.folder
    shutil.copytree(PROJECTS / project.folder, home)
    green = ran(project, home)
    assert green.returncode == 0, green.stdout + green.stderr
    assert json.loads((home / "sepv-report" / "laws.json").read_text())["counts"]["holds"] >= 2
    file = home / project.file
    text = file.read_text(encoding="utf-8")
    assert text.count(project.right) == 1
    file.write_text(text.replace(project.right, project.wrong), encoding="utf-8")
    # Of the workflow's laws the one that sees it soonest.
    red = ran(project, home, arguments=f"--law {project.law}")
    assert red.returncode == 1, red.stdout + red.stderr
    assert "not found to hold" in red.stdout
