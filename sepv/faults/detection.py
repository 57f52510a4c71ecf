"""Fault detection: run laws on saboteurs (schemes broken on purpose),
and count inputs to the first violation.

A law kills a saboteur with a seed if the saboteur claims the law and the verdict is `violated`. A
fault of the interface, or a faulty port, is also killed by the verdict `error`, which no reader
mistakes for a pass.
"""

from __future__ import annotations

import multiprocessing
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from statistics import median
from typing import Any

from rich.console import Console
from rich.text import Text

from sepv._arguments import did_you_mean
from sepv.console import Table, columns, fits, print_table
from sepv.errors import require_one_of
from sepv.law import Effort, Finding, Law, Run, Verdict
from sepv.schemes import Scheme
from sepv.verification import ALL_LAWS, along_paths, load_laws, measure
from sepv.workers import ended_at_once

from .saboteurs import SABOTEURS, Saboteur

SEEDS = tuple(range(10))
# The time limit of one law in seconds. A law takes one to ten; a slower saboteur ends in an error.
DETECTION_TIMEOUT = 120.0
# No checks are spent on simplifying a counterexample. So `Finding.checks` is the number of examples
# up to and including the first failure.
_NO_SHRINKING = 0
# The families of saboteurs with broken interfaces, for which an error is a finding.
BY_ERROR = ("interface", "twins")


@dataclass(frozen=True)
class Detection:
    """The verdict of one law on one saboteur, a scheme broken on purpose, with one seed."""

    saboteur: str
    family: str
    law: str
    seed: int
    verdict: Verdict
    claimed: bool
    expected: bool  # True if the saboteur's `caught_by` names the law
    examples: int  # measured examples, or paths: up to the first failure, if there was one
    seconds: float
    message: str = ""

    @property
    def kills(self) -> bool:
        """True if this law finds this fault: the saboteur claims the law,
        and the verdict is `violated`.

        A fault of the families `BY_ERROR` is also found by the verdict `error`.
        """
        by_error = self.verdict is Verdict.ERROR and self.family in BY_ERROR
        return self.claimed and (self.verdict is Verdict.VIOLATED or by_error)

    def to_json(self) -> dict[str, Any]:
        """The fields as a JSON object, for a file beside the table."""
        return {**self.__dict__, "verdict": self.verdict.value, "kills": self.kills}


FaultProgress = Callable[[int, int, Sequence[Detection]], None]


def run(
    names: Iterable[str] | None = None,
    seeds: Iterable[int] = SEEDS,
    progress: FaultProgress | None = None,
    *,
    laws: Iterable[str] | None = None,
    effort: Effort | None = None,
    first: bool = False,
    workers: int = 2,
) -> list[Detection]:
    """Run laws on saboteurs, each saboteur and seed in a worker process.
    Raises UsageError for an unknown name.

    `progress` is called in this process after each saboteur and seed. The default effort is that of
    `sepv verify`, but without the stored counterexamples, many of which come from saboteurs and
    would not test the search. If `first` is true, a saboteur's laws stop once a law finds the
    fault; laws that find it by theory run first.
    """
    chosen = [find(name) for name in (SABOTEURS if names is None else names)]
    law_names = [law.name for law in load_laws(ALL_LAWS if laws is None else laws)]
    budget = effort or Effort(corpus=False)
    how = (law_names, budget.examples, budget.paths, first, budget.corpus)
    jobs = [(s.name, seed, *how) for seed in seeds for s in chosen]
    detections: list[Detection] = []
    # Workers are spawned, because a saboteur may leave anything in the memory of its process.
    context = multiprocessing.get_context("spawn")
    with ended_at_once(ProcessPoolExecutor(max_workers=workers, mp_context=context)) as pool:
        futures = [pool.submit(detect, *job) for job in jobs]
        for done, future in enumerate(as_completed(futures), start=1):
            detections += future.result()
            if progress:
                progress(done, len(jobs), future.result())
    order = {name: n for n, name in enumerate((*(s.name for s in chosen), *law_names))}
    return sorted(detections, key=lambda b: (order[b.saboteur], order[b.law], b.seed))


