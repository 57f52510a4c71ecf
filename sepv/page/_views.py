"""What the page shows of each kind of file, arranged for the template. Nothing here is HTML."""

from __future__ import annotations

import math
import re
import shlex
from dataclasses import dataclass
from typing import Any

from sepv._terminal import counted
from sepv.errors import UsageError
from sepv.page._pictures import Pictures
from sepv.page._sources import Sources
from sepv.page._text import name, number, plain
from sepv.schemes import Look
from sepv.studies._picture import FLOOR, Axis, Series, power
from sepv.studies._reproduce.record import in_words
from sepv.verification import LAWS, Verdict, load_laws

# Characters of counterexamples on a page; the JSON files have them all.
BUDGET = 17_000

WORDS = {
    "holds": ("✓", "holds"),
    "violated": ("✗", "violated"),
    "inconclusive": ("?", "inconclusive"),
    "not_applicable": ("·", "not applicable"),
    "error": ("!", "error"),
    "not_measured": ("", "not measured"),
    "fails": ("✗", "does not hold"),
    "open": ("?", "open"),
}


@dataclass(frozen=True)
class Cell:
    """One verdict of the matrix."""

    kind: str
    sign: str
    words: str
    claimed: bool


@dataclass(frozen=True)
class Counterexample:
    """A violation: the law, its source, what happened, and how to see it again."""

    law: str
    source: str
    verdict: str
    claimed: bool
    message: str
    command: str


@dataclass(frozen=True)
class SchemeView:
    """A scheme's row in the matrix, its table, its counterexamples and how many were left out."""

    name: str
    source: str
    cells: list[Cell]
    rows: list[dict[str, Any]]
    counterexamples: list[Counterexample]
    left_out: int
    unsettled: list[str]
    summary: str
    command: str


def schemes(reports: list[dict[str, Any]]) -> tuple[list[str], list[SchemeView]]:
    """The laws, in the order of the suite and then as they appear, and a view of each report."""
    laws = list(dict.fromkeys(law["law"] for r in reports for law in r["laws"]))
    laws.sort(key=lambda law: LAWS.index(law) if law in LAWS else len(LAWS))
    share = BUDGET // max(1, len(reports))
    return laws, [_scheme(r, laws, share) for r in reports]


def _scheme(report: dict[str, Any], laws: list[str], budget: int) -> SchemeView:
    found = {law["law"]: law for law in report["laws"]}
    cells = [_cell(found[law]) if law in found else Cell("absent", "", "not measured", False) for law in laws]
    counts = ", ".join(Verdict(k).of(n) for k, n in report["counts"].items() if n)
    target = _target(report["scheme"])
    shown, left = _counterexamples(report["laws"], target, budget)
    suite = report["suite"]
    return SchemeView(
        name=name(report["scheme"]["name"]),
        source=plain(report["scheme"]["source"], 200),
        cells=cells,
        rows=[_row(law) for law in report["laws"]],
        counterexamples=shown,
        left_out=left,
        unsettled=_unsettled(report["laws"]),
        summary=f"{counted(len(report['laws']), 'law')}: {counts}",
        command=plain(
            f"sepv verify {target}{_asked(report)} --seed {suite['seed']} --examples {suite['examples']} "
            f"--paths {suite['paths']} --json FILE"
            if target
            else f"# {name(report['scheme']['name'])} was handed over as an object in Python: no command names it",
            1500,
        ),
    )


def _asked(report: dict[str, Any]) -> str:
    """The options that a run was given beside its effort: laws, where not all, and claims that no built-in makes."""
    laws = [law["law"] for law in report["laws"]]
    only = f" --law {','.join(laws)}" if set(laws) < set(LAWS) else ""
    claims = [law for law in report["scheme"]["claims"] if law in LAWS and law != "contract"]
    own = ":" in _target(report["scheme"]) or "--exec" in _target(report["scheme"])
    return only + (f" --claim {','.join(claims)}" if own and claims else "")


def _cell(law: dict[str, Any]) -> Cell:
    sign, words = WORDS[law["verdict"]]
    return Cell(law["verdict"], sign, words, law["claimed"])


