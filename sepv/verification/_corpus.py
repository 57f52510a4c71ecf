"""The corpus of witnesses: cases that caught a violation once, asked again before any search.

``reference/witnesses/LAW.json``, as its schema describes it; docs/vectors.md is for whoever reads it without Python. A
witness is a case of its law like any other: the law's own check measures it, with its own bound. So the corpus can
find a fault sooner, and can accuse nobody whom a search could not.
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
    """A case with what it caught."""

    id: str  # LAW/NUMBER
    systems: Systems
    found: str  # whose simplified counterexample it is: a saboteur, or a built-in scheme that does not claim the law
    caught: tuple[str, ...]  # all of them that this case accuses
    case: Case


@lru_cache(maxsize=64)
def witnesses(law: str, systems: Systems | None = None) -> tuple[Witness, ...]:
    """The witnesses of a law, of one class of systems or of all; none for a law that has no file."""
    file = FOLDER / f"{law}.json"
    if not file.is_file():
        return ()
    data = json.loads(file.read_text(encoding="utf-8"))
    found = (
        Witness(w["id"], Systems(w["systems"]), w["found"], tuple(w["caught"]), of_valid(w["case"]))
        for w in data["witnesses"]
    )
    return tuple(w for w in found if systems in (None, w.systems))


def cases(law: str, systems: Systems) -> tuple[Case, ...]:
    """Their cases, in the order of the file: what catches most comes first."""
    return tuple(w.case for w in witnesses(law, systems))
