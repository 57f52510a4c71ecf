"""Terminal manners: colour on terminals only, tables that fit, plain lines in pipes, completion, examples in help."""

from __future__ import annotations

import io
import os
import pty
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import click
import pytest
from click.testing import CliRunner
from rich.cells import cell_len
from sepv.reference.faults import detection as fault_detection

from sepv.commands._cli import COMMANDS, main
from sepv.console import console, print_table
from sepv.studies._bench import store
from sepv.studies._bench.store import record_table
from sepv.verification import LAWS, Verdict

ROOT = Path(__file__).resolve().parents[2]

ESCAPES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
VERIFY = ["verify", "midpoint", "--law", "energy", "--law", "truncation", "--law", "local-mean-square"]
CHEAP = ["--examples", "2", "--paths", "64", "--shrink-checks", "5"]


def on_a_terminal(arguments: list[str], **variables: str) -> str:
    """What a terminal of 80 columns would show."""
    ours, theirs = pty.openpty()
    environment = os.environ | {"TERM": "xterm-256color", "COLUMNS": "80", "LINES": "40"} | variables
    with subprocess.Popen(
        [sys.executable, "-m", "sepv", *arguments],
        stdout=theirs,
        stderr=theirs,
        stdin=theirs,
        env=environment,
    ) as process:
        os.close(theirs)
        shown = b""
        while True:
            try:
                part = os.read(ours, 65536)
            except OSError:  # the other side is closed
                break
            if not part:
                break
            shown += part
        process.wait(120)
    os.close(ours)
    return shown.decode()


@pytest.fixture(scope="module")
def shown() -> str:
    return on_a_terminal([*VERIFY, *CHEAP])


def test_a_terminal_has_colour_and_tables_of_80_columns(shown: str) -> None:
    assert "\x1b[" in shown
    lines = ESCAPES.sub("", shown).replace("\r", "\n").splitlines()
    for line in lines:
        # The command that replays is one line, however long: it is there to be copied.
        assert cell_len(line) <= 80 or "--replay" in line, line
    assert any("local-mean-square " in line for line in lines)


def test_no_colour_where_it_is_not_wanted() -> None:
    plain = on_a_terminal(["list"], NO_COLOR="1")
    assert not re.search(r"\x1b\[[0-9;]*(3[0-7]|9[0-7])m", plain)
    lines = [cell_len(line) for line in ESCAPES.sub("", plain).replace("\r", "").splitlines()]
    assert max(lines) <= 80


def test_a_pipe_gets_plain_lines() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "sepv", *VERIFY, *CHEAP, "--quiet"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert "\x1b" not in done.stdout + done.stderr
    assert len(done.stdout.splitlines()) == 1
    assert done.stdout.startswith("3 laws: ")


def test_tables_of_80_columns_hide_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wide tables: the counters of every scheme, the hard cases, saboteurs by laws."""
    monkeypatch.setenv("COLUMNS", "80")
    text = io.StringIO()
    out = console(text)
    for record in store.load(str(ROOT / "benchmarks" / "counters.json")):
        print_table(record_table(record), out)
    detect = fault_detection.Detection(
        "one-point-quadrature", "formula", "energy", 0, Verdict.VIOLATED, True, True, 5, 0.1
    )
    fault_detection.show([replace(detect, law=law) for law in LAWS], out)
    hard = CliRunner().invoke(main, ["hard", "--steps", "2", "--laws", "0"]).output
    shown = text.getvalue() + hard[: hard.index("27 cases")]  # the last line is one line for who reads a pipe
    assert "…" not in shown
    assert "kepler-0.99*" in shown
    assert "right-limit 5" in shown
    assert max(map(cell_len, shown.splitlines())) <= 80


@pytest.mark.parametrize(
    "arguments",
    ["hard --case rank-0 --steps 5", "run energy-preserving --steps 100", "bench midpoint --case rigid-body"],
)
def test_quiet_is_one_line(arguments: str) -> None:
    result = CliRunner().invoke(main, [*arguments.split(), "--quiet"])
    assert result.exit_code == 0, result.output
    assert len(result.output.splitlines()) == 1


@pytest.mark.parametrize("name", COMMANDS)
def test_every_help_fits_and_has_an_example(name: str) -> None:
    text = CliRunner().invoke(main, [name, "--help"], terminal_width=80).output
    assert max(map(cell_len, text.splitlines())) <= 80
    assert re.search(rf"\n  sepv {name}\b", text)


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_scripts(shell: str, tmp_path: Path) -> None:
    script = CliRunner().invoke(main, ["completion", shell])
    assert script.exit_code == 0
    assert f"_SEPV_COMPLETE={shell}_complete" in script.output
    if shell == "bash":
        (tmp_path / "script").write_text(script.output)
        assert subprocess.run(["bash", "-n", str(tmp_path / "script")], check=False).returncode == 0


def test_schemes_and_laws_are_completed() -> None:
    from click.shell_completion import ShellComplete

    complete = ShellComplete(main, {}, "sepv", "_SEPV_COMPLETE")

    def offers(arguments: list[str], incomplete: str) -> list[str]:
        return [item.value for item in complete.get_completions(arguments, incomplete)]

    assert offers(["verify"], "energy") == ["energy-preserving"]
    assert offers(["verify", "--law"], "mean") == ["mean-square-order"]
    assert "reproduce" in offers([], "re")
    assert isinstance(main, click.Group)
