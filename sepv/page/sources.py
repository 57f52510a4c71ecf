"""The JSON files that a page is made of: which is which, and that each is what it says."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sepv.errors import UsageError

# A key that tells a file's kind, and whether the files of a kind are reports on a scheme, comparisons, …
KINDS = {"suite": "verify", "reproduction": "reproduce", "times_to_error": "compare", "records": "bench"}
# Larger files are no report of this package.
LARGEST = 64 * 2**20


@dataclass
class Sources:
    """What was read, by kind, in the order of the files."""

    verify: list[dict[str, Any]] = field(default_factory=list)
    compare: list[dict[str, Any]] = field(default_factory=list)
    reproduce: list[dict[str, Any]] = field(default_factory=list)
    bench: list[dict[str, Any]] = field(default_factory=list)


def load(paths: Iterable[str | Path]) -> Sources:
    """Read JSON files of verify, compare, bench and reproduce.

    Raises
    ------
    UsageError
        For a file that cannot be read, is no JSON, or none of these.
    """
    found = Sources()
    for path in paths:
        data = _read(Path(path))
        kind = next((k for key, k in KINDS.items() if key in data), None) if isinstance(data, dict) else None
        if kind is None:
            raise UsageError(
                expected="JSON written by sepv verify, compare or reproduce with --json, or by sepv bench with --save",
                received=f"{path}, which is none of these",
                remedy="sepv verify energy-preserving --json report.json",
            )
        _check(kind, data, path)
        getattr(found, kind).append(data)
    return found


def _read(path: Path) -> Any:
    try:
        if path.stat().st_size > LARGEST:
            raise ValueError(f"{path.stat().st_size} bytes")
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise UsageError(
            expected="a JSON file written by sepv",
            received=f"{path}: {error}",
            remedy="correct the name, or write it anew",
        ) from error


def _check(kind: str, data: dict[str, Any], path: str | Path) -> None:
    """The file obeys the schema in the package, as far as a page needs it.

    The schemas are checked by a small reader of our own: jsonschema is not needed to make a page.
    """
    from sepv import schemas

    if kind == "bench":
        from sepv.bench import store

        store.load(str(path))  # its own check
        return
    schema = {
        "verify": schemas.report_schema,
        "compare": schemas.comparison_schema,
        "reproduce": schemas.reproduction_schema,
    }[kind]()
    fault = _fault(data, schema, schema, "")
    if fault:
        raise UsageError(
            expected=f"the JSON of sepv {kind}, as its schema describes it",
            received=f"{path}: {fault}",
            remedy="write the file anew with this version of sepv",
        )


_TYPES: dict[str, tuple[type, ...]] = {
    "object": (dict,), "array": (list,), "string": (str,), "number": (int, float), "integer": (int,),
    "boolean": (bool,), "null": (type(None),),
}  # fmt: skip


def _fault(value: Any, schema: dict[str, Any], root: dict[str, Any], where: str) -> str:
    """The first place where value is not what the schema says; types, enums, required keys and items."""
    if "$ref" in schema:
        schema = root["$defs"][schema["$ref"].rsplit("/", 1)[1]]
    kinds = schema.get("type", [])
    kinds = [kinds] if isinstance(kinds, str) else kinds
    if kinds and not any(
        isinstance(value, _TYPES[k]) and (k == "boolean" or not isinstance(value, bool)) for k in kinds
    ):
        return f"{where or 'the file'} is {type(value).__name__}, not {' or '.join(kinds)}"
    if "enum" in schema and value not in schema["enum"]:
        return f"{where} is {value!r:.60}, not one of {schema['enum']}"
    if isinstance(value, dict):
        properties = schema.get("properties", {})
        for key in schema.get("required", []):
            if key not in value:
                return f"{where or 'the file'} has no {key!r}"
        for key, item in value.items():
            inner = properties.get(key) or schema.get("additionalProperties")
            fault = (
                _fault(item, inner, root, f"{where}.{key}"[:120].lstrip("."))
                if isinstance(inner, dict)
                else ""
            )
            if fault:
                return fault
    if isinstance(value, list) and isinstance(schema.get("items"), dict):
        for n, item in enumerate(value):
            fault = _fault(item, schema["items"], root, f"{where}[{n}]")
            if fault:
                return fault
    return ""
