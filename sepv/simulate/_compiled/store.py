"""Generated modules on disk: written once and imported by name;
numba caches their compiled code beside them.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import re
import sys
import threading
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import llvmlite
import numba
import numpy as np
from llvmlite import binding

from sepv._patches import put_off_blas
from sepv.files import cache_folder, write_atomically

# The pattern of a line, in a module's source, that imports names from sepv.
_IMPORTS = re.compile(r"^from (sepv[\w.]*) import (.+)$", re.MULTILINE)
_Number = (bool, int, float, str, np.generic)


put_off_blas()


@cache
def _machine() -> bytes:
    """The versions of the compiler, and the machine that it compiles for."""
    made_by = numba.__version__, llvmlite.__version__, np.__version__
    return repr((made_by, binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten())).encode()


def linked(text: str) -> Iterator[ModuleType]:
    """The modules of sepv whose code a source text runs: modules that it imports,
    and modules of functions in these.

    Classes are not followed, because compiled code has only the numbers of an object.
    """
    open_ = [
        found
        for package, names in _IMPORTS.findall(text)
        for module in (importlib.import_module(package),)
        for found in (module, *(getattr(module, name.strip(" ,"), None) for name in names.split(",")))
        if isinstance(found, ModuleType)
    ]
    seen = set[str]()
    while open_:
        module = open_.pop()
        # Packages are left out: their contents depend on earlier imports, and no linked function is
        # defined in them.
        if module.__name__ in seen or not module.__name__.startswith("sepv.") or hasattr(module, "__path__"):
            continue
        seen.add(module.__name__)
        yield module
        for value in vars(module).values():
            home = value if isinstance(value, ModuleType) else sys.modules.get(_home(value))
            open_ += [] if home is None else [home]


def _home(value: Any) -> str:
    """The name of the module of a function, compiled or not; "" for other values."""
    return getattr(value, "__module__", None) or "" if callable(value) and not isinstance(value, type) else ""


def contents(module: ModuleType) -> Iterator[bytes]:
    """The bytes of a module's source, and of the numbers and arrays among its names."""
    assert module.__file__ is not None
    yield Path(module.__file__).read_bytes()
    for name, value in sorted(vars(module).items()):
        if isinstance(value, np.ndarray):
            yield name.encode() + value.tobytes()
        elif name[:2] != "__" and isinstance(value, (*_Number, tuple)):
            yield f"{name} = {value!r}".encode()


def name_of(text: str) -> str:
    """The name of the module with the source `text`; it changes with everything that its compiled
    code depends on.
    """
    parts = [_machine(), text.encode()]
    for module in sorted(linked(text), key=lambda module: module.__name__):
        parts += contents(module)
    return "sepv_kernel_" + hashlib.sha256(b"\0".join(parts)).hexdigest()[:24]


@cache
def ordinary(name: str) -> ModuleType:
    """The module `driver` or `lanes`, compiled, identified by its content and its linked code.

    numba identifies compiled code by the module's file alone, so these two modules are stored like
    generated ones.
    """
    return load((Path(__file__).parent / f"{name}.py").read_text(encoding="utf-8"))


# A module that a thread is still executing is already in sys.modules, where another thread would
# see it incomplete.
_LOADING_LOCK = threading.RLock()


def load(text: str) -> ModuleType:
    """The module with the source `text`, compiled, or read from the cache if it was compiled
    before.
    """
    with _LOADING_LOCK:
        return _loaded(text)


@cache
def _loaded(text: str) -> ModuleType:
    name = name_of(text)
    path = cache_folder("engine") / f"{name}.py"
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        write_atomically(str(path), text)
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except Exception:
        # The cached code is incomplete or for another machine, so it is removed and the module
        # compiled again.
        for file in (path.parent / "__pycache__").glob(f"{name}*"):
            file.unlink(missing_ok=True)
        spec.loader.exec_module(module)
    return module
