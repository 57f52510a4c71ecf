"""Every code block of README and of the pages under docs/ runs, and what they say of commands,
files and laws is so.
"""

import importlib.util
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

import click
import pytest
import yaml
from doors import PAGES, ROOT, Reader, block_in, doc, shape
from doors import blocks as blocks_in

from benchmarks import law_pages
from sepv.commands._cli import main
from sepv.peers.peer import ENTRY_POINTS

RUN = (
    "samplers", "rigid-bodies", "vortices", "maintainers", "ten-minutes", "teeth", "choosing", "ci", "adapting",
    "extending", "beyond", "higher-order", "hard-cases", "solvability", "speed",
)  # fmt: skip


# Pages whose blocks are run elsewhere, by what; or are output, and shown to be so.
ELSEWHERE = {
    "long-times": "",  # printed by `sepv growth`, which takes minutes
    "clusters": "test_docs.py",
    "protocol": "test_printed_numbers.py",
    "vectors": "test_reference.py",
    "deviations": "test_compliance.py",
    "integrator-deviations": "test_compliance.py",
    "integrator-rounding": "test_solvers.py",
    "trend": "test_compliance.py",
    "profiles": "test_profiles.py",
    "random-systems": "test_random_systems.py",
    "index": "test_site.py",  # the first page of the site, whose example is measured as it is built
    "api": "test_site.py",  # directives, no commands
}


def blocks(page: str, language: str | None = None) -> list[tuple[str, str]]:
    """(language, content) of each fenced block, in their order."""
    return [found for found in blocks_in(doc(f"{page}.md")) if language in (None, found[0])]


# Blocks whose command takes minutes, or is the block itself; that of docs/protocol.md is in
# test_printed_numbers.py.
SHOWN_ELSEWHERE = ("protocol", "speed")


def fewer(words: list[str]) -> list[str]:
    """The printed command with less effort."""
    _, command, *rest = words
    if command == "bench":
        rest += ["--batches", "4"]
    if command == "solvability":
        rest += shlex.split("--range 0.5 --states 4 --grid 4 --until 1 --paths 4")
    if command == "verify" and "--check-protocol" not in rest:
        rest = [word for word in rest if word != "--deep"] + shlex.split("--examples 2 --paths 64")
        # *Contract* starts processes and takes longer than all other laws; a list without it names
        # them still.
        rest = [word.removeprefix("contract,") if "," in word else word for word in rest]
        while ("--law", "contract") in pairwise(rest):
            at = rest.index("contract")
            del rest[at - 1 : at + 1]
        if "--law" not in rest:
            rest += shlex.split("--law energy --law casimir")
    return ["sepv", command, *rest]


@pytest.fixture
def hurried(reader: Reader) -> Reader:
    """Has the examples, and what the pages say is there."""
    reader.fewer = fewer
    (reader.folder / "examples").symlink_to(ROOT / "examples")
    # The reader's scheme, which the ten minutes write anew; this one takes batches.
    (reader.folder / "mine.py").write_text("from sepv.schemes._midpoint import step\n")
    (reader.folder / "mypkg").mkdir()
    (reader.folder / "mypkg" / "__init__.py").touch()
    (reader.folder / "mypkg" / "scheme.py").write_text("from sepv.schemes._midpoint import step as scheme\n")
    return reader


# Of other people, and large: their blocks run where they are installed.
LIBRARIES = ("jax", "torch")


def lacks_a_library(body: str) -> bool:
    """Whether a block imports one of `LIBRARIES` that is not installed."""
    asked = set(re.findall(r"^(?:import|from) (\w+)", body, flags=re.MULTILINE))
    return any(importlib.util.find_spec(name) is None for name in asked.intersection(LIBRARIES))


@pytest.mark.parametrize("page", [page for page in RUN if page != "ci"])
def test_the_blocks_of_a_page_run_in_their_order(page: str, hurried: Reader) -> None:
    assert run_blocks(page, hurried) > 0


