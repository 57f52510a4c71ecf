"""What documents show is typed by a reader, in a folder of their own."""

import contextlib
import importlib
import io
import re
import shlex
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

from sepv.commands._cli import main


def shape(line: str) -> str:
    """A line without its numbers and its token: what stays when a design draws another case."""
    line = re.sub(r"--replay \S+", "--replay TOKEN", line)
    line = re.sub(r"(?<![A-Za-z\d.])-?\d+(\.\d+)?(e[+-]?\d+)?(?![\d.]|th)", "#", line)
    return " ".join(line.split())


class Reader:
    """Commands and Python of a document, run in this process, which has imported everything.

    Each process of its own would take a second to start. What a process does as it starts and ends is asked in
    test_terminal.py and test_progress.py.
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
        """What a line ``sepv …`` prints; it must end well, but for one that says ``|| true`` or ``# red``."""
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
        """Modules of the folder are read anew, whatever other tests have left behind of the same names."""
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
