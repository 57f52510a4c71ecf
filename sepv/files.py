"""Files that a run writes: written whole or not at all, and the JSON Schemas that they obey.

A result is one JSON object. Its first entry, "made", names the schema and the versions of the
software that wrote it.
"""

from __future__ import annotations

import atexit
import json
import math
import os
import platform
import shutil
import stat
import tempfile
from functools import cache
from importlib import metadata
from importlib.resources import files
from pathlib import Path
from typing import Any

from sepv._arguments import double, parse_json
from sepv._version import __version__
from sepv.errors import UsageError, require_one_of

# The names for users; the rest is for the commands.
__all__ = ["RESULTS", "schema"]


def require_folder(path: str | None) -> None:
    """Raise a UsageError if no file can be written at this path;
    for a check before a long computation.
    """
    if path is None:
        return
    folder = Path(path).resolve().parent
    if not folder.is_dir() or not os.access(folder, os.W_OK) or Path(path).is_dir():
        raise UsageError(
            expected="a file in a folder that exists and can be written to",
            received=path,
            remedy="make the folder, or name another file",
        )


def cache_folder(name: str) -> Path:
    """A folder that only this user can write to: ~/.cache/sepv/NAME,
    or below $XDG_CACHE_HOME or $SEPV_CACHE_DIR.

    Code is run from this folder, so others must not be able to write to it. If there is no such
    folder (no home, a read-only home, another user's), a temporary folder with a random name is
    made, and removed when this process ends.
    """
    try:
        named = os.environ.get("SEPV_CACHE_DIR")
        home = Path(named or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        home = home if named else home / "sepv"
        place = home / name
        for folder in (home, place):
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if named or (_is_private(home) and _is_private(place)):
            with tempfile.NamedTemporaryFile(dir=place):
                return place
    except (OSError, RuntimeError):  # RuntimeError for a user without a home
        pass
    return _fresh_folder(name)


@cache
def _fresh_folder(name: str) -> Path:
    fresh = tempfile.mkdtemp(prefix=f"sepv-{name}-")
    atexit.register(shutil.rmtree, fresh, ignore_errors=True)
    return Path(fresh)


def _is_private(folder: Path) -> bool:
    """True if only this user can write to the folder; always on Windows,
    which protects each user's home.
    """
    status = folder.stat()
    return not hasattr(os, "geteuid") or (status.st_uid == os.geteuid() and not status.st_mode & 0o022)


def write_atomically(path: str, content: str | bytes) -> None:
    """Write a file whole or not at all: a reader never sees half of it. Text is UTF-8,
    with ? for a lone surrogate.
    """
    target = Path(path).resolve()
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content.encode(errors="replace") if isinstance(content, str) else content)
        os.chmod(name, 0o644)
        os.replace(name, target)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


# The results that commands write, with their schema's version, which is raised if older programs
# would misread a file.
RESULTS = {
    "bench": 1, "comparison": 1, "growth": 1, "hard": 1, "path": 1, "report": 2, "reproduction": 1, "solvability": 1,
    "teeth": 1,
}  # fmt: skip
# The names of all schemas: the results, and the problems and witnesses, which users write.
SCHEMAS = (*RESULTS, "problem", "witness")
# The largest file in bytes; no result of this package is larger.
RESULT_MAX_BYTES = 64 * 2**20


def json_text(data: Any, *, indent: int | None = 1) -> str:
    """Write data as strict JSON; a ValueError for a number that is not finite (`finite` converts it
    to null).
    """
    return json.dumps(data, indent=indent, ensure_ascii=False, allow_nan=False) + "\n"


