"""The laws by name, in the order of the suite; stored reports with the present names of laws."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from typing import Any

from sepv.errors import UsageError
from sepv.law import Law, laws_in
from sepv.schemes import ALL_LAWS, FORMER_LAWS, LAWS, law_named, page_of, require_laws


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


def listed(names: str | Iterable[str]) -> Iterable[str]:
    """Split a string of names at its commas; a list of names is returned unchanged.
    A UsageError for anything else.
    """
    if not isinstance(names, Iterable):
        raise UsageError(
            expected="names of laws in a list, or with commas in a text",
            received=f"{names!r:.80}",
            remedy="see `sepv list`",
        )
    return names.split(",") if isinstance(names, str) else names


# Verdicts from the least to the most telling, for laws of a stored report that are one law now.
_TELLING = ("not_measured", "not_applicable", "holds", "inconclusive", "error", "violated")


def renamed(report: dict[str, Any]) -> dict[str, Any]:
    """A stored report with the present names of laws; of laws that are one now,
    it keeps the most telling verdict.
    """
    if not FORMER_LAWS.keys() & {law["law"] for law in report["laws"]}:
        return report
    found: dict[str, dict[str, Any]] = {}
    for law in sorted(report["laws"], key=lambda law: _TELLING.index(law["verdict"])):
        name = law_named(law["law"])
        found[name] = law | {"law": name}
    laws = [found[name] for name in ALL_LAWS if name in found]
    counts = {verdict: sum(law["verdict"] == verdict for law in laws) for verdict in report["counts"]}
    return report | {"laws": laws, "counts": counts, "suite": report["suite"] | {"laws": len(laws)}}
