"""Hard cases: steps at which schemes and solvers break,
each with the reason and the behaviour of a right solver.

`CATALOGUE` lists them all; `sepv hard` runs a scheme on them.
"""

from __future__ import annotations

from sepv._arguments import did_you_mean
from sepv.errors import unknown_name
from sepv.hard_cases import _fields, _mechanics, _scales, _steps
from sepv.hard_cases._hard_case import HardCase as HardCase
from sepv.hard_cases._hard_case import Sample as Sample

CATALOGUE: tuple[HardCase, ...] = (
    *_steps.STEP_CASES,
    *_mechanics.MECHANICS_CASES,
    *_scales.SCALE_CASES,
    *_fields.FIELD_CASES,
)


def by_name(name: str) -> HardCase:
    """The hard case of this name, with hyphens or underscores.
    Raises UsageError for an unknown name.
    """
    for case in CATALOGUE:
        if case.name == name.replace("_", "-"):
            return case
    known = [case.name for case in CATALOGUE]
    raise unknown_name("a hard case", did_you_mean(name, known), known, "`sepv hard` runs them all")