def finite(value: Any) -> Any:
    """Convert a value to one that JSON can hold: NaN and infinities become null, tuples lists."""
    if isinstance(value, dict):
        return {k: finite(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(v) for v in value]
    if hasattr(value, "item"):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_json(
    path: str, name: str, data: dict[str, Any], *, command: str = "", indent: int | None = 1
) -> None:
    """Write a result, one of `RESULTS`, with its origin first: versions,
    the platform and the command.
    """
    write_atomically(path, json_text({"made": made(name, command)} | data, indent=indent))


def made(name: str, command: str = "") -> dict[str, Any]:
    """The origin of a result: schema, versions, the kind of machine and its vector instructions."""
    import numpy as np

    versions = {key: metadata.version(key) for key in ("numpy", "scipy", "hypothesis", "mpmath")}
    simd: Any = np.show_config(mode="dicts")
    return {
        "schema": name, "version": RESULTS[name], "sepv": __version__, "python": platform.python_version(),
        **versions, "platform": f"{platform.system()} {platform.machine()}",
        "simd": " ".join(simd.get("SIMD Extensions", {}).get("found", ())), "command": command,
    }  # fmt: skip


def read_bounded(path: str | Path, largest: int = RESULT_MAX_BYTES) -> bytes:
    """The bytes of a regular file; a ValueError for a larger one, and for a pipe or a device,
    which may never end.
    """
    kind = Path(path).stat()
    if not stat.S_ISREG(kind.st_mode) and not stat.S_ISDIR(kind.st_mode):
        raise ValueError("a pipe, a socket or a device, and no file")
    if kind.st_size > largest:
        raise ValueError(f"{kind.st_size} bytes, more than {largest}")
    with open(path, "rb") as file:
        data = file.read(largest + 1)
    if len(data) > largest:  # it grew, or its system gives no size
        raise ValueError(f"more than {largest} bytes")
    return data


def read_json(path: str | Path, largest: int = RESULT_MAX_BYTES, /, *, expected: str, remedy: str) -> Any:
    """Read a JSON file; a UsageError for one that cannot be read, is too large or is not JSON."""
    try:
        return parse_json(read_bounded(path, largest))
    except OSError as error:
        raise UsageError(expected=expected, received=f"{path}: {error.strerror}", remedy=remedy) from error
    except ValueError as error:
        raise UsageError(expected=expected, received=f"{path}: {error}", remedy=remedy) from error


def require_schema(data: Any, name: str, path: str | Path, *, expected: str, remedy: str) -> None:
    """Raise a UsageError if a file's data break the schema `name` of `SCHEMAS`.
    Older files have no entry "made".
    """
    made = data.get("made") if isinstance(data, dict) else None
    version = made.get("version") if isinstance(made, dict) else None
    if isinstance(version, int) and version > RESULTS.get(name, version):
        raise UsageError(
            expected=f"{expected}, of version {RESULTS[name]} at most",
            received=f"{path}: version {version}, by sepv {data['made'].get('sepv')!r:.40}",
            remedy="install that version of sepv",
        )
    if wrong := fault(data, schema(name)):
        raise UsageError(expected=expected, received=f"{path}: {wrong}", remedy=remedy)


def schema(name: str) -> dict[str, Any]:
    """The JSON Schema called `name`. Every schema of a result contains the whole description of the
    entry "made".

    Raises
    ------
    UsageError
        For a name that is not in `SCHEMAS`.
    """
    require_one_of("a schema", name, SCHEMAS)
    packaged = _packaged("problem" if name == "witness" else name)
    if name == "witness":
        packaged["$ref"] = "#/$defs/witness"
    if name in RESULTS:
        packaged["properties"]["made"] = _packaged("made")
        packaged["properties"]["made"]["properties"]["schema"] = {"const": name}
    return packaged


def _packaged(name: str) -> dict[str, Any]:
    text = (files("sepv") / "schemas" / f"{name}.schema.json").read_text(encoding="utf-8")
    return dict(json.loads(text))


def fault(data: Any, schema: dict[str, Any]) -> str:
    """Describe the most informative violation of a JSON Schema by data, with its place;
    empty without a violation.
    """
    from jsonschema import Draft202012Validator, FormatChecker
    from jsonschema.exceptions import best_match

    formats = FormatChecker(())
    formats.checks("double", raises=ValueError)(lambda value: double(value) is not None)
    errors = list(Draft202012Validator(schema, format_checker=formats).iter_errors(data))
    error = best_match(errors)
    if error is None:
        return ""
    # For a wrong number, the error of `double`, which says how a number may be written.
    cause = next((e.cause for e in errors if e.cause is not None and e.json_path == error.json_path), None)
    return f"{error.json_path}: {cause or f'{error.message:.200}'}"
