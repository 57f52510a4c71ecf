"""Devices run a kernel: a card by CuPy, or the processor of this machine by its C compiler.

A device has `xp`, the module of its arrays (cupy or numpy), `compiled(text)`, which gives a
function launch(kernel, threads, *arguments) for a kernel's text (`exact`: no product and sum become
one fma), and `fetched(array)`, a NumPy array of an array's numbers.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from functools import cache, lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from sepv.errors import UsageError
from sepv.files import cache_folder

Launch = Callable[..., None]
# Threads of a block on a card: four warps share a table of the ziggurat, and a multiprocessor holds
# many such blocks.
THREADS = 128


def _argument(value: Any) -> Any:
    """Integers as int64 and floats as float64, the only types of numbers in a kernel's
    arguments.
    """
    if isinstance(value, (np.generic, int, float)):
        kind = np.int64 if isinstance(value, (int, np.integer)) else np.float64
        return kind(value)
    return value


class Card:
    """The current CUDA device, with CuPy. NVRTC compiles the text,
    and CuPy keeps compiled code on disk.
    """

    def __init__(self) -> None:
        import cupy

        self.xp: Any = cupy

    @lru_cache(maxsize=64)  # noqa: B019 - there is one object of this class
    def compiled(self, text: str, exact: bool = False) -> Launch:
        """The launcher of the kernels in a text."""
        fused = ("--fmad=false",) if exact else ()
        module = self.xp.RawModule(code=text, options=("--std=c++17", *fused))
        module.compile()

        def launch(kernel: str, threads: int, *arguments: Any) -> None:
            function = module.get_function(kernel)
            given = (np.int64(threads), *map(_argument, arguments))
            function((-(-threads // THREADS),), (THREADS,), given)

        return launch

    @cache  # noqa: B019 - there is one object of this class
    def tables(self, made: Callable[[], tuple[np.ndarray, ...]]) -> tuple[Any, ...]:
        """The arrays that a function makes, copied to the card once."""
        return tuple(map(self.xp.asarray, made()))

    def fetched(self, array: Any) -> np.ndarray:
        """NumPy's copy of an array."""
        return np.asarray(self.xp.asnumpy(array))


class Host:
    """The machine's processor, for tests where there is no card: its C compiler,
    and the threads in a loop.
    """

    xp: Any = np

    @lru_cache(maxsize=1024)  # noqa: B019 - there is one object of this class
    def compiled(self, text: str, exact: bool = False) -> Launch:  # noqa: ARG002 - always exact
        """The launcher of the kernels in a text."""
        library = ctypes.CDLL(str(_library(text)))

        def launch(kernel: str, threads: int, *arguments: Any) -> None:
            given = [ctypes.c_int64(threads), *(_as_ctypes(_argument(a)) for a in arguments)]
            library[kernel](*given)

        return launch

    def tables(self, made: Callable[[], tuple[np.ndarray, ...]]) -> tuple[Any, ...]:
        """The arrays that a function makes."""
        return made()

    def fetched(self, array: Any) -> np.ndarray:
        """A copy of an array."""
        return np.array(array)


def _as_ctypes(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        assert value.flags.c_contiguous
        return ctypes.c_void_p(value.ctypes.data)
    return ctypes.c_double(value) if isinstance(value, np.float64) else ctypes.c_int64(int(value))


def compiler() -> str | None:
    """The path of a C compiler, or None."""
    return shutil.which(os.environ.get("CC", "cc")) or shutil.which("gcc") or shutil.which("clang")


# Without contraction to fma, so that the roundings are NumPy's. Tests compile longer than they run,
# hence -O1.
FLAGS = ("-x", "c", "-std=gnu11", "-O1", "-ffp-contract=off", "-shared", "-fPIC", "-w")


def _library(text: str) -> Path:
    """The shared library of a kernel's text, compiled into the cache folder unless it is there."""
    program = compiler()
    assert program is not None
    name = hashlib.sha256("\0".join([program, *FLAGS, text]).encode()).hexdigest()[:24]
    path = cache_folder("engine") / f"sepv_kernel_{name}.so"
    if not path.is_file():
        with tempfile.TemporaryDirectory(dir=path.parent) as room:
            own = Path(room) / path.name
            command = [program, *FLAGS, "-o", str(own), "-", "-lm"]
            done = subprocess.run(command, input=text, capture_output=True, text=True, check=False)
            if done.returncode:
                raise RuntimeError(f"{program} refuses a kernel of sepv:\n{done.stderr[:4000]}")
            os.replace(own, path)
    return path


@cache
def card() -> Card:
    """The card of this machine. Raise UsageError if there is none,
    or if CuPy is missing or too old for it.
    """
    if find_spec("cupy") is None:
        raise UsageError(
            expected="CuPy for engine='cuda'",
            received="no module cupy",
            remedy="pip install 'sepv[cuda]' on a machine with a card of NVIDIA; engine='auto' needs none",
        )
    try:
        found = Card()
        count, why = found.xp.cuda.runtime.getDeviceCount(), "no device"
    except Exception as error:  # a driver that is missing or too old raises many types
        count, why = 0, f"{type(error).__name__}: {error}"
    if not count:
        raise UsageError(
            expected="a card of NVIDIA with its driver for engine='cuda'",
            received=why,
            remedy="run it where nvidia-smi names a card; engine='auto' needs none",
        )
    return found


@cache
def host() -> Host:
    """The machine's processor as a device. Raise UsageError if it has no C compiler."""
    if compiler() is None:
        raise UsageError(
            expected="a C compiler for engine='cuda-on-host'",
            received="neither cc nor gcc nor clang",
            remedy="install one, or name it in the variable CC",
        )
    return Host()
