"""Scripts that show, in a library's own terms and without sepv, where it does not do what its documentation says.

A script is a file of the folder ``docs/peers``: its docstring begins with the solver, "library name", a colon and the
statement; it ends with exit code 1 while that is so, and with 0 where the library does what it says.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Shown:
    """What a script came to."""

    name: str  # of its file
    title: str  # the first line of its docstring
    body: str  # the rest, up to the exit code
    code: int  # 1: the library deviates; 0: it does not; else the script failed
    output: str
    errors: str

    @property
    def solver(self) -> str:
        """The solver that it is about."""
        return self.title.partition(":")[0]

    @property
    def deviates(self) -> bool | None:
        """Whether the library still deviates; None where the script itself failed."""
        return None if self.code not in (0, 1) or "Traceback" in self.errors else self.code == 1


def shown_by(folder: Path, library: str = "") -> Iterator[Shown]:
    """Run every script of the folder, or those about one library, each in a process of its own."""
    for script in sorted(folder.glob("*.py")):
        docstring = ast.get_docstring(ast.parse(script.read_text("utf-8"))) or script.stem
        title, _, rest = docstring.partition("\n")
        if library and title.split()[0] != library:
            continue
        done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=False)
        body = rest.split("Exit code 1")[0].strip()
        yield Shown(script.name, title, body, done.returncode, done.stdout.strip(), done.stderr)