def detect(
    name: str, seed: int, laws: Sequence[str], examples: int = 100, paths: int = 4096, first: bool = False,
    corpus: bool = False,
) -> list[Detection]:  # fmt: skip
    """Run laws on a newly made saboteur, with one seed and in this process."""
    saboteur = find(name)
    scheme, run = saboteur.scheme, Run(Effort(examples, paths, seed, _NO_SHRINKING, corpus=corpus))
    if first:
        # *rounding* keeps steps of its paths, on which laws asked before may find the fault.
        order = [*(law for law in ALL_LAWS if law in saboteur.caught_by), "rounding", *ALL_LAWS]
        laws = sorted(laws, key=order.index)
    measured, findings = list[Law](), dict[str, Finding]()

    def detections() -> list[Detection]:
        return [_detection(saboteur, seed, law, findings[law.name], scheme) for law in measured]

    for chosen in laws:
        measured += load_laws([chosen])
        findings[chosen] = measure(measured[-1], scheme, run, DETECTION_TIMEOUT)
        if first and findings[chosen].along:
            along_paths(scheme, measured, findings, name, DETECTION_TIMEOUT)
        if first and any(d.kills for d in detections()):
            break
    else:
        along_paths(scheme, measured, findings, name, DETECTION_TIMEOUT)
    return detections()


def _detection(saboteur: Saboteur, seed: int, law: Law, finding: Finding, scheme: Scheme) -> Detection:
    message = finding.message if finding.verdict is Verdict.ERROR else ""
    return Detection(
        saboteur.name, saboteur.family, law.name, seed, finding.verdict, law.claimed_by(scheme),
        law.name in saboteur.caught_by, finding.checks, round(finding.seconds, 3), message,
    )  # fmt: skip


def find(name: str) -> Saboteur:
    """The saboteur of this name. Raises UsageError for an unknown name."""
    require_one_of("a saboteur", name, SABOTEURS, "take one of these names", did_you_mean(name, SABOTEURS))
    return SABOTEURS[name]


def survivors(detections: Sequence[Detection]) -> dict[str, list[int]]:
    """Map each saboteur to the seeds with which no claimed law found its fault;
    others are left out.
    """
    killed = {(b.saboteur, b.seed) for b in detections if b.kills}
    by_saboteur: dict[str, list[int]] = {}
    for name, seed in sorted({(b.saboteur, b.seed) for b in detections} - killed):
        by_saboteur.setdefault(name, []).append(seed)
    return by_saboteur


def found_by_one_law(detections: Sequence[Detection]) -> dict[str, list[str]]:
    """Map each law to the saboteurs whose faults only this law found, with any seed."""
    kills = dict.fromkeys((b.saboteur, b.law) for b in detections if b.kills)
    laws = Counter(name for name, _ in kills)
    by_law: dict[str, list[str]] = {}
    for name, law in kills:
        if laws[name] == 1:
            by_law.setdefault(law, []).append(name)
    return by_law


def missed(detections: Sequence[Detection]) -> list[tuple[str, str]]:
    """Pairs (saboteur, law) where theory says that the law finds the fault,
    but it did so with no seed.
    """
    seen = {(b.saboteur, b.law) for b in detections if b.kills}
    return [p for p in dict.fromkeys((b.saboteur, b.law) for b in detections if b.expected) if p not in seen]


def examples_to_kill(detections: Sequence[Detection]) -> dict[tuple[str, int], int]:
    """Map (saboteur, seed) to the fewest examples after which a law found the fault;
    faults not found are left out.
    """
    fewest: dict[tuple[str, int], int] = {}
    for b in detections:
        if b.kills:
            key = b.saboteur, b.seed
            fewest[key] = min(fewest.get(key, b.examples), b.examples)
    return fewest


def show(detections: Sequence[Detection], out: Console) -> None:
    """Print the matrix of saboteurs and laws, its legend,
    pairs that theory expects but are missing, and a count.
    """
    laws, table = list(dict.fromkeys(b.law for b in detections)), matrix(detections)
    wide = not fits(table, out)
    print_table(listing(detections) if wide else table, out)
    out.print(
        Text("number: median examples (or paths) to the first violation; (number): not with every seed")
    )
    out.print(Text("·: holds, ?: inconclusive, e: error, n/a: not applicable; *: unclaimed"))
    if not wide:
        out.print(Text(", ".join(f"{abbreviation(law)} {law}" for law in laws)))
    # If `first` was true, some saboteur was not run against some law with some seed.
    runs = {(b.saboteur, b.seed) for b in detections}
    if len({(b.saboteur, b.seed, b.law) for b in detections}) == len(runs) * len(laws):
        for law, names in found_by_one_law(detections).items():
            out.print(Text(f"only {law} kills: {', '.join(names)}"))
        pairs = missed(detections)
        if pairs:
            out.print(Text(f"expected, never seen: {', '.join(f'{name} by {law}' for name, law in pairs)}"))
    out.print(summary(detections))


