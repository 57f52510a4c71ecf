"""The doors of sepv as tests go through them: verdicts, a command, a fresh process, a file and its schema."""

import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable
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
    """The command of a browser with a profile of its own that fetches nothing by itself; without one a skip."""
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


def command(line: str, code: int | None = 0, **environment: str) -> Result:
    """A command line as a shell splits it, in this process; it ends with this code where one is given."""
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


def ended(pids: Iterable[int], seconds: float = 20.0) -> bool:
    """None of these processes runs any more, or soon does not; one that waits to be reaped has ended."""
    left, until = {str(pid) for pid in pids}, time.monotonic() + seconds
    while left and time.monotonic() < until:
        asked = ["ps", "-o", "pid=,stat=", "-p", ",".join(left)]
        rows = subprocess.run(asked, capture_output=True, text=True, check=False).stdout.splitlines()
        left = {pid for pid, letters in map(str.split, rows) if letters[0] not in "ZX"}
        time.sleep(0.02 * bool(left))
    return not left
