"""Schemes side by side: cost and accuracy, regressions, hard cases, roundings, long times.

Each study stands by itself, has a command of its name, and is loaded when it is asked for: `_compare` (error with its
price), `_bench` (counters and paired times), `_hard_cases`, `_ulps`, `_energy_growth`, `_solvability`.
`_evaluation_count` counts what a scheme evaluates. Every picture goes through `_picture`. The paper's own experiments
are in `sepv.reference.paper`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sepv.studies._compare.method import Method as Method
    from sepv.studies._compare.run import compare as compare
    from sepv.studies._hard_cases import run as run_hard_cases  # noqa: F401  (named here, found by __getattr__)
    from sepv.studies._solvability.map import solvability_map as solvability_map

_HOME = {
    "Method": ("_compare.method", "Method"),
    "compare": ("_compare.run", "compare"),
    "run_hard_cases": ("_hard_cases", "run"),
    "solvability_map": ("_solvability.map", "solvability_map"),
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'sepv.studies' has no attribute {name!r}")
    module, attribute = _HOME[name]
    return getattr(import_module(f"sepv.studies.{module}"), attribute)


def __dir__() -> list[str]:
    return sorted(_HOME)
