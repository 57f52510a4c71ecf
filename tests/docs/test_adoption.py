"""What other repositories use of this one: the action, the projects of examples/ci, the hook,
the form, the citation.

Each project is built, and the step of its workflow run as the action runs it, green and red. What a
workflow does beside the action (checkout, interpreters, `pip install .`) is the runner's; here the
folder is on the path instead. And a checkout works where it stands: the sdist carries all that the
tests read, and each paper has a source.
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
from doors import PAGES, ROOT, doc, python

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
    asked = {key: text.removeprefix("${{ inputs.").removesuffix(" }}") for key, text in step["env"].items()}
    own = {key: values[name] for key, name in asked.items()}
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
    ({"target": "--exec=touch run"}, 2, "expected target: a name that does not begin with -"),
    ({"target": "midpoint", "folder": "-rf"}, 2, "expected folder: a name that does not begin with -"),
])  # fmt: skip
def test_the_action_says_what_is_wrong(tmp_path: Path, inputs: dict[str, str], code: int, words: str) -> None:
    (tmp_path / "laws.json").touch()
    done = act(tmp_path, **inputs)
    assert done.returncode == code, done.stdout + done.stderr
    assert words in done.stdout + done.stderr
    assert not (tmp_path / "run").exists()


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
    """A folder, the tool that it needs, a fault (text of a file, and what is put in its place),
    a law that sees it.
    """

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
    """The workflow's own commands, then the action's step with the workflow's inputs,
    but for what is changed.
    """
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


# An editable installation maps sepv.properties and sepv.reference; here nothing does.
BARE = "import sys; sys.meta_path = [f for f in sys.meta_path if 'editable' not in str(f).lower()]; "


@pytest.mark.parametrize("name", ["sepv.reference", "sepv.properties", "sepv.reference.witnesses"])
def test_the_folders_at_the_top_are_found_from_a_bare_checkout(name: str) -> None:
    asked = f"{BARE}sys.path.insert(0, {str(ROOT)!r}); import {name}; print(*{name}.__path__)"
    assert Path(python(asked)) == ROOT.joinpath(*name.split(".")[1:])


def test_the_sdist_carries_every_folder_of_the_checkout() -> None:
    """setuptools adds the packages alone; the tests read pages, examples and records beside
    them.
    """
    manifest = (ROOT / "MANIFEST.in").read_text(encoding="utf-8").splitlines()
    grafted = {line.removeprefix("graft ") for line in manifest if line.startswith("graft ")}
    made_here = {line.strip("/") for line in (ROOT / ".gitignore").read_text(encoding="utf-8").splitlines()}
    folders = {p.name for p in ROOT.iterdir() if p.is_dir() and p.name not in (".git", "sepv", *made_here)}
    assert {f for f in folders if not f.endswith(".egg-info")} == grafted


SOURCES = doc("sources.md")
NAME = r"(?:[A-Z]\. )?[A-Z][a-zé]+"
# "Cohen and Hairer (2011)", "D. Cohen and G. Vilmart, … 2022": names, and a year within the next
# words.
CITED = re.compile(rf"({NAME}(?:, {NAME})*,? and {NAME}|{NAME}) \(?((?:19|20)\d\d)\b")


def cited(text: str) -> set[tuple[str, str]]:
    """Last names and years."""
    found = set()
    for names, year in CITED.findall(text):
        found |= {(name, year) for name in re.findall(r"[A-Z][a-zé]+", names)}
    return found


def test_citations_are_recognised() -> None:
    assert cited("as (Ge and Marsden 1988) say") == {("Ge", "1988"), ("Marsden", "1988")}
    assert cited("Cohen and Hairer (2011) and Pébay 2008") == {
        ("Cohen", "2011"), ("Hairer", "2011"), ("Pébay", "2008"),
    }  # fmt: skip


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_every_work_that_a_page_names_is_listed_with_what_was_read(page: Path) -> None:
    rows = [row for row in SOURCES.splitlines() if row.startswith("- ")]
    for name, year in cited(page.read_text("utf-8")):
        assert name in ("November",) or any(name in row and year in row for row in rows), f"{name} {year}"
    for number in re.findall(r"arXiv:? ?(\d{4}\.\d{4,5})", page.read_text("utf-8")):
        assert any(number in row for row in rows), number


def test_every_library_is_listed() -> None:
    libraries = [folder.name for folder in (ROOT / "results").iterdir() if folder.is_dir()]
    assert libraries
    assert all(re.search(rf"^- {library} \d", SOURCES, re.MULTILINE) for library in libraries)
