"""Views (data for the template of the page) of reports: verdicts on a scale of bounds,
and counterexamples.

Nothing here is HTML.
"""

from __future__ import annotations

import math
import shlex
from typing import Any

from sepv.console import counted
from sepv.errors import UsageError
from sepv.law import Verdict, has_words, same_error, to_bound, verdict_text
from sepv.page._text import name, number, plain
from sepv.page._views import View, again, cell, words_of
from sepv.pictures import power
from sepv.properties import load_laws
from sepv.schemes import ALL_LAWS

# The largest number of characters of all counterexamples on a page; ROOMY_BUDGET on a page of at
# most ROOMY_MAX_SCHEMES schemes, which has pictures of them too. The JSON files have all
# counterexamples.
COUNTEREXAMPLES_BUDGET, ROOMY_BUDGET, ROOMY_MAX_SCHEMES = 17_000, 100_000, 4
# Decades of the scale of defects, from 10⁻³ of the bound to 10³ or up to 10¹⁵, with a tick for
# every third decade.
LEAST_DECADE, LAST_DECADE, TICK_DECADES = -3, 15, 3
# The frame (left, right, top, bottom) of a picture of a repeated step, in a box of 300 by 190.
FRAME = (62.0, 296.0, 20.0, 168.0)
# The least height of the frame of an invariant, relative to its terms, so that rounding looks like
# a straight line.
LEAST_FRAME_HEIGHT = 1e-13


def schemes(reports: list[View]) -> tuple[list[str], list[View]]:
    """Return the names of all laws, those unknown to sepv last,
    and a list with a view of each report.
    """
    laws = list(dict.fromkeys(law["law"] for r in reports for law in r["laws"]))
    laws.sort(key=lambda law: ALL_LAWS.index(law) if law in ALL_LAWS else len(ALL_LAWS))
    share = (ROOMY_BUDGET if len(reports) <= ROOMY_MAX_SCHEMES else COUNTEREXAMPLES_BUDGET) // max(
        1, len(reports)
    )
    return laws, [_scheme(r, laws, share, drawn=len(reports) <= ROOMY_MAX_SCHEMES) for r in reports]


def _scheme(report: View, laws: list[str], budget: int, *, drawn: bool) -> View:
    """Return the view of one scheme: its verdicts, its laws on an axis of defects,
    and its counterexamples.
    """
    by_law = {law["law"]: law for law in report["laws"]}
    counts = ", ".join(Verdict(k).of(n) for k, n in report["counts"].items() if n)
    shown, left = _counterexamples(report["laws"], _target(report["scheme"]), budget, drawn=drawn)
    at = {law: n for n, entry in enumerate(shown, 1) for law in entry["laws"]}
    scheme, place, ticks = name(report["scheme"]["name"]), *_scale(report["laws"])
    return {
        "name": scheme,
        "source": plain(report["scheme"]["source"], 200),
        "cells": [
            cell(by_law[law]["verdict"], by_law[law]["claimed"]) if law in by_law else cell("absent")
            for law in laws
        ],
        "rows": [_row(law, place) | {"at": at.get(law["law"])} for law in report["laws"]],
        "ticks": ticks,
        "counterexamples": shown,
        "left_out": left,
        "unsettled": _unsettled(report["laws"]),
        "summary": f"{counted(len(report['laws']), 'law')}: {counts}{_profiles(report)}",
        "made": _made(report),
        "command": again(report, f"the report of {scheme}"),
    }


def _profiles(report: View) -> str:
    """Describe the profiles (named sets of laws) that a report found, those required and not found,
    and waived laws.
    """
    profiles = report.get("profiles")
    if profiles is None:
        return "; it was written before sepv knew profiles: measure again for them"
    waived = f"; waived: {', '.join(profiles['waived'])}" if profiles["waived"] else ""
    lacking = [n for n in profiles["required"] if n not in profiles["found"]]
    why = [f"{n} ({profiles['not_found'].get(n, 'not measured')})" for n in lacking]
    required = f"; required and not found: {', '.join(why)}" if why else ""
    return plain(f"; found: {', '.join(profiles['found']) or 'no profile'}{waived}{required}", 900)


