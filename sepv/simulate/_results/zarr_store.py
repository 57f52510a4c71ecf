"""A store on disk of the ends of paths, with a Zarr chunk for each chunk of paths (Zarr format 3,
read by xarray).

The array `work` has a row for each chunk of paths, with a checksum of the chunk's data. The row is
written last, and marks the chunk as complete. If a chunk was deleted, changed or left incomplete by
a crash, its checksum does not fit, and the chunk is computed again.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sepv._arguments import optional
from sepv.errors import UsageError

# The version of the format of a store, which has states as (component, time, path).
STORE_FORMAT = 2
# The counts of work of a chunk, stored after the checksum in the chunk's row of `work`.
STORED_COUNTS = ("gradient_evaluations", "structure_evaluations", "iterations", "divisions", "continuations")
# Fill values of entries never written; no path has these values.
_FILL = {"f": float("nan"), "i": -9}


class ZarrStore:
    """A store of `paths` paths in chunks of `chunk` paths: zarr `arrays` by name,
    whose last axis is the path.
    """

    def __init__(
        self, where: Any, about: Mapping[str, Any], shapes: Mapping[str, Any], paths: int, chunk: int
    ) -> None:
        """Open a store or create it; UsageError if zarr is not installed or `where` holds something
        else.

        where : path, or another argument of `zarr.open_group`
        about : the description of the paths as JSON; an existing store must have the same
        shapes : name -> (names of the axes before the paths, their lengths, dtype)
        """
        zarr = optional("zarr", "zarr ≥ 3, for store=", "pip install 'zarr>=3'")
        self.paths, self.chunk = paths, chunk
        self.chunks = -(-paths // chunk)
        self.where = where
        self.group = _group(zarr, where, {**about, "format": STORE_FORMAT, "paths": paths, "chunk": chunk})
        self.arrays: dict[str, Any] = {}
        for name, (axes, lengths, dtype) in shapes.items():
            if 0 in lengths:
                continue
            self.arrays[name] = self._array(
                name, (*lengths, paths), (*lengths, chunk), (*axes, "path"), dtype
            )
        line = 1 + len(STORED_COUNTS)
        self.work = self._array("work", (self.chunks, line), (1, line), ("chunk", "counted"), np.int64)

    def _array(self, name: str, shape: Any, chunks: Any, axes: Any, dtype: Any) -> Any:
        """The store's array, or a new one. UsageError if its description is damaged,
        or is that of another array.
        """
        kind = np.dtype(dtype).kind
        try:
            array = self.group.get(name)
            if array is None:
                array = self.group.create_array(
                    name, shape=shape, chunks=chunks, dtype=dtype, fill_value=_FILL[kind], dimension_names=axes,
                    # Only integers can be compressed, because the digits of states look random.
                    compressors=None if kind == "f" else "auto",
                )  # fmt: skip
            there = array.shape, array.chunks, np.dtype(array.dtype)
        except OSError:
            raise
        except Exception as error:  # zarr raises what its parsers raise
            wrong = f"a damaged description of its array {name!r} ({type(error).__name__}: {error})"
            raise _other(self.where, wrong) from error
        wanted = tuple(shape), tuple(chunks), np.dtype(dtype)
        if there != wanted:
            wrong = "shape {}, chunks {}, {}".format(*there) + ", not {}, {}, {}".format(*wanted)
            raise _other(self.where, f"an array {name!r} of {wrong}")
        return array

    def save(self, number: int, chunk: Any) -> None:
        """Write chunk `number`, given as an `Ensemble`.
        Its row of `work` is written last and marks it as complete.
        """
        contents = {name: getattr(chunk, name) for name in self.arrays}
        for name, array in self.arrays.items():
            array[..., self._place(number)] = contents[name]
        counts = [getattr(chunk, key) for key in STORED_COUNTS]
        self.work[number] = np.array([_checksum(number, contents, counts), *counts], dtype=np.int64)

    def load(self, number: int) -> dict[str, Any] | None:
        """Read a chunk's arrays and counts; None if the chunk is missing, incomplete or changed."""
        try:
            line = [int(v) for v in self.work[number]]
            if line[0] < 0:
                return None
            contents = {name: array[..., self._place(number)] for name, array in self.arrays.items()}
        except Exception:  # an incomplete file can fail anywhere, in the decoders or before
            return None
        counts = line[1:]
        if _checksum(number, contents, counts) != line[0]:
            return None
        return contents | dict(zip(STORED_COUNTS, counts, strict=True))

    def _place(self, number: int) -> slice:
        return slice(number * self.chunk, min((number + 1) * self.chunk, self.paths))


def _checksum(number: int, contents: Mapping[str, Any], counts: list[int]) -> int:
    """CRC-32 of the chunk's number, its counts and every bit of its arrays."""
    code = zlib.crc32(repr((number, counts)).encode())
    for name in sorted(contents):
        code = zlib.crc32(np.ascontiguousarray(contents[name]).data, zlib.crc32(name.encode(), code))
    return code


def _group(zarr: Any, where: Any, about: dict[str, Any]) -> Any:
    place = Path(where) if isinstance(where, (str, Path)) and "://" not in str(where) else None
    if place is not None and (not place.exists() or (place.is_dir() and not any(place.iterdir()))):
        return zarr.create_group(str(place), zarr_format=3, attributes={"sepv": about})
    target = where if place is None else str(place)
    try:
        group = zarr.open_group(target, mode="r+")
    except Exception as error:
        if place is None:
            return zarr.create_group(target, zarr_format=3, attributes={"sepv": about})
        raise _other(place, f"it is no Zarr group ({type(error).__name__})") from error
    found = group.attrs.asdict().get("sepv")
    if not isinstance(found, dict):
        raise _other(target, "it was not written by sepv")
    differ = [key for key in sorted({*found, *about}) if found.get(key) != about.get(key)]
    vague = (
        "code",
        "versions",
        "steps from drawn states",
        "fingerprint",
    )  # the least informative reason comes last
    differ.sort(key=lambda key: vague.index(key) if key in vague else -1)
    if differ:
        key = differ[0]
        if isinstance(found.get(key), dict) and isinstance(about.get(key), dict):
            there, here = found[key], about[key]
            names = [name for name in sorted({*there, *here}) if there.get(name) != here.get(name)]
            shown = "; ".join(f"{name}: {there.get(name)} there and {here.get(name)} here" for name in names)
            raise _other(target, f"it was made by other {key} ({shown})")
        raise _other(
            target,
            f"it holds other paths: {key} is {found.get(key)!r:.120} there and {about.get(key)!r:.120} here"
            + (f" (and {', '.join(differ[1:])})" if differ[1:] else ""),
        )
    return group


def _other(place: Any, received: str) -> UsageError:
    return UsageError(
        expected=f"a new place for the store, or one with these very paths: {place}",
        received=received,
        remedy="another name; nothing that is there is ever written over",
    )
