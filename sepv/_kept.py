"""Results that no scheme influences, kept between runs in the user's cache: random test cases,
reference solutions.

Computing these results takes a fifth of the time of a run of all laws. They are computed anew if a
file of sepv, or the version of Python or NumPy, has changed.
"""

from __future__ import annotations

import hashlib
import pickle
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar
from zlib import crc32

import numpy as np

from sepv.files import cache_folder, write_atomically

T = TypeVar("T")
# The largest number of stored results of one kind, twice that of a run of all laws. The results
# used last are stored.
STORED_MAX = 2048


class Kept:
    """The stored results of one kind, each with a text as its key.
    The file is read at the first use.
    """

    def __init__(self, kind: str, most: int | None = None) -> None:
        self.kind, self.most, self.added = kind, most or STORED_MAX, False
        self.results: dict[str, Any] | None = None

    def get(self, key: str, make: Callable[[], T]) -> T:
        """The result for this key; if none is stored, `make` computes it.
        An exception of `make` is not stored.
        """
        if self.results is None:
            self.results = self._read()
        made = self.results.pop(key) if key in self.results else self._made(make)
        self.results[key] = made
        return made

    def _made(self, make: Callable[[], T]) -> T:
        made = make()
        self.added = True
        return made

    def save(self) -> None:
        """Write the results if some are new; do nothing if the folder cannot be written to."""
        if self.added and self.results is not None:
            last = dict(list(self.results.items())[-self.most :])
            with suppress(OSError):
                write_atomically(str(_path(self.kind)), pickle.dumps((_sources(), last)))
            self.added = False

    def _read(self) -> dict[str, Any]:
        # A file that is damaged, or that another version of the sources wrote, is replaced.
        with suppress(Exception):
            sources, results = pickle.loads(_path(self.kind).read_bytes())
            if sources == _sources():
                return dict(results)
        return {}


def key_of(*values: Any) -> str:
    """The key of a result that these values determine, such as polynomial data, numbers,
    and arrays.
    """
    texts = [repr(v.tolist() if isinstance(v, np.ndarray) else v) for v in values]
    return hashlib.sha256(" ".join(texts).encode()).hexdigest()


@cache
def kept(kind: str, most: int | None = None) -> Kept:
    """The store of results of one kind, of which the last `most` are written;
    the same object at each call.
    """
    _KEPT_TABLES.append(found := Kept(kind, most))
    return found


_KEPT_TABLES: list[Kept] = []


def save_all() -> None:
    """Write the results of all kinds that have new ones."""
    for own in _KEPT_TABLES:
        own.save()


def _path(kind: str) -> Path:
    # The name depends on the path of this file, so that two installations do not replace each
    # other's results.
    return cache_folder("kept") / f"{kind}-{crc32(__file__.encode()):08x}.pickle"


@cache
def _sources() -> Any:
    """The versions of software and the files of sepv on which stored results depend."""
    # An installation has the laws and the references in the package, and a checkout beside it.
    places = [Path(place) for place in sys.modules["sepv"].__path__]
    folders = [places[0], *(place / name for place in places for name in ("properties", "reference"))]
    files = sorted({path for folder in folders for path in folder.rglob("*.py")})
    return sys.version, np.__version__, [(str(p), p.stat().st_mtime_ns, p.stat().st_size) for p in files]