def _made(report: View) -> str:
    """Describe the versions and the effort (seed, examples, paths) with which a report was made."""
    made, suite = report.get("made", {}), report["suite"]
    packages = [key for key in ("python", "numpy", "scipy", "hypothesis", "mpmath") if key in made]
    versions = [f"sepv {suite['version']}", *(f"{key} {made[key]}" for key in packages)]
    versions += [str(made["platform"])] if "platform" in made else []
    effort = [f"seed {suite['seed']}", f"{suite['examples']} examples", f"{suite['paths']} paths at most"]
    return plain(", ".join(versions) + "; " + ", ".join(effort), 400)


def _scale(laws: list[View]) -> tuple[Any, list[tuple[str, str]]]:
    """Return the axis of defects of a report: the function from a law to its place,
    and the ticks as (place, words).

    A place is in per cent of the axis's width.
    """
    ratios = [r for r in map(_ratio, laws) if r is not None and 0 < r < math.inf]
    top = math.ceil(math.log10(max([*ratios, 1.0])) / TICK_DECADES) * TICK_DECADES
    high = min(LAST_DECADE, max(TICK_DECADES, top))

    def percent(decade: float) -> str:
        inside = (min(max(decade, LEAST_DECADE), high) - LEAST_DECADE) / (high - LEAST_DECADE)
        return f"{5 + 90 * inside:.1f}".removesuffix(".0")

    def place(law: View) -> str | None:
        ratio = _ratio(law)
        if ratio is None:
            return None
        return percent(math.log10(ratio) if 0 < ratio < math.inf else math.copysign(math.inf, ratio - 1))

    decades = (
        range(LEAST_DECADE, high + 1, TICK_DECADES) if any(_ratio(law) is not None for law in laws) else ()
    )
    return place, [(percent(k), "bound" if k == 0 else power(10.0**k, 10)) for k in decades]


def _ratio(law: View) -> float | None:
    """Return the defect of a law in units of its bound."""
    violated = law["verdict"] == "violated"
    return to_bound(law["defect"], law["bound"], at_least=law["at_least"], violated=violated)


def shown_verdict(law: View) -> str:
    """Return the verdict of a law in words; "expected" for a law that is violated as expected."""
    if law["expected"] is not None and law["verdict"] == "violated":
        return "expected"
    return verdict_text(Verdict(law["verdict"]), law.get("share"), law.get("afresh", ""))


def _row(law: View, place: Any) -> View:
    """Return the row of a law in a scheme's table, with its place on the axis of defects."""
    bound = "" if law["bound"] is None else f"{'≥' if law['at_least'] else '≤'} {number(law['bound'])}"
    claimed = "expected to fail" if law["expected"] is not None else "claimed" if law["claimed"] else ""
    shown = cell(law["verdict"], law["claimed"])
    return {
        "law": name(law["law"]),
        "anchor": f"law-{law['law']}" if law["law"] in ALL_LAWS else "",
        "cell": shown | {"words": shown_verdict(law)},
        "claimed": claimed,
        "place": place(law),
        "defect": number(law["defect"]),
        "bound": bound,
        "unit": plain(law["unit"], 40),
        "source": plain(law["source"], 60),
    }


