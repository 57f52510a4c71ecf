"""The doors of sepv as tests go through them: verdicts, a command, a fresh process,
a file and its schema, a reader.
"""

import contextlib
import importlib
import io
import json
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from click.testing import CliRunner, Result

from sepv.commands._cli import main
from sepv.files import schema
from sepv.verification import Effort, Finding, Report, verify

ROOT = Path(__file__).resolve().parents[1]


# Pages of prose, without the changelog, which speaks of names that are gone.
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs" / "laws").glob("*.md")),
]


def doc(name: str) -> str:
    """The text of a file in docs/."""
    return (ROOT / "docs" / name).read_text(encoding="utf-8")


def blocks(page: str) -> list[tuple[str, str]]:
    """(language, content) of each fenced block in the text of a page, in their order."""
    return re.findall(r"^```(\w+)\n(.*?)^```$", page, flags=re.MULTILINE | re.DOTALL)


def block_in(page: str, language: str, word: str = "") -> str:
    """The content of the one block in this language that has this word in it."""
    (found,) = [body for kind, body in blocks(page) if kind == language and word in body]
    return found


def but_deep(values: Iterable[Any], *deep: Any) -> list[Any]:
    """Parameters, of which these run only with ``-m deep``; the others, and what they prove,
    run each time.
    """
    rows, apart = ([v if type(v) is tuple else (v,) for v in given] for given in (values, deep))
    assert all(row in rows for row in apart), [row for row in apart if row not in rows]
    return [pytest.param(*row, marks=[pytest.mark.deep] * (row in apart)) for row in rows]


