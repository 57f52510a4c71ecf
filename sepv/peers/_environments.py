"""A fresh virtual environment with one version of a library, and the sepv that runs now.

pip installs what is asked for, from wherever the user's pip installs. sepv itself is copied from where it runs, so that
a checkout and an installed package serve alike; what it needs, pip installs too.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.metadata import requires
from pathlib import Path

from sepv.errors import SepvError

# An address, and the name of a host: what pip says of where it looked is the user's own business.
_ADDRESS = re.compile(r"\w+://\S+|host='[^']*'")
# Asked of nobody at run time, but part of the package.
_ELSEWHERE = ("properties", "reference")


class EnvironmentFailure(SepvError, RuntimeError):
    """An environment that could not be made, or in which nothing could be measured."""

    def __init__(self, what: str, remedy: str) -> None:
        self.what, self.remedy = what, remedy
        super().__init__(f"{what}\nRemedy: {remedy}.")


def made(folder: Path, requirements: Sequence[str], python: str = sys.executable) -> str:
    """The interpreter of an environment with these requirements, made anew where the folder holds another one.

    They are as pip takes them: ``"diffrax==0.6.2"``, ``"jax<0.5"``. Where it does not install them, an
    EnvironmentFailure has its last words, but no addresses.
    """
    own = folder / "bin" / "python"
    stamp = folder / "requirements.txt"
    wanted = "\n".join((python, *requirements, *_own_requirements())) + "\n"
    if not (stamp.exists() and stamp.read_text(encoding="utf-8") == wanted):
        shutil.rmtree(folder, ignore_errors=True)
        remedy = "see what Python says of `-m venv`"
        _run([python, "-m", "venv", str(folder)], "no virtual environment", remedy)
        _run(
            [str(own), "-m", "pip", "install", "-q", *requirements, *_own_requirements()],
            f"pip did not install {' '.join(requirements)}",
            "pip needs an index or a folder of wheels that has this version for this Python: see `pip config list`; "
            "with --with NAME==VERSION an older companion is installed beside it, with --python another Python",
        )
        stamp.write_text(wanted, encoding="utf-8")
    _copy_sepv(own)
    return str(own)


def _own_requirements() -> list[str]:
    """What sepv needs, without its extras."""
    return [text for text in requires("sepv") or () if "extra ==" not in text]


def _copy_sepv(python: Path) -> None:
    """The package as it runs here, with the folders that a checkout keeps at its top."""
    code = "import sysconfig; print(sysconfig.get_path('purelib'))"
    done = _run([str(python), "-c", code], "no Python", "make it anew")
    target, source = Path(done.strip()) / "sepv", Path(import_module("sepv").__file__ or "").parent
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(source, target, ignore=ignored)
    for name in _ELSEWHERE:
        shutil.copytree(
            Path(import_module(f"sepv.{name}").__path__[0]), target / name, ignore=ignored, dirs_exist_ok=True
        )


def measure(python: str, arguments: Sequence[str]) -> None:
    """``python -m sepv.peers._peer`` in the environment, with the same standard error; or an EnvironmentFailure."""
    # -P: a folder or a file of the current folder is nobody's module.
    done = subprocess.run([python, "-P", "-m", "sepv.peers._peer", *arguments], check=False)
    if done.returncode:
        what = f"the measurement ended with exit code {done.returncode}"
        raise EnvironmentFailure(what, "what it said is above; --keep goes on there")


def _run(command: list[str], what: str, remedy: str) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        lines = done.stderr.splitlines()
        said = [line for line in lines if line.startswith("ERROR")] or lines
        text = "\n".join(_ADDRESS.sub("…", line) for line in said[-4:])
        raise EnvironmentFailure(f"{what}\n{text}".strip(), remedy)
    return done.stdout