def _counterexamples(laws: list[View], target: str, budget: int, *, drawn: bool) -> tuple[list[View], int]:
    """Return the counterexamples that fit into `budget` characters, and the number left out.

    Claimed laws come first, and those that are violated as expected last.

    Laws that end with the same error share one entry. If `drawn`, an entry has pictures of the
    counterexample.
    """
    failures = [law for law in laws if law["verdict"] in ("violated", "error") and law["message"]]
    shown: list[View] = []
    shown_once: dict[str, View] = {}
    left = 0
    for law in sorted(failures, key=lambda v: (v["expected"] is not None, not v["claimed"])):
        error = same_error(law["message"]) if law["verdict"] == "error" else ""
        if error in shown_once:
            shown_once[error]["laws"].append(law["law"])
            continue
        # A command is for copying, so it is shown in full or not at all.
        copied = target and law["replay"] and len(law["replay"]) < 4000 and has_words(law["witness"])
        command = (
            shlex.join(["sepv", "verify", *words_of(target), *words_of(law["replay"])]) if copied else ""
        )
        entry = {
            "laws": [law["law"]], "law": name(law["law"]), "source": plain(law["source"], 60),
            "verdict": cell(law["verdict"])["words"], "claimed": law["claimed"], "message": plain(law["message"]),
            "command": plain(command, 8200),
            "course": _course(law["course"], law["unit"]) if drawn and "course" in law else None,
        }  # fmt: skip
        budget -= len(entry["message"]) + len(entry["command"])
        if budget < 0 and not (law["claimed"] and not shown):
            left += 1
            continue
        shown.append(entry)
        shown_once |= {error: entry} if error else {}
    return shown, left


def _course(course: View, unit: str) -> View | None:
    """Return two pictures of a counterexample whose step is repeated: two components of y,
    and what the law measures.

    That is an invariant's change, or the law's own defect and bound in its unit. The result is None
    if there is nothing to draw.
    """
    steps, conserved = len(course["drift"]) - 1, course["kept"]
    names = [f"component {i}" for i in course["components"]]
    path, exact = course["states"], course["exact"]
    if len(path) == 1:  # one component is drawn over the steps
        names, path = ["step", *names], [list(range(steps + 1)), *path]
        exact = (
            [[n * steps / (len(exact[0]) - 1 or 1) for n in range(len(exact[0]))], *exact] if exact else []
        )
    unit, beside = plain(unit, 40), ["the exact solution"] if exact else []
    defects, bounds = (
        [list(range(len(v))), v] for v in (course.get("defects", []), course.get("bounds", []))
    )
    if measured := _panel(defects, bounds, ["step", f"defect in {unit}"], 0.0):
        said = f"the defect of a step is {_largest(course['defects'])} {unit} at most"
        beside.append("the law's bound")
    else:
        drift, flat = [list(range(steps + 1)), course["drift"]], [[0, steps], [0.0, 0.0]] if exact else []
        label = f"{conserved}(y) − {conserved}(y₀)"
        measured = _panel(drift, flat, ["step", label], LEAST_FRAME_HEIGHT * (course["size"] or 0))
        said = f"{conserved} changes by {_largest(course['drift'])} at most"
    panels = [_panel(path, exact, names, 0.0), measured]
    if None in panels:
        return None
    words = f"{counted(steps, 'time')} the step of the counterexample, from its state; {said}"
    return {
        "panels": panels,
        "beside": " and ".join(beside),
        "words": words,
        "ended": plain(course["ended"], 200),
    }


def _largest(values: list[Any]) -> str:
    return number(max((abs(v) for v in values if v is not None), default=0.0))


def _panel(curve: list[Any], beside: list[Any], names: list[str], least: float) -> View | None:
    """Return the view of a panel: SVG paths of `curve` and of the dashed curve `beside`,
    and texts for the axes' ends.

    The result is None if `curve` has fewer than two points. Values above 1e300, whose range may
    overflow, are left out.
    """

    def drawable(coordinates: list[Any]) -> list[Any]:
        pairs = zip(*coordinates, strict=False) if len(coordinates) == 2 else ()
        return [p for p in pairs if all(v is not None and abs(v) < 1e300 for v in p)]

    main, other = drawable(curve), drawable(beside)
    if len(main) < 2:
        return None
    (left, right), (low, high) = ((min(v), max(v)) for v in zip(*main, *other, strict=True))
    if high - low < least:
        low, high = (low + high - least) / 2, (low + high + least) / 2

    def at(value: float, least: float, most: float, begin: float, end: float) -> float:
        share = (value - least) / (most - least) if most > least else 0.5
        return begin + (end - begin) * (0.05 + 0.9 * share)

    def points(pairs: list[Any]) -> list[str]:
        begin, end, top, bottom = FRAME
        return [f"{at(a, left, right, begin, end):.1f} {at(b, low, high, bottom, top):.1f}" for a, b in pairs]

    dots = points(main)
    ends = [(v, right - left) for v in (left, right)] + [(v, high - low) for v in (low, high)]
    return {
        "line": "M" + "L".join(dots), "dots": "".join(f"M{p}h0" for p in dots), "first": "M" + "L".join(dots[:2]),
        "start": f"M{dots[0]}h0",
        "beside": "M" + "L".join(points(other)) if other else "", "x": names[0], "y": names[1],
        # An end that is a rounding relative to the range is shown as 0.
        "ends": [number(v if abs(v) > 1e-12 * span else 0.0) for v, span in ends],
    }  # fmt: skip


