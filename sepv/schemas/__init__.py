"""JSON Schemas of what sepv writes."""

from __future__ import annotations

import json
from importlib.resources import files
from typing import Any


def comparison_schema() -> dict[str, Any]:
    """The JSON Schema of ``sepv compare --json``."""
    return _schema("comparison.schema.json")


def hard_schema() -> dict[str, Any]:
    """The JSON Schema of ``sepv hard --json``."""
    return _schema("hard.schema.json")


def manifest_schema() -> dict[str, Any]:
    """The JSON Schema of ``manifest.json`` in a bundle of ``sepv submit``."""
    return _schema("manifest.schema.json")


def peers_schema() -> dict[str, Any]:
    """The JSON Schema of a record of ``sepv peers``."""
    return _schema("peers.schema.json")


def report_schema() -> dict[str, Any]:
    """The JSON Schema of ``sepv verify --json``."""
    return _schema("report.schema.json")


def reproduction_schema() -> dict[str, Any]:
    """The JSON Schema of ``sepv reproduce --json``."""
    return _schema("reproduction.schema.json")


def solvability_schema() -> dict[str, Any]:
    """The JSON Schema of ``sepv solvability --json``."""
    return _schema("solvability.schema.json")


def ulps_schema() -> dict[str, Any]:
    """The JSON Schema of ``sepv ulps --json``."""
    return _schema("ulps.schema.json")


def fault(data: Any, schema: dict[str, Any]) -> str:
    """The fault that says most of what is wrong, with its place; empty where data obey the schema."""
    from jsonschema import Draft202012Validator
    from jsonschema.exceptions import best_match

    error = best_match(Draft202012Validator(schema).iter_errors(data))
    return "" if error is None else f"{error.json_path}: {error.message:.200}"


def _schema(name: str) -> dict[str, Any]:
    schema: dict[str, Any] = json.loads((files(__name__) / name).read_text(encoding="utf-8"))
    return schema
