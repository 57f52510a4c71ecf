"""The corpus of witnesses: cases that once showed a violation, tried before any search.

The witnesses of a law are in ``reference/witnesses/LAW.json``; docs/vectors.md describes this file for other programs.
A witness is a case of its law like any other, measured by the law's check against the law's bound. So the corpus can
find a fault sooner, but cannot accuse a scheme that a search could not accuse.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files

from sepv.problem import Systems
from sepv.verification._cases.case import Case, of_valid

FORMAT = "sepv-witnesses-1"
FOLDER = files("sepv.reference") / "witnesses"


@dataclass(frozen=True)
class Witness:
    """A case and the violations that it showed."""

    id: str  # LAW/NUMBER
    systems: Systems
    found: str  # the scheme that gave the counterexample: a deliberately wrong one, or one without a claim to the law
    caught: tuple[str, ...]  # all schemes that violate the law in this case
    case: Case


@lru_cache(maxsize=64)
def witnesses(law: str, systems: Systems | None = None) -> tuple[Witness, ...]:
    """The witnesses of a law, for one class of systems or for all; empty for a law that has no file."""
    file = FOLDER / f"{law}.json"
    if not file.is_file():
        return ()
    data = json.loads(file.read_text(encoding="utf-8"))
    records = (
        Witness(w["id"], Systems(w["systems"]), w["found"], tuple(w["caught"]), of_valid(w["case"]))
        for w in data["witnesses"]
    )
    return tuple(w for w in records if systems in (None, w.systems))


def cases(law: str, systems: Systems) -> tuple[Case, ...]:
    """The cases of a law's witnesses in the order of the file: the case that catches most schemes comes first."""
    return tuple(w.case for w in witnesses(law, systems))
