"""JSON Schemas of what sepv writes."""

from __future__ import annotations

import json
from importlib.resources import files
from typing import Any


def report_schema() -> dict[str, Any]:
    """The JSON Schema of ``sepv verify --json``."""
    schema: dict[str, Any] = json.loads((files(__name__) / "report.schema.json").read_text(encoding="utf-8"))
    return schema