def matrix(detections: Sequence[Detection]) -> Table:
    """A table of saboteurs and laws; the last column counts the seeds with which a law found the
    fault.
    """
    laws = list(dict.fromkeys(b.law for b in detections))
    heads = columns(["saboteur"], [*map(abbreviation, laws), "killed"])
    rows = _rows(detections)
    return Table(
        heads, [[name, *(cells.get(law, "") for law in laws), killed] for name, killed, cells in rows]
    )


def listing(detections: Sequence[Detection]) -> Table:
    """A table for narrow terminals: for each saboteur, the laws that do not hold for it."""
    rows: list[tuple[str, Text, Text]] = []
    for name, killed, cells in _rows(detections):
        killers = ((law, cell) for law, cell in cells.items() if cell.plain.strip("*") not in ("·", "n/a"))
        rows.append((name, killed, Text(", ").join(Text(f"{law} ") + cell for law, cell in killers)))
    return Table((*columns(["saboteur"], ["killed"]), *columns(["laws"], words=True)), rows)


def _rows(detections: Sequence[Detection]) -> Iterator[tuple[str, Text, dict[str, Text]]]:
    """For each saboteur its name, the number of seeds with which it was found,
    and a table cell for each law.
    """
    alive, by_law = survivors(detections), dict[str, dict[str, list[Detection]]]()
    for b in detections:
        by_law.setdefault(b.saboteur, {}).setdefault(b.law, []).append(b)
    for name, laws in by_law.items():
        seeds = len({b.seed for seen in laws.values() for b in seen})
        killed = seeds - len(alive.get(name, []))
        count = Text(f"{killed}/{seeds}", style="green" if killed == seeds else "bold red")
        yield name, count, {law: _cell(seen) for law, seen in laws.items()}


def summary(detections: Sequence[Detection]) -> Text:
    """The last line of the report: how many saboteurs were found with every seed,
    and after how many examples.
    """
    names, alive = {b.saboteur for b in detections}, survivors(detections)
    fewest = examples_to_kill(detections)
    seeds = len({b.seed for b in detections})
    text = Text(f"{len(names) - len(alive)} of {len(names)} saboteurs killed with each of {seeds} seeds")
    if fewest:
        worst = max(fewest, key=lambda key: fewest[key])
        text.append(
            f"; examples to the quickest law: median {median(fewest.values()):g}, "
            f"largest {fewest[worst]} ({worst[0]}, seed {worst[1]})"
        )
    text.append(".")
    for name, left in alive.items():
        which = "every seed" if len(left) == seeds else f"seed {', '.join(map(str, left))}"
        text.append(f"\nsurvives: {name}, {which}: {SABOTEURS[name].broken}", style="bold red")
    return text


def abbreviation(law: str) -> str:
    """The abbreviation of a law's name: the initials of several words,
    or the first letters of one word, at least 3.

    The initial of a part comes after a colon.
    """
    if ":" in law:
        whole, _, part = law.partition(":")
        return f"{abbreviation(whole)}:{part[0]}"
    words = law.split("-")
    if len(words) > 1:
        return "".join(w[0] for w in words)
    alone = [name for name in ALL_LAWS if not {"-", ":"} & set(name)]
    lengths = range(3, len(law) + 1)
    return next(law[:n] for n in lengths if n == len(law) or sum(o.startswith(law[:n]) for o in alone) < 2)


# Signs and styles of verdicts by precedence; a cell shows the first of these verdicts that
# occurred.
_VERDICT_SIGNS = {
    Verdict.ERROR: ("e", "magenta"), Verdict.INCONCLUSIVE: ("?", "yellow"), Verdict.NOT_APPLICABLE: ("n/a", "dim")
}  # fmt: skip


def _cell(detections: Sequence[Detection]) -> Text:
    failing = [b for b in detections if b.verdict is Verdict.VIOLATED]
    if failing:
        number = f"{median(b.examples for b in failing):.0f}"
        text, style = number if len(failing) == len(detections) else f"({number})", "green"
    else:
        verdicts = {b.verdict for b in detections}
        text, style = next((shown for v, shown in _VERDICT_SIGNS.items() if v in verdicts), ("·", "dim"))
    claimed = detections[0].claimed
    return Text(text if claimed else f"{text}*", style=style if claimed else "dim")