def _unsettled(laws: list[View]) -> list[str]:
    """Return a sentence for each inconclusive law: its message."""
    unsettled = []
    for law in laws:
        if law["verdict"] == "inconclusive":
            lines = [line for line in law["message"].splitlines() if not line.startswith("intervals miss")]
            text = "; ".join(lines) or "no reason was given"
            unsettled.append(f"{name(law['law'])}: {plain(text, 700)}.")
    return unsettled


def _target(scheme: View) -> str:
    """Return the text that names the scheme in a command: its target, its name if it is built in,
    or else "".
    """
    from sepv.schemes import by_name

    if scheme.get("target"):
        return str(scheme["target"])
    try:
        return by_name(str(scheme["name"])).name
    except UsageError:
        return ""


def headline(reports: list[View]) -> str:
    """Summarise all reports: the number of claimed laws that hold,
    and the claimed laws that are not shown to hold.
    """
    claimed = [(r, law) for r in reports for law in r["laws"] if law["claimed"] and law["expected"] is None]
    claimed = [(r, law) for r, law in claimed if law["verdict"] != "not_applicable"]
    broken = [(r, law) for r, law in claimed if law["verdict"] != "holds"]
    if not claimed and len(reports) > 1:
        return f"{counted(len(reports), 'scheme')}, of which nothing is claimed."
    if not claimed:
        return "Nothing is claimed."
    # A scheme without claims does not count among those that keep their claims.
    claiming = [r for r in reports if any(r is c for c, _ in claimed)]
    holding = sum(not any(r is b for b, _ in broken) for r in claiming)
    silent = len(reports) - len(claiming)
    held = len(claimed) - len(broken)
    hold = "holds" if 1 in (held, len(claimed)) else "hold"
    keep = "keeps all that it claims" if holding == 1 else "keep all that they claim"
    text = f"{held} of {counted(len(claimed), 'claimed law')} {hold}"
    text += f"; {holding} of {counted(len(claiming), 'scheme')} {keep}." if len(reports) > 1 else "."
    if silent:
        text += f" Nothing is claimed of {'the other one' if silent == 1 else f'the other {silent}'}."
    if broken:
        of = [f"{name(r['scheme']['name'])}: " if len(reports) > 1 else "" for r, _ in broken[:6]]
        named = [f"{scheme}{name(law['law'])}" for scheme, (_, law) in zip(of, broken, strict=False)]
        more = f" and {len(broken) - 6} more" if len(broken) > 6 else ""
        text += f" Not shown to hold: {'; '.join(named)}{more}."
    return text


def law_texts(laws: list[str]) -> list[dict[str, str]]:
    """Return the statement and source of each of the given laws.
    Laws that sepv does not have get empty texts.
    """
    texts = {law: {"name": name(law), "anchor": "", "statement": "", "source": ""} for law in laws}
    for law in load_laws([law for law in laws if law in ALL_LAWS]):
        stated = {"statement": plain(law.statement, 400), "source": plain(law.source, 80)}
        texts[law.name] |= {"anchor": f"law-{law.name}", **stated}
    return list(texts.values())
