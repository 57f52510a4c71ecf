"""Hard cases: steps at which schemes and solvers break, each with the reason and the behaviour of a right solver.

`CATALOGUE` lists them all; `sepv hard` runs a scheme on them.
"""

from __future__ import annotations

from sepv.reference.hard import _fields, _mechanics, _scales, _steps
from sepv.reference.hard._hard_case import HardCase as HardCase
from sepv.reference.hard._hard_case import Sample as Sample

from sepv.errors import UsageError

CATALOGUE: tuple[HardCase, ...] = (*_steps.CASES, *_mechanics.CASES, *_scales.CASES, *_fields.CASES)


def by_name(name: str) -> HardCase:
    """The hard case of this name, with hyphens or underscores. Raises UsageError for an unknown name."""
    for case in CATALOGUE:
        if case.name == name.replace("_", "-"):
            return case
    raise UsageError(
        expected=f"a hard case, one of {', '.join(c.name for c in CATALOGUE)}",
        received=repr(name),
        remedy="`sepv hard` without names runs them all",
    )
