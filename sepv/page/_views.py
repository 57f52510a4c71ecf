"""Views (data for the template of the page) of comparisons, benchmarks and reproductions.
Nothing here is HTML.

Views of reports are in `_verdicts`.
"""

from __future__ import annotations

import math
import shlex
from typing import Any

from sepv._arguments import hex_float
from sepv.console import statements_in_words
from sepv.page._pictures import Pictures
from sepv.page._sources import Sources
from sepv.page._text import name, number, plain
from sepv.pictures import DRAWN_ZERO, Axis, Series, power
from sepv.schemes import Look

SIGN_AND_WORD = {
    "holds": ("✓", "holds"), "violated": ("✗", "violated"), "inconclusive": ("?", "inconclusive"),
    "not_applicable": ("·", "not applicable"), "error": ("!", "error"), "not_measured": ("", "not measured"),
    "absent": ("", "not measured"),
    "fails": ("✗", "does not hold"), "open": ("?", "open"),
}  # fmt: skip


View = dict[str, Any]


def again(data: View, subject: str) -> str:
    """Return the command that a JSON file names as its origin,
    or a comment if no command made the file.

    Each word is quoted for the shell, which therefore executes no text of the file if somebody runs
    the line.
    """
    words = words_of(str(data.get("made", {}).get("command") or ""))
    if words[:1] != ["sepv"]:
        return f"# {subject} was written in Python: no command makes it again"
    return plain(shlex.join(words), 8200)


def words_of(command: str) -> list[str]:
    """Split a command into words as a shell does. If its quotes do not match, the list is empty."""
    try:
        return shlex.split(command)
    except ValueError:
        return []


def cell(verdict: str, claimed: bool = False) -> View:
    """Return a cell of the table of schemes and laws: the verdict's sign and words,
    and True for a claimed law.
    """
    sign, words = SIGN_AND_WORD[verdict]
    return {"kind": verdict, "sign": sign, "words": words, "claimed": claimed}


def step_size(h: float) -> str:
    """Format a step size h: as a power of two, if it is one and h < ½,
    and with three digits otherwise.
    """
    exponent = math.log2(h) if h > 0 else 0.5
    return power(h, 2) if exponent == int(exponent) and exponent < -1 else number(h)


def priced(points: list[View]) -> list[View]:
    """Return a method's points from the first one where doubling the steps takes at least 1.5 times
    the time.

    At points with fewer steps the overhead of a call dominates the time. The last two points are
    always returned.
    """
    if not points or not points[0].get("steps"):
        return points
    ordered = sorted(points, key=lambda p: int(p["steps"]))
    while len(ordered) > 2:
        a, b = ordered[0], ordered[1]
        growth = math.log2(b["seconds"]["median"] / b["paths"] / (a["seconds"]["median"] / a["paths"]))
        if growth >= math.log2(1.5) * math.log2(b["steps"] / a["steps"]):
            break
        ordered = ordered[1:]
    return ordered


def drawn(sources: Sources) -> tuple[list[str], dict[str, Look]]:
    """Return the names of all schemes in the plots of a page, and the line styles (`Look`)
    that files give them.
    """
    methods = [m for c in sources.compare for m in c["methods"]]
    names = [m["name"] for m in methods]
    names += [
        s.get("group") or s["scheme"] for r in sources.reproduce for p in r["panels"] for s in p["series"]
    ]
    return names, {m["name"]: Look(**m["look"]) for m in methods if "look" in m}


def comparison(data: View, pictures: Pictures) -> View:
    """Return the view of a comparison: two plots, the points, the times to given errors,
    and the machine.
    """
    methods = [m["name"] for m in data["methods"]]
    points = [p for p in data["points"] if p["failures"] < p["paths"]]
    by_method = {m: [p for p in points if p["method"] == m] for m in methods}

    def micro(p: View) -> float:
        return float(p["seconds"]["median"] / p["paths"] * 1e6)

    def curve(m: str, value: Any) -> Series:
        of_method = priced(by_method[m])
        return Series(m, [micro(p) for p in of_method], [value(p) for p in of_method], m, "both")

    time = Axis("processor time of one path in µs", log=True)

    def drawn(label: str, value: Any) -> Any:
        return pictures.draw([curve(m, value) for m in methods], time, Axis(label, log=True))

    errors = drawn("strong error at T", lambda p: p["strong_error"]["value"])
    # A defect of zero has no logarithm. It is drawn at DRAWN_ZERO, half a rounding of one, as the
    # caption says.
    defects = drawn(
        "largest energy defect",
        lambda p: None if p["energy_defect"] is None else max(p["energy_defect"], DRAWN_ZERO),
    )
    return {
        "problem": name(data["problem"]),
        "T": number(data["T"]),
        "errors": errors,
        "defects": defects,
        "methods": [(name(m["name"]), plain(m["source"], 160)) for m in data["methods"]],
        "rows": [_point(p, micro(p)) for p in points],
        "times": _times(data["times_to_error"], methods),
        "wanted": [number(e) for e in sorted({t["error"] for t in data["times_to_error"]}, reverse=True)],
        "environment": [(plain(k, 40), plain(v, 120)) for k, v in data["environment"].items()],
        "command": again(data, "the comparison"),
        "seed": data["seed"],
        "repeats": data["repeats"],
    }


