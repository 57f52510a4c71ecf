"""Terminal manners: colour, narrow tables that lose no digit, plain pipes, help with examples,
ASCII where needed.
"""

import contextlib
import doctest
import importlib
import inspect
import io
import os
import pty
import re
import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from doors import ROOT, command
from rich.cells import cell_len
from rich.console import Console

import sepv
from sepv.commands._cli import COMMANDS, main
from sepv.commands._watch import EXIT_DEFECT
from sepv.console import Table, ascii_text, columns, console, kept, print_table
from sepv.faults import detection as fault_detection
from sepv.schemes import midpoint
from sepv.studies._bench import store
from sepv.studies._bench.store import record_table
from sepv.verification import LAWS, Effort, Finding, Report, Verdict
from sepv.verification._report import law_table

ESCAPES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
VERIFY = "verify midpoint --law energy,truncation,local-mean-square --examples 2 --paths 64 --shrink-checks 5"


def a_process(line: str) -> list[str]:
    return [sys.executable, "-m", "sepv", *line.split()]


def on_a_terminal(line: str, **variables: str) -> str:
    """What a terminal of 80 columns would show."""
    ours, theirs = pty.openpty()
    environment = os.environ | {"TERM": "xterm-256color", "COLUMNS": "80", "LINES": "40"} | variables
    streams = dict.fromkeys(("stdin", "stdout", "stderr"), theirs)
    with subprocess.Popen(a_process(line), **streams, env=environment) as process:
        os.close(theirs)
        shown = b""
        with contextlib.suppress(OSError):  # the other side is closed
            while part := os.read(ours, 65536):
                shown += part
        process.wait(120)
    os.close(ours)
    return shown.decode()


def test_a_terminal_has_colour_and_tables_of_80_columns() -> None:
    shown = on_a_terminal(VERIFY)
    assert "\x1b[" in shown
    lines = ESCAPES.sub("", shown).replace("\r", "\n").splitlines()
    for line in lines:
        # The command that replays is one line, however long: it is there to be copied.
        assert cell_len(line) <= 80 or "--replay" in line, line
    assert any("local-mean-square " in line for line in lines)


def test_no_colour_where_it_is_not_wanted() -> None:
    plain = on_a_terminal("list", NO_COLOR="1")
    assert not re.search(r"\x1b\[[0-9;]*(3[0-7]|9[0-7])m", plain)
    lines = [cell_len(line) for line in ESCAPES.sub("", plain).replace("\r", "").splitlines()]
    assert max(lines) <= 80


def test_a_pipe_gets_plain_lines() -> None:
    done = subprocess.run(a_process(f"{VERIFY} --quiet"), capture_output=True, text=True, check=False)
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
    told = ("one-point-quadrature", "formula", "energy", 0, Verdict.VIOLATED, True, True, 5, 0.1)
    detect = fault_detection.Detection(*told)
    fault_detection.show([replace(detect, law=law) for law in LAWS], out)
    hard = command("hard --steps 2 --laws 0").output
    shown = text.getvalue() + hard[: hard.index("27 cases")]  # the last line is one line for who reads a pipe
    assert "…" not in shown
    assert "kepler-0.99*" in shown
    assert "right-limit 5" in shown
    assert max(map(cell_len, shown.splitlines())) <= 80


@pytest.mark.parametrize(
    "line", ["hard --case rank-0 --steps 5", "run midpoint --steps 100", "bench midpoint"]
)
def test_quiet_is_one_line(line: str) -> None:
    assert len(command(f"{line} --quiet").output.splitlines()) == 1


@pytest.mark.parametrize("name", COMMANDS)
def test_every_help_fits_and_has_an_example(name: str) -> None:
    text = command(f"{name} --help", COLUMNS="80").output
    assert max(map(cell_len, text.splitlines())) <= 80
    assert re.search(rf"\n  sepv {name}\b", text)
    # One word for a file, one for a folder, and a name for what an option takes.
    assert not re.search(r"--[\w-]+ (PATH|DIRECTORY|FILENAME)\b", text)
    assert not re.search(r"--(problem|scheme|h) TEXT\b", text)


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_scripts(shell: str, tmp_path: Path) -> None:
    script = command(f"completion {shell}").output
    assert f"_SEPV_COMPLETE={shell}_complete" in script
    if shell == "bash":
        (tmp_path / "script").write_text(script)
        assert subprocess.run(["bash", "-n", str(tmp_path / "script")], check=False).returncode == 0


