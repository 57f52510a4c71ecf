"""The corpus of witnesses: cases that once showed a violation, tried before any search.

The witnesses of a law are in ``reference/witnesses/LAW.json``, those of its part in
``LAW-PART.json``; docs/vectors.md describes this file for other programs. A witness is measured
like any other case of its law, with the same bound. The corpus can therefore find a fault sooner,
but it can show no violation that a search could not find.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files

from sepv.law.cases.case import Case, of_valid
from sepv.problem import Systems

WITNESS_FORMAT = "sepv-witnesses-1"
WITNESS_FOLDER = files("sepv.reference") / "witnesses"


@dataclass(frozen=True)
class Witness:
    """A stored case of a law, and the schemes that violated the law in this case."""

    id: str  # LAW/NUMBER
    systems: Systems
    found: str  # the scheme that gave the counterexample: a deliberately wrong one, or one without a claim to the law
    caught: tuple[str, ...]  # all schemes that violate the law in this case
    case: Case


def file_of(law: str) -> str:
    """The name of the file of a law's witnesses; a hyphen comes before its part."""
    return f"{law.replace(':', '-')}.json"


@lru_cache(maxsize=64)
def witnesses(law: str, systems: Systems | None = None) -> tuple[Witness, ...]:
    """The stored witnesses of a law, for one class of systems or for all;
    empty for a law that has no file.
    """
    file = WITNESS_FOLDER / file_of(law)
    if not file.is_file():
        return ()
    data = json.loads(file.read_text(encoding="utf-8"))
    records = (
        Witness(w["id"], Systems(w["systems"]), w["found"], tuple(w["caught"]), of_valid(w["case"]))
        for w in data["witnesses"]
    )
    return tuple(w for w in records if systems in (None, w.systems))


def cases(law: str, systems: Systems) -> tuple[Case, ...]:
    """The cases of a law's witnesses in the file's order:
    first the case that shows the most wrong schemes.
    """
    return tuple(w.case for w in witnesses(law, systems))