def _point(p: View, micro: float) -> View:
    """Return the row of a table for one method and step size;
    `micro` is the time of one path in µs.
    """
    error = p["strong_error"]
    return {
        "method": name(p["method"]),
        "h": step_size(p["h"]),
        "error": f"{number(error['value'])} [{number(error['low'])}, {number(error['high'])}]",
        "energy": number(p["energy_defect"]),
        "casimir": number(p["casimir_defect"]),
        "micro": number(micro),
        "evaluations": ", ".join(f"{number(v)} {plain(k, 30)}" for k, v in p["evaluations_per_step"].items()),
        "iterations": number(p["iterations_per_step"]),
        "failures": p["failures"] or "",
    }


def _times(times: list[View], methods: list[str]) -> list[tuple[str, list[str]]]:
    """Return the rows of a table: a method, and the times that it takes to reach each of several
    errors.
    """
    wanted = sorted({t["error"] for t in times}, reverse=True)
    words = {"between": "", "beyond": " (extrapolated)", "coarsest": " (at the coarsest step)"}
    rows = []
    for m in methods:
        by_error = {t["error"]: t for t in times if t["method"] == m}
        reached = {e: t for e, t in by_error.items() if t["microseconds"] is not None}
        times_of = {e: number(t["microseconds"]) + words.get(t["how"], "") for e, t in reached.items()}
        rows.append((name(m), [times_of.get(e, "never") for e in wanted]))
    return rows


def bench(data: View) -> View:
    """Return the view of a benchmark: for each target, a row per case with its counters,
    rms error and rms defects.
    """
    kinds = list(dict.fromkeys(k for r in data["records"] for case in r["cases"] for k in case["counters"]))

    def rms(groups: list[str]) -> str:
        values = [hex_float(v) for v in groups]
        return number((sum(values) / max(1, len(values))) ** 0.5)

    def row(c: View) -> View:
        case, counters = c["case"], c["counters"]
        return {
            "case": name(case["name"]),
            "size": f"{step_size(case['h'])}, {case['steps']}, {case['paths']}",
            "counters": ["–" if counters.get(k) is None else counters[k] for k in kinds],
            **{key: rms(c[key]) for key in ("error", "energy", "casimir")},
        }

    return {
        "kinds": [name(k) for k in kinds],
        "environment": [(plain(k, 40), plain(v, 120)) for k, v in data["environment"].items()],
        "records": [
            {"target": name(r["target"]), "rows": list(map(row, r["cases"]))} for r in data["records"]
        ],
        "command": again(data, "the benchmark"),
    }


def reproduction(data: View, pictures: Pictures) -> View:
    """Return the view of a reproduction of a paper: its panels with their plots and statements."""
    return {
        "about": {k: plain(v, 60) if isinstance(v, str) else v for k, v in data["reproduction"].items()},
        "of": plain(data["reproduction"]["of"], 300),
        "counts": statements_in_words(data["counts"]),
        "panels": [_panel(p, pictures) for p in data["panels"]],
        "text": [_statement(s) for s in data["text"]],
        "command": again(data, "the reproduction"),
    }


def _panel(p: View, pictures: Pictures) -> View:
    curves = [Series(**s) for s in p["series"]]
    x, y = (Axis(plain(p[k]["label"], 60), p[k]["log"]) for k in ("x", "y"))
    statements = [_statement(s) for s in p["statements"]]
    held = [s for s in statements if s["cell"]["kind"] == "holds"]
    return {
        **{key: plain(p[key], most) for key, most in (("title", 120), ("source", 120), ("description", 400))},
        "chosen": [plain(c, 300) for c in p["chosen"]],
        "statements": statements,
        "held": held,
        "holding": len(held),
        "plot": pictures.draw(curves, x, y, slopes=p["slopes"], equal=p["equal"], window=p["window"]),
    }


def _statement(s: View) -> View:
    return {
        "cell": cell(s["verdict"]),
        **{key: plain(s[key], 600) for key in ("text", "source", "measured", "criterion", "correction")},
    }
