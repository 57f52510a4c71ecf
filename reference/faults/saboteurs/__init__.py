"""Saboteurs: (2.1) with one thing broken each, and all claims kept. They test the suite, not schemes.

Each family is a module; `SABOTEURS` holds them by name. For each thing that a law is said to see, some saboteur shows
it; `sepv.reference.faults.detection` runs them all.
"""

from __future__ import annotations

from importlib import import_module

from .record import Saboteur as Saboteur

_MODULES = (
    "formula", "noise", "solver", "arithmetic", "interface", "higher_order", "structure", "historical", "hamiltonians",
    "damping", "carried", "windows", "long_times",
)  # fmt: skip
_BY_FAMILY = [import_module(f"{__name__}.{name}").SABOTEURS for name in _MODULES]
SABOTEURS: dict[str, Saboteur] = {s.name: s for family in _BY_FAMILY for s in family}
