"""Generated modules on disk: written once, imported by name, compiled code kept beside them by numba."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import os
import sys
import tempfile
from functools import cache
from pathlib import Path
from types import ModuleType

import numba
from numba.np import linalg

# What the generated code is linked with: when one of these changes, so does the name of every module.
_SOURCES = (
    "functions.py", "kernels.py", "lanes.py", "module.py", "pieces.py", "signatures.py", "stages.py",
    "../../solve/_newton.py", "../../solve/_solution.py", "../../schemes/_tableaux.py",
    "../../problem/_averaged_gradient.py",
)  # fmt: skip


def _put_off_blas() -> None:
    """Has numba import scipy.linalg when somebody's code calls BLAS: that is a fifth of the time of a first ensemble.

    numba.np.arraymath imports it to learn whether it is there, and it is, since sepv needs SciPy. What calls BLAS asks
    numba.np.linalg.ensure_blas again.
    """
    if "numba.np.arraymath" in sys.modules or not hasattr(linalg, "ensure_blas"):
        return
    asked = linalg.ensure_blas
    linalg.ensure_blas = lambda: None
    try:
        importlib.import_module("numba.np.arraymath")
    finally:
        linalg.ensure_blas = asked


_put_off_blas()


def folder() -> Path:
    """Where generated modules are kept: $SEPV_CACHE_DIR, else ~/.cache/sepv/engine, or below $XDG_CACHE_HOME.

    Where that cannot be written, a fresh folder for this process: a shared one in /tmp would let
    others choose the code that is run.
    """
    named = os.environ.get("SEPV_CACHE_DIR")
    home = Path(named) if named else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "sepv"
    place = home / "engine"
    try:
        place.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=place):
            return place
    except OSError:
        return _temporary()


@cache
def _temporary() -> Path:
    return Path(tempfile.mkdtemp(prefix="sepv-engine-"))


@cache
def _linked() -> bytes:
    here = Path(__file__).parent
    return b"".join((here / name).read_bytes() for name in _SOURCES) + numba.__version__.encode()


_ordinary: dict[str, ModuleType] = {}


def is_there(name: str) -> bool:
    """Whether `ordinary` has been asked for it."""
    return name in _ordinary


def ordinary(name: str) -> ModuleType:
    """The module `driver` or `careful`, compiled, known by its content and what it is linked with."""
    if name not in _ordinary:
        _ordinary[name] = load((Path(__file__).parent / f"{name}.py").read_text(encoding="utf-8"))
    return _ordinary[name]


@cache
def load(text: str) -> ModuleType:
    """The module with this source, compiled, or read from the cache where it was compiled before."""
    name = "sepv_kernel_" + hashlib.sha256(_linked() + text.encode()).hexdigest()[:24]
    path = folder() / f"{name}.py"
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        # Written aside and renamed: another process sees the whole file or none.
        with tempfile.NamedTemporaryFile("w", dir=path.parent, delete=False, encoding="utf-8") as out:
            out.write(text)
        os.replace(out.name, path)
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except Exception:
        # Compiled code that was cut off when it was written, or is not of this machine: compiled once more.
        for file in (path.parent / "__pycache__").glob(f"{name}*"):
            file.unlink(missing_ok=True)
        spec.loader.exec_module(module)
    return module
