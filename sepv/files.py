"""Files that a run leaves: written whole or not at all, and the JSON Schemas that they obey."""

from __future__ import annotations

import json
import os
import tempfile
from importlib.resources import files
from pathlib import Path
from typing import Any

from sepv.errors import UsageError


def require_folder(path: str | None) -> None:
    """Complain about a file that could not be written before hours of work, not after.

    Raises
    ------
    UsageError
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


def write_atomically(path: str, content: str | bytes) -> None:
    """Write a file whole or not at all: a reader never sees half of it. Text goes as UTF-8."""
    target = Path(path).resolve()
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
        os.chmod(name, 0o644)
        os.replace(name, target)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


# What has one: the files of `--json` of these commands, a bundle's manifest, a record of `sepv peers`.
SCHEMAS = ("comparison", "hard", "manifest", "peers", "report", "reproduction", "solvability", "ulps")


def schema(name: str) -> dict[str, Any]:
    """The JSON Schema of one of `SCHEMAS`.

    Raises
    ------
    UsageError
    """
    if name not in SCHEMAS:
        raise UsageError(
            expected=f"a schema, one of {', '.join(SCHEMAS)}", received=repr(name), remedy="correct the name"
        )
    text = (files("sepv") / "schemas" / f"{name}.schema.json").read_text(encoding="utf-8")
    found: dict[str, Any] = json.loads(text)
    return found


def fault(data: Any, schema: dict[str, Any]) -> str:
    """The fault that says most of what is wrong, with its place; empty where data obey the schema."""
    from jsonschema import Draft202012Validator
    from jsonschema.exceptions import best_match

    error = best_match(Draft202012Validator(schema).iter_errors(data))
    return "" if error is None else f"{error.json_path}: {error.message:.200}"