def run_blocks(page: str, reader: Reader) -> int:
    """Each must end well; how many of Python, shell and TOML there are."""
    left_out, printed = set[str](), ""
    for kind, body in blocks(page):
        if kind == "python":
            name = re.match(r"# (\w+\.py)\n", body)
            if lacks_a_library(body):
                left_out.add(name[1].removesuffix(".py") if name else "")
                continue
            if name:
                (reader.folder / name[1]).write_text(body, encoding="utf-8")
            shown = reader.python(body)
            assert name or shown, f"a block of {page} shows nothing"
        elif kind == "sh":
            if "cc " in body and shutil.which("cc") is None:
                continue
            if any(f"{module}:" in body for module in left_out):
                continue
            printed += "".join(typed(line, reader) for line in body.splitlines())
        elif kind == "toml":
            points = tomllib.loads(body).get("project", {}).get("entry-points")
            if points is None:
                check_pyproject(body, reader)
            else:
                assert set(points) == {ENTRY_POINTS}
        elif kind == "text" and page not in SHOWN_ELSEWHERE:
            there = {shape(line) for line in printed.splitlines()}
            missing = [line for line in body.splitlines() if line != "…" and shape(line) not in there]
            assert not missing, f"{page} shows what is not printed: {missing}"
        else:
            assert kind in ("text", "yaml"), f"{page}: nothing runs a {kind} block"
    return sum(kind in ("python", "sh", "toml") for kind, _ in blocks(page))


def typed(line: str, reader: Reader) -> str:
    """Run a line for a shell; what sepv prints. What would be installed is here already,
    and is written down.
    """
    tool, *words = shlex.split(line)
    if tool == "pip":
        with (reader.folder / "installed").open("a") as file:
            file.write(os.path.expandvars(" ".join(words)) + "\n")
    elif tool == "pytest":
        reader.pytest(*words, "--sepv-examples", "2")
    elif tool == "cc":
        subprocess.run([tool, *words], cwd=reader.folder, check=True)
    else:
        reader.sepv(line)
        return reader.stdout
    return ""


def check_pyproject(body: str, reader: Reader) -> None:
    """A pyproject.toml makes pytest run laws beside a test of the reader's own."""
    project = reader.folder / "project"
    project.mkdir()
    shutil.copytree(reader.folder / "mypkg", project / "mypkg")
    (project / "pyproject.toml").write_text(body, encoding="utf-8")
    (project / "test_own.py").write_text("def test_own(): pass\n")
    with pytest.MonkeyPatch.context() as there:
        there.chdir(project)
        few = "(own or test_casimir or test_identity) and not drift"
        shown = reader.pytest("-k", few, "--sepv-examples", "2")
    assert "1 passed, 2 skipped" in shown


def steps_of(workflow: str) -> list[tuple[str, str]]:
    """(job, command) of each step of a workflow of either kind, in its order."""
    found, job = [], ""
    for line in workflow.splitlines():
        heading = re.match(r"(?:  )?([a-z]+):$", line)
        job = heading[1] if heading and heading[1] not in ("jobs", "script") else job
        step = re.match(r"\s+- (?:run: )?((?:pip|sepv|pytest) .*)", line)
        if step:
            found.append((job, re.sub(r"\$\{\{ github.run_number \}\}|\$CI_PIPELINE_IID", "7", step[1])))
    return found