def _row(law: dict[str, Any]) -> dict[str, Any]:
    bound = "" if law["bound"] is None else f"{'≥' if law['at_least'] else '≤'} {number(law['bound'])}"
    return {
        "law": name(law["law"]),
        "cell": _cell(law),
        "claimed": "expected to fail" if law["expected"] is not None else "yes" if law["claimed"] else "",
        "defect": number(law["defect"]),
        "bound": bound,
        "unit": plain(law["unit"], 40),
        "source": plain(law["source"], 60),
    }


def _counterexamples(
    laws: list[dict[str, Any]], target: str, budget: int
) -> tuple[list[Counterexample], int]:
    """Claimed laws first; as many as the budget of characters allows, and how many it does not."""
    open_ = [law for law in laws if law["verdict"] in ("violated", "error") and law["message"]]
    shown: list[Counterexample] = []
    for law in sorted(open_, key=lambda v: not v["claimed"]):
        # A command is there to be copied: whole or not at all.
        command = f"sepv verify {target} {law['replay']}" if target and len(law["replay"]) < 4000 else ""
        entry = Counterexample(
            name(law["law"]),
            plain(law["source"], 60),
            WORDS[law["verdict"]][1],
            law["claimed"],
            plain(law["message"]),
            plain(command, 8200) if law["replay"] else "",
        )
        budget -= len(entry.message) + len(entry.command)
        if budget < 0 and not (law["claimed"] and not shown):
            break
        shown.append(entry)
    return shown, len(open_) - len(shown)


def _unsettled(laws: list[dict[str, Any]]) -> list[str]:
    """In words, why each inconclusive law is: what was measured, and what may keep its interval wide."""
    found = []
    for law in laws:
        if law["verdict"] == "inconclusive":
            lines = [line for line in law["message"].splitlines() if not line.startswith("intervals miss")]
            text = "; ".join(lines) or "no reason was given"
            if any(_runs_away(*m.groups()) for m in _RMS.finditer(text)):
                text += ". A few paths run away with the fewest steps and make up that error; "
                text += "the finer steps show the order"
            found.append(f"{name(law['law'])}: {plain(text, 700)}.")
    return found


# The first three of the errors that the message of a statistical law lists.
_RMS = re.compile(r"rms error ([\d.e+-]+), ([\d.e+-]+), ([\d.e+-]+)")


def _runs_away(*errors: str) -> bool:
    """The coarsest error is more than four times what the two after it lead to expect."""
    try:
        first, second, third = map(float, errors)
    except ValueError:  # a file by somebody else
        return False
    return first * third > 4 * second**2


def _target(scheme: dict[str, Any]) -> str:
    """What stands for the scheme in a command: as the file says, else its name where that is a built-in's."""
    from sepv.schemes import by_name

    if scheme.get("target"):
        return str(scheme["target"])
    try:
        return by_name(str(scheme["name"])).name
    except UsageError:
        return ""


def headline(reports: list[dict[str, Any]]) -> str:
    """How many claims hold, and whose do not."""
    claimed = [(r, law) for r in reports for law in r["laws"] if law["claimed"] and law["expected"] is None]
    claimed = [(r, law) for r, law in claimed if law["verdict"] != "not_applicable"]
    broken = [(r, law) for r, law in claimed if law["verdict"] != "holds"]
    if not claimed:
        return f"{counted(len(reports), 'scheme')}, of which nothing is claimed."
    # A scheme of which nothing is claimed keeps nothing that it claims.
    claiming = [r for r in reports if any(r is c for c, _ in claimed)]
    kept = sum(not any(r is b for b, _ in broken) for r in claiming)
    silent = len(reports) - len(claiming)
    held = len(claimed) - len(broken)
    hold, keep = (
        "holds" if held == 1 else "hold",
        "keeps all that it claims" if kept == 1 else "keep all that they claim",
    )
    text = f"{held} of {counted(len(claimed), 'claimed law')} {hold}; "
    text += f"{kept} of {counted(len(claiming), 'scheme')} {keep}."
    if silent:
        text += f" Nothing is claimed of {'the other one' if silent == 1 else f'the other {silent}'}."
    if broken:
        named = [f"{name(r['scheme']['name'])}: {name(law['law'])}" for r, law in broken[:6]]
        more = f" and {len(broken) - 6} more" if len(broken) > 6 else ""
        text += f" Not shown to hold: {'; '.join(named)}{more}."
    return text