def test_schemes_and_laws_are_completed() -> None:
    from click.shell_completion import ShellComplete

    complete = ShellComplete(main, {}, "sepv", "_SEPV_COMPLETE")

    def offers(arguments: list[str], incomplete: str) -> list[str]:
        return [item.value for item in complete.get_completions(arguments, incomplete)]

    assert offers(["verify"], "energy") == ["energy-preserving"]
    assert offers(["verify", "--law"], "mean") == ["mean-square-order"]
    assert "reproduce" in offers([], "re")


@pytest.mark.parametrize("encoding", ["ascii", "cp1252"])
def test_a_report_is_printed_in_any_encoding(encoding: str) -> None:
    line = a_process("verify midpoint --law truncation,identity --examples 5")
    variables = os.environ | {"PYTHONIOENCODING": encoding}
    done = subprocess.run(line, env=variables, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    shown = done.stdout.decode("ascii")
    assert "<= 0" in shown
    assert "2 laws: 2 hold;" in shown


PRINTED = "import sepv; print(sepv.verify('midpoint', laws='identity', effort=sepv.Effort(examples=2)))"


@pytest.mark.parametrize("line", [["-m", "sepv", "--help"], ["-c", PRINTED]])
def test_a_page_of_windows_is_enough_for_help_and_reports(line: list[str]) -> None:
    variables = os.environ | {"PYTHONIOENCODING": "cp1252"}
    done = subprocess.run([sys.executable, *line], env=variables, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "sepv" in done.stdout.decode("cp1252") or "identity" in done.stdout.decode("cp1252")


def test_colours_that_are_asked_for_in_a_file_bring_no_moves_of_the_cursor() -> None:
    variables = os.environ | {"FORCE_COLOR": "1"}
    done = subprocess.run(
        a_process("verify midpoint --law identity,energy,casimir"), env=variables, capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    assert "\x1b[1m" in done.stdout
    assert "\r" not in done.stdout + done.stderr
    assert set(re.findall(r"\x1b\[[\d;?]*(.)", done.stdout + done.stderr)) == {"m"}


def test_texts_read_the_same_in_ascii() -> None:
    shown = "|Delta| <= 1/2*sqrt n, grad H >= 2^-4, naive \\u2603"
    assert ascii_text("|Δ| ≤ ½·√n, ∇H ≥ 2⁻⁴, naïve ☃") == shown


def test_a_defect_of_our_own_is_no_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise TypeError("a defect")

    monkeypatch.setattr("sepv.verification._report.summary", broken)
    assert EXIT_DEFECT == 70
    shown = command("verify midpoint --law truncation", EXIT_DEFECT).output
    assert "a defect of sepv itself, and no verdict: TypeError: a defect" in shown


def test_a_reader_that_goes_away_is_no_verdict() -> None:
    line = f"{sys.executable} -m sepv hard --explain | true; echo ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "141", done.stderr
    assert "Traceback" not in done.stderr


FUNCTIONS = ("verify", "integrate", "ensemble", "exact_flow")
RECORDS = ("Problem", "Scheme", "Report", "Trajectory", "Ensemble", "Effort")
WITH_EXAMPLES = ("Problem", "Scheme", "verify", "integrate", "ensemble", "exact_flow", "posing:pose",
                 "posing:field_in")  # fmt: skip


@pytest.mark.parametrize("name", [*FUNCTIONS, *RECORDS])
def test_help_names_every_argument_or_field_and_what_a_function_returns(name: str) -> None:
    asked = getattr(sepv, name)
    taken, returns, _ = (inspect.getdoc(asked) or "").partition("Returns\n-------\n")
    assert returns or name in RECORDS
    for argument in inspect.signature(asked).parameters:
        assert argument in taken.replace(",", " ").split(), argument


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_examples_run(name: str) -> None:
    module, _, attribute = name.rpartition(":")
    value = getattr(importlib.import_module(f"sepv.{module}") if module else sepv, attribute)
    found = [t for t in doctest.DocTestFinder(recurse=False).find(value, attribute) if t.examples]
    assert found, "no example"
    for example in found:
        assert doctest.DocTestRunner().run(example).failed == 0


def test_the_help_of_verify_states_the_usual_effort() -> None:
    asked = CliRunner().invoke(main, ["verify", "--help"], terminal_width=200).output
    said = dict(re.findall(r"--([a-z-]+) .*\[default: (\d+)\]", asked))
    usual = {field.name.replace("_", "-"): str(field.default) for field in fields(sepv.Effort)}
    assert all(said[name] == usual[name] for name in ("examples", "paths", "shrink-checks"))


FOUND = tuple(
    Finding(law, verdict, source, unit, law != "energy", defect, bound)
    for law, verdict, source, unit, defect, bound in (
        ("mean-square-order", Verdict.INCONCLUSIVE, "Thm 3.3, 3.4", "slope", 1.0234, 0.75),
        ("energy", Verdict.VIOLATED, "Prop. 3.1", "ulp of H", 1.234e10, 52.125),
        ("contract", Verdict.HOLDS, "contract", "faults", 0.0, 0.0),
    )
)


@pytest.mark.parametrize("width", [40, 48, 60, 72, 80, 100])
def test_a_report_fits_and_shows_whole_numbers(width: int) -> None:
    shown = io.StringIO()
    out = Console(file=shown, width=width)
    print_table(law_table(Report(midpoint, FOUND, Effort())), out)
    text = shown.getvalue()
    assert max(map(cell_len, text.splitlines())) <= width
    for word in ("mean-square-order", "inconclusive", "1.2e+10", "1.02"):
        assert word in text
    assert "…" not in text
    if width >= 80:
        for word in ("52.1", "Prop. 3.1", "ulp of H", "claimed"):
            assert word in text


def test_columns_go_in_their_order_and_only_as_far_as_they_must() -> None:
    needed = {"name": 8, "a": 4, "b": 4, "c": 4}
    assert kept(needed, 23, ("c", "a"), between=1) == ["name", "a", "b", "c"]
    assert kept(needed, 22, ("c", "a"), between=1) == ["name", "a", "b"]
    assert kept(needed, 1, ("c", "a"), between=1) == ["name", "b"]


ROWS = [("one", "Ann & Bob", "1.25e-10", "7"), ("two", "somebody else", "3", "123456")]


def shown(width: int, encoding: str = "utf-8", **more: Any) -> str:
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    numbers = columns((), ["Δ", "steps"], goes=("steps", "who"))
    heads = columns(["name"]) + columns(["who"], words=True) + numbers
    print_table(Table(heads, ROWS, **more), Console(file=stream, width=width, color_system=None))
    stream.seek(0)
    return stream.read()


def test_a_table_is_roomy_where_it_fits_and_close_where_it_does_not() -> None:
    assert "Ann & Bob      1.25e-10       7" in shown(60)
    assert "1.25e-10      7" in shown(34)
    for width in range(13, 60):
        text = shown(width)
        assert max(map(cell_len, text.splitlines())) <= width
        assert "1.25e-10" in text  # what stays is whole
        table, _, gone = text.partition("Left out")
        assert ("123456" in table) == ("steps" in table) == ("steps" not in gone)
    assert "name" not in shown(60, headed=False)


def test_a_terminal_of_ascii_measures_what_it_shows() -> None:
    text = shown(60, "ascii")
    assert "Delta" in text
    lines = [line for line in text.splitlines() if line.strip()]
    assert len({cell_len(line) for line in lines}) == 1
    shown(40, "ascii", title="h → 0", ruled=True)  # what cannot be encoded would raise


def test_a_ruled_table_has_its_line_on_a_wide_terminal_alone() -> None:
    assert "───" in shown(80, ruled=True)
    assert "───" not in shown(50, ruled=True)


# Sentences, which a terminal wraps itself.
NOTES = ("~", "2 cases", "energy-preserving:", "≤")


@pytest.mark.parametrize("width", [40, 60, 80, 120])
@pytest.mark.parametrize(
    ("words", "whole"),
    [
        ("list", "energy-preserving"),
        ("hard --steps 2 --case kepler-0.99 --case rigid-body-inertia-1e6", "rigid-body-inertia-1e6*"),
        ("bench energy-preserving --case rigid-body", "32393"),
        ("compare energy-preserving --steps 4,8 --paths 50 --repeats 3 -q", "energy-preserving"),
        ("run energy-preserving --steps 100", "steps"),
    ],
)
def test_commands_fit_and_lose_no_digit(words: str, whole: str, width: int) -> None:
    printed = command(words, COLUMNS=str(width)).stdout
    shown = [line for line in printed.splitlines() if not line.startswith(NOTES)]
    assert max(map(cell_len, shown)) <= width
    assert any(whole in line.split() for line in shown)
    # The only ellipses are those of ranges.
    assert "…" not in printed.replace(" … ", "")