def test_the_blocks_of_the_page_about_ci_and_the_steps_of_its_workflows_run(hurried, monkeypatch):
    """As a runner does, job by job, in a folder with the files that the page says to commit."""
    monkeypatch.setenv("SEPV", str(ROOT))
    assert run_blocks("ci", hurried) > 0
    workflows = [body for _, body in blocks("ci", "yaml")]
    assert all(isinstance(yaml.safe_load(workflow), dict) for workflow in workflows)
    jobs = [steps_of(workflow) for workflow in workflows]
    assert [len(steps) for steps in jobs] == [3, 1, 0, 2]
    # Each once; what another does with more options is not done twice.
    commands = list(dict.fromkeys(command for steps in jobs for _, command in steps))
    for command in commands:
        assert "${{" not in command
        words = set(command.split())
        # Another checkout is measured by tests/studies/test_bench.py.
        if "--against-ref" in words or ("sepv" in words and any(words < set(c.split()) for c in commands)):
            continue
        typed(command + (" -k identity" if command.startswith("pytest") else ""), hurried)
    installed = (hurried.folder / "installed").read_text().splitlines()
    assert set(installed) == {"install .", f"install . {ROOT}"}


def test_every_page_with_a_block_is_run() -> None:
    fenced = {p.stem for p in (ROOT / "docs").glob("*.md") if "```" in p.read_text(encoding="utf-8")}
    assert fenced == {*RUN, *ELSEWHERE}
    for page, file in ELSEWHERE.items():
        if file:
            (test,) = (ROOT / "tests").rglob(file)
            assert page in test.read_text(encoding="utf-8")


def test_the_vector_that_is_shown_is_one() -> None:
    (block,) = blocks("vectors", "json")
    fields = set(re.findall(r'"(\w+)":', block[1])) - {"name", "parameters", "inertia", "noise"}
    file = ROOT / "reference" / "vectors" / "energy-preserving.json"
    one = next(v for v in json.loads(file.read_text())["cases"] if v["id"] == "energy-preserving/paper-07")
    assert fields <= set(one)


def commands() -> list[tuple[str, str]]:
    """Every command line of ours in README and docs, whatever block or sentence it stands in."""
    found = []
    for page in PAGES:
        content = page.read_text(encoding="utf-8")
        fenced = "\n".join(re.findall(r"^```(?:sh|yaml|text)\n(.*?)^```$", content, re.MULTILINE | re.DOTALL))
        spoken = re.findall(r"`(sepv [a-z]+ [^`…]*)`", content)
        printed = re.findall(r"^(?:\s*(?:- )?(?:run: )?)(sepv [a-z].*)$", fenced, flags=re.MULTILINE)
        lines = (line for line in (*printed, *spoken) if "…" not in line)
        found += [(page.stem, line.split("  #")[0].split(" || ")[0].strip()) for line in lines]
    return found


@pytest.mark.parametrize(("page", "line"), commands())
def test_every_command_that_is_shown_can_be_parsed(page: str, line: str) -> None:
    """Options that do not exist, in a workflow file or in a sentence, are found here;
    nothing is run.
    """
    line = re.sub(r"\$\{\{.*?\}\}|\$\w+", "7", line)
    _, name, *arguments = shlex.split(line)
    command = main.get_command(click.Context(main), name)
    assert command, line
    # Files that a reader would have need not be here.
    for parameter in command.params:
        if isinstance(parameter.type, click.Path):
            parameter.type.exists = False
    command.make_context(name, arguments)


def test_pages_of_laws_have_the_data_of_their_records_and_all_parts() -> None:
    laws = law_pages.with_pages()
    assert {p.stem for p in (ROOT / "docs" / "laws").glob("*.md")} == {law.name for law in laws}
    for law in laws:
        shown = law_pages.page_of(law).read_text(encoding="utf-8")
        assert shown == law_pages.page(law, shown), "python -m benchmarks.law_pages"
        parts = re.findall(rf"^\*\*({'|'.join(law_pages.PAGE_PARTS)})\b", shown, re.MULTILINE)
        assert parts == [p for p in law_pages.PAGE_PARTS if p in parts or p not in law_pages.OPTIONAL]
    listed = re.findall(r"^- \[([\w-]+)\]\(laws/\1\.md\): \S", doc("laws.md"), re.MULTILINE)
    assert sorted(listed) == sorted(law.name for law in laws)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text(encoding="utf-8")):
        assert "://" in target or (page.parent / target).exists(), target


README = (ROOT / "README.md").read_text()


