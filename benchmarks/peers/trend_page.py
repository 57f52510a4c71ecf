"""The site's page about versions, in Markdown. It is made from the records alone,
so that it can be made again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from benchmarks.peers.changes import ABSENT_WORD, cell, changes, deviations, latest, solvers
from benchmarks.peers.records import ReleaseRecord
from sepv.console import markdown
from sepv.law import Verdict

# Half of ½, the lowest order of a consistent scheme: an error that falls with a larger slope has
# the limit 0.
LEAST_SLOPE = 0.25

TREND_INTRODUCTION = """\
This page shows in which version of a library a verdict on its Stratonovich solvers changed. Each version ran
unchanged in a fresh environment. A solver claims the orders that its documentation
states for commuting noise. The laws are *local-mean*, *local-mean-square*, *local-weak*, *mean-square-order* and
*right-limit*. If a verdict changed, a table names the claimed laws that do not hold or are undecided. The records,
`results/LIBRARY/VERSION.json`, have every verdict, defect, seed and package.

```sh
python -m benchmarks.peers.releases sdeint 0.2.4 0.3.0       # measure versions, and add their records
python -m benchmarks.peers.trend results --out docs/trend.md # make this page
```"""


def page(found: dict[str, list[ReleaseRecord]]) -> str:
    """The page of the records by library, as `benchmarks.peers.records.load` gives them."""
    parts = ["# Other libraries over their versions", TREND_INTRODUCTION]
    for library, records in found.items():
        parts += [f"## {library}", *_library(records)]
    return "\n\n".join(parts) + "\n"


def _library(records: Sequence[ReleaseRecord]) -> Iterator[str]:
    last = latest(records)
    found = changes(records)
    if found:
        alike: dict[tuple[str, ...], list[str]] = {}  # solvers with equal cells share a row
        for name in solvers(records):
            alike.setdefault(tuple(cell(r, name) for r in last), []).append(name)
        yield markdown(
            ["solver", *(r.version for r in last)],
            [("; ".join(names), *cells) for cells, names in alike.items()],
        )
        slow = [name for name, entry in last[-1].solvers.items() if _falls_slowly(entry)]
        if slow:
            yield (
                f"{', '.join(slow)}: *right-limit* extrapolates means by the order that is claimed. The error itself "
                "falls with h, by a lower order: the limit is not shown to be another one."
            )
    else:
        yield f"No verdict differs between versions {', '.join(r.version for r in last)} ([verdicts](compliance.md))."
    if found:
        yield "**What changed**"
        yield markdown(
            ["in", "after", "solver", "law", "before", "now", "other changes"],
            [
                (
                    c.version, c.since, c.solver, f"*{c.law}*" if c.law else "", _words(c.before), _words(c.after),
                    _few(c.besides),
                )
                for c in found
            ],
        )  # fmt: skip
    shown = deviations(records)
    if shown:
        yield "**Measurements that differ from the library's documentation** ([quotations](deviations.md))"
        yield markdown(
            ["script", "differs in", "agrees since"],
            [
                (
                    f"[`{d.script}`](peers/{d.script})", ", ".join(d.seen) or "none of these",
                    d.mended or ("not yet" if d.seen else "–"),
                )
                for d in shown
            ],
        )  # fmt: skip


def _falls_slowly(entry: dict[str, Any]) -> bool:
    """True if *right-limit* may be violated only because *mean-square-order* found an order that is
    too low.
    """
    limit, order = (entry["laws"].get(law) for law in ("right-limit", "mean-square-order"))
    both = limit and order and limit["verdict"] == order["verdict"] == Verdict.VIOLATED.value
    return bool(both and order["defect"] is not None and order["defect"] > LEAST_SLOPE)


def _few(besides: Sequence[str]) -> str:
    """The changes of the suite, Python and the numerical packages as text,
    and the number of other changes.
    """
    first = ("suite", "python", "machine", "jax", "torch", "numpy", "scipy")
    named = [b for b in besides if b.split()[0] in first]
    rest = len(besides) - len(named)
    return ", ".join(named + ([f"{rest} other packages"] if rest else [])) or "none"


def _words(verdict: str) -> str:
    known = {v.value: v.text for v in Verdict}
    return verdict if verdict == ABSENT_WORD else known.get(verdict, verdict)
