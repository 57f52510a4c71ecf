"""The laws by name, in the order of the suite: each is a file of `sepv.properties`."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from typing import Any

from sepv.errors import UsageError
from sepv.schemes import ALL_LAWS, FORMER, LAWS, OF_TWINS, law_named, page_of, require_laws
from sepv.verification._law import Law
from sepv.verification._profiles import Requirement, laws_for

# Laws that share the paths they draw (`Run.paths`): one process measures them, in this order.
SAMPLED = ("mean-square-order", "weak-order", "right-limit", "commutation")
# Laws that share the computed errors of one step (`Run.steps`).
LOCAL = ("local-mean", "local-mean-square", "local-weak")
# Laws measured first: they need a second or two, and show most faults. The contract is the very first: if every step
# sets the same global state, such as a seed, this no longer shows after the steps of another law.
MEASURED_FIRST = ("contract", "identity", "energy", "casimir")
# Laws that make more than this number of steps of single states are measured last, the most expensive law at the end.
MANY_STEPS = 2000


def load_laws(names: Iterable[str] | None = None) -> list[Law]:
    """Load laws by name, in the suite's order; by default all laws about one scheme.

    Raises
    ------
    UsageError
        For an unknown name.
    """
    wanted = LAWS if names is None else tuple(law_named(str(n)) for n in listed(names))
    require_laws(wanted)
    return [_loaded(name) for name in ALL_LAWS if name in wanted]


def _loaded(name: str) -> Law:
    module = import_module(f"sepv.properties.test_{page_of(name).replace('-', '_')}")
    return next(law for law in laws_in(module) if law.name == name)


def laws_in(module: Any) -> tuple[Law, ...]:
    """The laws of a file of `sepv.properties`: `laws`, if its law has parts, else `law`; empty for other modules."""
    found = getattr(module, "laws", (getattr(module, "law", None),))
    return tuple(law for law in found if isinstance(law, Law)) if isinstance(found, tuple) else ()


# Verdicts from the least to the most telling, for laws of a stored report that are one law now.
_TELLING = ("not_measured", "not_applicable", "holds", "inconclusive", "error", "violated")


def renamed(report: dict[str, Any]) -> dict[str, Any]:
    """A stored report with the present names of laws; of laws that are one now, it keeps the most telling verdict."""
    if not FORMER.keys() & {law["law"] for law in report["laws"]}:
        return report
    found: dict[str, dict[str, Any]] = {}
    for law in sorted(report["laws"], key=lambda law: _TELLING.index(law["verdict"])):
        name = law_named(law["law"])
        found[name] = law | {"law": name}
    laws = [found[name] for name in ALL_LAWS if name in found]
    counts = {verdict: sum(law["verdict"] == verdict for law in laws) for verdict in report["counts"]}
    return report | {"laws": laws, "counts": counts, "suite": report["suite"] | {"laws": len(laws)}}


def soonest(laws: Iterable[Law]) -> list[Law]:
    """Sort laws for a run: laws that show most faults first, costly ones last, and laws that share paths together."""
    asked = list(laws)
    steps = {law.name: law.spared or law.steps for law in asked}
    for family in (SAMPLED, LOCAL):
        own = [name for name in family if name in steps]
        steps |= dict.fromkeys(own, max(map(steps.__getitem__, own), default=0))
    return sorted(
        asked,
        key=lambda law: (law.name not in MEASURED_FIRST, steps[law.name] * (steps[law.name] > MANY_STEPS)),
    )


def laws_of(
    names: Iterable[str] | None = None, required: tuple[Requirement, ...] = (), *, twin: bool = False
) -> list[Law]:
    """Load the laws of a run, given by `names` or by `required` profiles; a UsageError if both are given.

    If the scheme has a `twin`, the laws about twins are measured too.
    """
    of_twins = OF_TWINS if twin else ()
    if not required:
        return (
            load_laws(names)
            if not twin
            else load_laws((*(LAWS if names is None else listed(names)), *of_twins))
        )
    if names is not None:
        raise UsageError(
            expected="profiles to require, or a list of laws",
            received="both",
            remedy="a profile brings its own laws; leave out one or the other",
        )
    return load_laws((*laws_for(required), *of_twins))


def listed(names: str | Iterable[str]) -> Iterable[str]:
    """Split a string of names at its commas; a list of names is returned unchanged. A UsageError for anything else."""
    if not isinstance(names, Iterable):
        raise UsageError(
            expected="names of laws in a list, or with commas in a text",
            received=f"{names!r:.80}",
            remedy="see `sepv list`",
        )
    return names.split(",") if isinstance(names, str) else names