def test_shell_blocks_run(reader: Reader) -> None:
    """The setup and the test command are what brought us here; the others run with less effort."""
    (reader.folder / "mine.py").write_text(block_in(README, "python"))
    shell = [line for kind, block in blocks_in(README) if kind == "sh" for line in block.splitlines()]
    lines = [line for line in shell if line.startswith("sepv ")]
    assert lines
    for line in lines:
        few = "--examples 2 --paths 64 --shrink-checks 10" + ("" if "--law" in line else " --law energy")
        command, remark = line.partition("  #")[::2]
        assert "holds" in reader.sepv(f"{command} {few}  #{remark}")


def printed(output: str) -> set[str]:
    """The lines of an output, and each without its numbers."""
    lines = [" ".join(line.split()) for line in output.splitlines()]
    return {*lines, *map(shape, lines)}


def test_every_output_that_is_shown_is_printed(reader: Reader) -> None:
    """Each text block stands after its command; its case is compared digit by digit,
    other lines but for numbers.
    """
    (reader.folder / "mine.py").write_text(block_in(README, "python"))
    command, shown = "", list[tuple[str, str]]()
    for kind, block in blocks_in(README):
        if kind == "text":
            shown.append((command, block))
        elif kind == "sh":
            # The two lines of a fresh machine end in a command: of the tests, or of sepv.
            last = block.strip().rpartition(" && ")[2].removeprefix(".venv/bin/")
            command = last if last.startswith("sepv ") else command
    assert len(shown) == 2
    for command, block in shown:
        reader.sepv(command)
        there = printed(reader.stdout)
        for line in map(str.strip, block.splitlines()):
            exactly = line.startswith(("H(y) =", "B12(y) =", "y =", "h ="))
            asked = " ".join(line.split())
            assert set(line) <= set("…─") or (asked if exactly else shape(asked)) in there, (command, line)


def test_every_block_of_the_readme_is_of_a_kind_that_is_run_or_compared() -> None:
    kinds = re.findall(r"^```(\w*)$", README, flags=re.MULTILINE)[::2]
    assert set(kinds) == {"sh", "python", "text"}
    ours = ("sepv verify ", "python3 -m venv .venv && .venv/bin/pip install ")
    for block in (body for kind, body in blocks_in(README) if kind == "sh"):
        assert all(line.startswith(ours) for line in block.splitlines()), block


BLOCKS = [body for kind, body in blocks_in(doc("clusters.md")) if kind == "python"]
ENGINES = ("distributed", "joblib", "ray")
NEEDS = [
    next((name for name in ENGINES if re.search(rf"^(import|from) {name}\b", b, re.MULTILINE)), "zarr")
    for b in BLOCKS
]


def ran(number: int, folder: Path) -> str:
    if find_spec(NEEDS[number]) is None:
        pytest.skip(f"{NEEDS[number]} is not installed")
    (folder / "block.py").write_text(BLOCKS[number], encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "block.py"], cwd=folder, env=os.environ | {"PYTHONWARNINGS": "error"}, capture_output=True,
        text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_engine_of_the_page_has_a_block() -> None:
    assert NEEDS == ["distributed", "joblib", "ray", "zarr"]


# Dask itself is asked in test_clusters.py. Its block and that of ray start clusters of processes,
# which take long.
@pytest.mark.parametrize(
    "number", [pytest.param(0, marks=pytest.mark.deep), 1, pytest.param(2, marks=pytest.mark.deep)]
)
def test_a_block_runs(number: int, tmp_path: Path) -> None:
    assert ("(2, 20000) 0" if NEEDS[number] == "ray" else "(2, 20000)") in ran(number, tmp_path)


def test_the_block_that_keeps_paths_on_disk_runs(reader: Reader) -> None:
    pytest.importorskip("zarr", reason="zarr is not installed")
    reader.python(BLOCKS[NEEDS.index("zarr")])
    assert (reader.folder / "paths.zarr").is_dir()