def law_texts(laws: list[str]) -> list[dict[str, str]]:
    """What each law of the suite says and where it comes from; laws that it does not know have no text."""
    known = {law.name: law for law in load_laws([law for law in laws if law in LAWS])}
    return [
        {
            "name": name(law),
            "anchor": f"law-{law}" if law in known else "",
            "statement": plain(known[law].statement, 400) if law in known else "",
            "source": plain(known[law].source, 80) if law in known else "",
        }
        for law in laws
    ]


def step_size(h: float) -> str:
    """A power of two as one, else three digits."""
    exponent = math.log2(h) if h > 0 else 0.5
    return power(h, 2) if exponent == int(exponent) and exponent < -1 else number(h)


def priced(points: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The points from where time is paid for steps: where twice the steps no longer cost less than half as much again.

    Left of that a call's own overhead is what was measured. The last two points stay in any case.
    """
    if not points or not points[0].get("steps"):
        return points
    kept = sorted(points, key=lambda p: int(p["steps"]))
    while len(kept) > 2:
        a, b = kept[0], kept[1]
        growth = math.log2(b["seconds"]["median"] / b["paths"] / (a["seconds"]["median"] / a["paths"]))
        if growth >= math.log2(1.5) * math.log2(b["steps"] / a["steps"]):
            break
        kept = kept[1:]
    return kept


def drawn(sources: Sources) -> tuple[list[str], dict[str, Look]]:
    """The schemes that pictures show, and the looks that their files state."""
    methods = [m for c in sources.compare for m in c["methods"]]
    names = [m["name"] for m in methods]
    names += [s["scheme"] for r in sources.reproduce for p in r["panels"] for s in p["series"]]
    return names, {m["name"]: Look(**m["look"]) for m in methods if "look" in m}


def comparison(data: dict[str, Any], pictures: Pictures) -> dict[str, Any]:
    """Two plots, the points, the times to given errors, and where it ran."""
    methods = [m["name"] for m in data["methods"]]
    points = [p for p in data["points"] if p["failures"] < p["paths"]]
    by_method = {m: [p for p in points if p["method"] == m] for m in methods}

    def micro(p: dict[str, Any]) -> float:
        return float(p["seconds"]["median"] / p["paths"] * 1e6)

    def curve(m: str, value: Any) -> Series:
        own = priced(by_method[m])
        return Series(m, [micro(p) for p in own], [value(p) for p in own], m, "both")

    time = Axis("processor time of one path in µs", log=True)
    errors = pictures.draw(
        [curve(m, lambda p: p["strong_error"]["value"]) for m in methods],
        time,
        Axis("strong error at T", log=True),
    )
    # A defect of exactly zero has no logarithm: it is drawn at half a rounding of one, as the caption says.
    defects = pictures.draw(
        [
            curve(m, lambda p: None if p["energy_defect"] is None else max(p["energy_defect"], FLOOR))
            for m in methods
        ],
        time,
        Axis("largest energy defect", log=True),
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
        "command": _compare_command(data),
        "seed": data["seed"],
        "repeats": data["repeats"],
    }


def _compare_command(data: dict[str, Any]) -> str:
    """The command that makes such a comparison, its methods and step sizes filled in."""
    methods = " ".join(shlex.quote(str(m["name"])) for m in data["methods"])
    steps = sorted({int(p["steps"]) for p in data["points"] if p["steps"] > 1})
    paths = max((int(p["paths"]) for p in data["points"]), default=1000)
    grid = f" --steps {','.join(map(str, steps))}" if steps else ""
    problem = f"--problem {shlex.quote(str(data['problem']))} --time {data['T']:g}"
    text = f"sepv compare {methods} {problem}{grid} --paths {paths} --seed {data['seed']} --json FILE"
    return plain(text)


def _point(p: dict[str, Any], micro: float) -> dict[str, Any]:
    evaluations = ", ".join(f"{number(v)} {plain(k, 30)}" for k, v in p["evaluations_per_step"].items())
    error = p["strong_error"]
    return {
        "method": name(p["method"]),
        "h": step_size(p["h"]),
        "error": f"{number(error['value'])} [{number(error['low'])}, {number(error['high'])}]",
        "energy": number(p["energy_defect"]),
        "casimir": number(p["casimir_defect"]),
        "micro": number(micro),
        "evaluations": evaluations,
        "iterations": number(p["iterations_per_step"]),
        "failures": p["failures"] or "",
    }


def _times(times: list[dict[str, Any]], methods: list[str]) -> list[tuple[str, list[str]]]:
    wanted = sorted({t["error"] for t in times}, reverse=True)
    words = {"between": "", "beyond": " (extrapolated)", "coarsest": " (at the coarsest step)"}
    rows = []
    for m in methods:
        own = {t["error"]: t for t in times if t["method"] == m}
        cells = [
            "never" if e not in own or own[e]["microseconds"] is None
            else number(own[e]["microseconds"]) + words.get(own[e]["how"], "")
            for e in wanted
        ]  # fmt: skip
        rows.append((name(m), cells))
    return rows


def bench(data: dict[str, Any]) -> dict[str, Any]:
    """For each target a row a case: exact counters, and the rms of error and defects over all paths."""
    kinds = list(dict.fromkeys(k for r in data["records"] for case in r["cases"] for k in case["counters"]))

    def rms(groups: list[str]) -> str:
        values = [float.fromhex(v) for v in groups]
        return number((sum(values) / max(1, len(values))) ** 0.5)

    return {
        "kinds": [name(k) for k in kinds],
        "environment": [(plain(k, 40), plain(v, 120)) for k, v in data["environment"].items()],
        "records": [
            {
                "target": name(r["target"]),
                "rows": [
                    {
                        "case": name(c["case"]["name"]),
                        "size": f"{step_size(c['case']['h'])}, {c['case']['steps']}, {c['case']['paths']}",
                        "counters": [
                            "–" if c["counters"].get(k) is None else c["counters"][k] for k in kinds
                        ],
                        "error": rms(c["error"]),
                        "energy": rms(c["energy"]),
                        "casimir": rms(c["casimir"]),
                    }
                    for c in r["cases"]
                ],
            }
            for r in data["records"]
        ],
    }


def reproduction(data: dict[str, Any], pictures: Pictures) -> dict[str, Any]:
    """The panels with their plots and statements."""
    return {
        "about": {k: plain(v, 60) if isinstance(v, str) else v for k, v in data["reproduction"].items()},
        "of": plain(data["reproduction"]["of"], 300),
        "counts": in_words(data["counts"]),
        "panels": [_panel(p, pictures) for p in data["panels"]],
        "text": [_statement(s) for s in data["text"]],
    }


def _panel(p: dict[str, Any], pictures: Pictures) -> dict[str, Any]:
    curves = [Series(s["name"], s["x"], s["y"], s["scheme"], s["style"]) for s in p["series"]]
    x, y = (Axis(plain(p[k]["label"], 60), p[k]["log"]) for k in ("x", "y"))
    statements = [_statement(s) for s in p["statements"]]
    held = [s for s in statements if s["cell"].kind == "holds"]
    return {
        "title": plain(p["title"], 120),
        "source": plain(p["source"], 120),
        "description": plain(p["description"], 400),
        "chosen": [plain(c, 300) for c in p["chosen"]],
        "statements": statements,
        "held": held,
        "holding": len(held),
        "plot": pictures.draw(curves, x, y, slopes=p["slopes"], equal=p["equal"], window=p["window"]),
    }


def _statement(s: dict[str, Any]) -> dict[str, Any]:
    sign, words = WORDS[s["verdict"]]
    return {
        "cell": Cell(s["verdict"], sign, words, False),
        **{key: plain(s[key], 600) for key in ("text", "source", "measured", "criterion", "correction")},
    }
