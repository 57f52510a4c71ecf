"""Saboteurs: copies of a scheme, mostly (2.1), each with one fault and all claims of the scheme.
They test the laws.

Each module is a family of saboteurs, and `SABOTEURS` holds all saboteurs by name. For each kind of
fault that a law is said to find there is a saboteur; `sepv.faults.detection` runs all of them.
"""

from __future__ import annotations

from importlib import import_module

from .record import Saboteur as Saboteur

_FAMILY_MODULES = (
    "formula", "noise", "solver", "arithmetic", "interface", "higher_order", "structure", "historical", "hamiltonians",
    "damping", "friction", "carried", "windows", "long_times", "corners", "bodies", "stated", "twins",
)  # fmt: skip
_BY_FAMILY = [import_module(f"{__name__}.{name}").FAMILY for name in _FAMILY_MODULES]
SABOTEURS: dict[str, Saboteur] = {s.name: s for family in _BY_FAMILY for s in family}
