"""Saboteurs: (2.1) with one thing broken each, all claims kept. They test the suite, not schemes.

Each family is a module; `SABOTEURS` holds them by name. Whatever a law is said to see, some saboteur shows
that it does; `sepv.faults._fault_detection` runs them all.
"""

from __future__ import annotations

from sepv.faults._saboteurs import (
    arithmetic,
    formula,
    hamiltonians,
    higher_order,
    historical,
    interface,
    noise,
    solver,
    structure,
)
from sepv.faults._saboteurs.record import Saboteur as Saboteur

_MODULES = (
    formula,
    noise,
    solver,
    arithmetic,
    interface,
    higher_order,
    structure,
    historical,
    hamiltonians,
)
FAMILIES = tuple(module.SABOTEURS.name for module in _MODULES)
SABOTEURS: dict[str, Saboteur] = {s.name: s for module in _MODULES for s in module.SABOTEURS}