class Tags(HTMLParser):
    """Every tag of a page with its attributes."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))


def chromium(profile: Path) -> list[str]:
    """The command of a browser with a profile of its own that fetches nothing by itself;
    without one a skip.
    """
    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if found is None:
        pytest.skip("Chromium is not installed: pages are read by a parser only")
    return [
        found, "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
        "--disable-background-networking", "--disable-component-update", "--disable-sync",
        f"--user-data-dir={profile}",
    ]  # fmt: skip


def measured(scheme: Any, laws: str | Iterable[str], problems: Any = None, **effort: Any) -> Report:
    """The report of some laws with this effort."""
    return verify(scheme, laws=laws, problems=problems, effort=Effort(**effort))


def verdicts(scheme: Any, laws: str | Iterable[str], problems: Any = None, **effort: Any) -> dict[str, str]:
    """Law by law the verdict in words, in the order in which they are asked for."""
    asked = laws.split(",") if isinstance(laws, str) else list(laws)
    report = measured(scheme, asked, problems, **effort)
    return {law: report.finding(law).verdict.text for law in asked}


def finding(scheme: Any, law: str, problems: Any = None, **effort: Any) -> Finding:
    """What one law finds."""
    return measured(scheme, law, problems, **effort).finding(law)


def says(scheme: Any, law: str, verdict: str, *words: str, problems: Any = None, **effort: Any) -> Finding:
    """What one law finds: it ends in this verdict, and has these words in its message."""
    found = finding(scheme, law, problems, **effort)
    assert found.verdict.text == verdict, found.message
    assert not [word for word in words if word not in found.message], found.message
    return found


def command(line: str, code: int | None = 0, **environment: str) -> Result:
    """A command line as a shell splits it, in this process;
    it ends with this code where one is given.
    """
    done = CliRunner(env=environment).invoke(main, shlex.split(line), prog_name="sepv")
    assert code is None or done.exit_code == code, f"{line}: {done.exit_code}\n{done.output}"
    return done


def python(code: str, *words: str, folder: Path | None = None) -> str:
    """What a program prints in a process of its own, which ends well."""
    done = subprocess.run(
        [sys.executable, "-c", code, *words], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout.strip()


def obeys(data: Any, name: str, *spoilt: dict[str, Any]) -> None:
    """A result is as its schema says, and with each of these members it is not."""
    jsonschema.validate(data, schema(name))
    for change in spoilt:
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(data | change, schema(name))


def written(line: str, file: Path, name: str, *spoilt: dict[str, Any], **environment: str) -> tuple[str, Any]:
    """What a command prints, and the result that it writes, which is as its schema says."""
    shown = command(f"{line} --json {file}", **environment).output
    data = json.loads(file.read_text(encoding="utf-8"))
    obeys(data, name, *spoilt)
    return shown, data


def ended(pids: Iterable[int], seconds: float = 20.0) -> bool:
    """None of these processes runs any more, or soon does not;
    one that waits to be reaped has ended.
    """
    left, until = {str(pid) for pid in pids}, time.monotonic() + seconds
    while left and time.monotonic() < until:
        asked = ["ps", "-o", "pid=,stat=", "-p", ",".join(left)]
        rows = subprocess.run(asked, capture_output=True, text=True, check=False).stdout.splitlines()
        left = {pid for pid, letters in map(str.split, rows) if letters[0] not in "ZX"}
        time.sleep(0.02 * bool(left))
    return not left


def shape(line: str) -> str:
    """A line without its numbers and its token: what stays when a design draws another case."""
    line = re.sub(r"--replay \S+", "--replay TOKEN", line)
    line = re.sub(r"(?<![A-Za-z\d.])-?\d+(\.\d+)?(e[+-]?\d+)?(?![\d.]|th)", "#", line)
    return " ".join(line.split())


class Reader:
    """Commands and Python of a document, run in this process, which has imported everything.

    Each process of its own would take a second to start. What a process does as it starts and ends
    is asked in test_terminal.py and test_words_of_findings.py.
    """

    def __init__(self, folder: Path, fewer: Callable[[list[str]], list[str]] = list) -> None:
        self.folder, self.fewer = folder, fewer
        self.stdout = ""  # of the last command, without the progress on stderr

    def python(self, code: str) -> str:
        """What the program prints. Warnings are errors, as everywhere in these tests."""
        printed = io.StringIO()
        with self._fresh(), contextlib.redirect_stdout(printed):
            exec(compile(code, "<document>", "exec"), {"__name__": "__main__"})
        return printed.getvalue()

    def sepv(self, line: str) -> str:
        """What a line ``sepv …`` prints; it must end well,
        but for one that says ``|| true`` or ``# red``.
        """
        words = shlex.split(line, comments=True)
        may_fail = words[-2:] == ["||", "true"]
        words = self.fewer(words[: -2 if may_fail else None])
        assert words[0] == "sepv"
        assert not set("".join(words)) & set("|&;<>$`"), f"for a shell: {line}"
        with self._fresh():
            done = CliRunner(env={"COLUMNS": "100"}).invoke(main, words[1:], prog_name="sepv")
        expected = (0, 1) if may_fail else (1,) if "# red" in line else (0,)
        assert done.exit_code in expected, f"{line}\n{done.output}"
        self.stdout = done.stdout
        return done.output

    def pytest(self, *words: str, code: int = 0) -> str:
        """What pytest prints, which ends with this code."""
        printed = io.StringIO()
        with self._fresh(), contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
            # The handler of faults belongs to the run that we are in.
            ended = pytest.main(["-p", "no:cacheprovider", "-p", "no:faulthandler", *words])
        assert ended == code, printed.getvalue()
        return printed.getvalue()

    @contextlib.contextmanager
    def _fresh(self) -> Iterator[None]:
        """Modules of the folder are read anew, whatever other tests have left behind of the same
        names.
        """
        importlib.invalidate_caches()
        self._forget()
        before = sys.path[:]
        try:
            yield
        finally:
            sys.path[:] = before
            self._forget()

    def _forget(self) -> None:
        own = {p.stem for p in self.folder.iterdir() if p.suffix == ".py" or (p / "__init__.py").exists()}
        for name in [name for name in sys.modules if name.partition(".")[0] in own]:
            del sys.modules[name]
