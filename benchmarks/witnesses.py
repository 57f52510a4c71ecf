"""Make the corpus of witnesses (stored counterexamples):
``python -m benchmarks.witnesses [--law NAME]... [-j N]``.

A law searches a counterexample for each saboteur that by theory it must accuse, and for each
built-in scheme that does not claim it, unless a case found before accuses the scheme. Each
simplified case is then tried on all these schemes, by class of systems. A few are kept: the one
that accuses most schemes (ties: the quicker, then the shorter), then the one that accuses most of
the rest. If a right scheme fails a case, the law is defective, and the run ends.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import time
import warnings
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from sepv.reference.vector import digest

from benchmarks import over, start
from sepv import schemes
from sepv.errors import SchemeFault, SepvError
from sepv.faults.saboteurs import SABOTEURS
from sepv.law import Case, Effort, Law, Run, Verdict, corpus
from sepv.law.cases.case import from_json, to_json
from sepv.problem import GivenProblem, Systems
from sepv.schemes import Scheme
from sepv.verification import load_laws

WITNESS_OUT = Path(__file__).resolve().parents[1] / "reference" / "witnesses"
# The most witnesses of a law and a class of systems; faults that they do not show are left to the
# search.
WITNESSES_MAX = 6
# The most checks for simplifying a counterexample.
SHRINK = 200


def made(name: str) -> dict[str, Any]:
    """The content of the file of witnesses of one law."""
    (law,) = load_laws([name])
    found = [entry for systems in Systems for entry in _of_class(law, systems)]
    entries = []
    for number, entry in enumerate(found, 1):
        numbered = {"id": f"{name}/{number:02}", **entry}
        entries.append({**numbered, "hash": digest(numbered)})
    return {"format": corpus.WITNESS_FORMAT, "law": name, "witnesses": entries}


def _of_class(law: Law, systems: Systems) -> list[dict[str, Any]]:
    """The witnesses of a law for one class of systems, in the order in which they are to be
    tried.
    """
    suspects = suspects_of(law, systems)
    candidates: dict[Case, str] = {}
    for name, scheme in suspects.items():
        if any(accused(law, scheme, case) for case in candidates):
            continue
        finding = law.run(law, scheme, Run(Effort(shrink_checks=SHRINK, corpus=False)))
        if finding.verdict is Verdict.VIOLATED and finding.witness is not None:
            case = from_json(finding.witness)
            if not isinstance(case.problem, GivenProblem) and _shows_alone(law.name, systems, name, case):
                candidates.setdefault(case, name)
    caught, seconds = {}, {}
    for case in candidates:
        start = time.perf_counter()
        _must_hold(law, systems, case)
        seconds[case] = time.perf_counter() - start
        caught[case] = frozenset(name for name, scheme in suspects.items() if accused(law, scheme, case))
    kept: list[Case] = []
    left = set().union(*caught.values()) if caught else set()
    while left and len(kept) < WITNESSES_MAX:
        best = max(caught, key=lambda c: (len(caught[c] & left), -round(seconds[c], 2), -_size(c)))
        kept.append(best)
        left -= caught[best]
    return [
        {"systems": systems, "found": candidates[c], "caught": sorted(caught[c]), "case": to_json(c)}
        for c in kept
    ]


def _shows_alone(law: str, systems: Systems, name: str, case: Case) -> bool:
    """True if a new process finds the violation in this case alone,
    because a scheme may remember earlier cases.
    """
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as fresh:
        return fresh.submit(_accused_by_name, law, systems, name, to_json(case)).result()


def _accused_by_name(name: str, systems: Systems, scheme: str, case: dict[str, Any]) -> bool:
    (law,) = load_laws([name])
    return accused(law, suspects_of(law, systems)[scheme], from_json(case))


def accused(law: Law, scheme: Scheme, case: Case) -> bool:
    """True if the law finds a violation in this case alone."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return law.replay(law, scheme, to_json(case)).verdict is Verdict.VIOLATED
        except (SchemeFault, SepvError):
            return False


def _must_hold(law: Law, systems: Systems, case: Case) -> None:
    for scheme in right(law, systems):
        finding = law.replay(law, scheme, to_json(case))
        if finding.verdict is Verdict.VIOLATED:
            raise SystemExit(f"{law.name} accuses {scheme.name}:\n{finding.message}")


def right(law: Law, systems: Systems) -> list[Scheme]:
    """Built-in schemes of the class that claim the law."""
    return [s for s in _built_in(systems) if law.claimed_by(s)]


def _built_in(systems: Systems) -> list[Scheme]:
    return [
        s for s in {**schemes.PAPER, **schemes.EXTENSIONS, **schemes.DAMPED}.values() if s.systems == systems
    ]


def _size(case: Case) -> int:
    return len(json.dumps(to_json(case)))


def searched_laws() -> list[str]:
    """The names of the laws that search cases of one step."""
    return [law.name for law in load_laws() if law.cases is not None]


def suspects_of(law: Law, systems: Systems) -> dict[str, Scheme]:
    """The saboteurs of the class that theory names for the law and that claim it,
    and built-in schemes that do not.
    """
    broken = (s for s in SABOTEURS.values() if law.name in s.caught_by and s.scheme.systems == systems)
    return {s.name: s.scheme for s in broken if law.claimed_by(s.scheme)} | {
        s.name: s for s in _built_in(systems) if not law.claimed_by(s)
    }


def text_of(data: dict[str, Any]) -> str:
    """The text of a file: a head, then one line for each witness."""
    head = json.dumps({k: v for k, v in data.items() if k != "witnesses"}, indent=1)[:-2]
    lines = ",\n".join(json.dumps(w, separators=(",", ":")) for w in data["witnesses"])
    return f'{head},\n "witnesses": [\n{lines}\n ]\n}}\n'


def main() -> None:
    """Write the files."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("--law", action="append", choices=searched_laws())
    parser.add_argument("-j", type=int, default=1, help="processes")
    options = parser.parse_args()
    WITNESS_OUT.mkdir(exist_ok=True)
    names = options.law or searched_laws()
    with ProcessPoolExecutor(options.j) as pool:
        results = pool.map(made, names)
        for name in over(names):
            data = next(results)
            if data["witnesses"]:
                (WITNESS_OUT / corpus.file_of(name)).write_text(text_of(data), encoding="utf-8")
            print(f"{name}: {len(data['witnesses'])} witnesses", flush=True)


if __name__ == "__main__":
    start(main)
