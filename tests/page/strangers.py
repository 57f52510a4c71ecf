"""What strangers may write into the files of a page, the pages that are made of it,
and a reader of pages.
"""

from functools import cache
from itertools import product
from typing import Any

from doors import Tags

from sepv.files import fault, schema
from sepv.page import Sources, render

FORMULA = "$\\frac{$ <b>& \u4e2d"
EVIL = [
    "<script>document.title='owned'</script>",
    '"><img src=x onerror="document.title=\'owned\'">',
    "'; DROP TABLE schemes; --",
    "\u202egnp.exe\u202c",
    "</style><style>*{display:none}",
    "{{ 7 * 7 }}{% raw %}",
    "javascript:alert(1)",
    "a\x00b\x1b[31m\ud83d",
    "x" * 10_240,
    FORMULA,
    "  two\nlines ",
    "",
]


def verify_report(scheme: str, message: str = "", verdict: str = "violated") -> dict[str, Any]:
    law = {
        "law": "energy", "claimed": True, "verdict": verdict, "defect": 1e9, "bound": 48.0, "at_least": False,
        "unit": message[:20] or "ulp of H", "source": message or "Prop. 3.1", "witness": None, "replay": message,
        "checks": 3, "message": message or "step 3: H moved", "expected": None, "seconds": 0.1, "skipped": 0,
    }  # fmt: skip
    counts = dict.fromkeys(("holds", "violated", "inconclusive", "not_applicable", "error"), 0)
    return {
        "suite": {"name": "sepv", "version": "0.1.0", "laws": 1, "seed": 0, "examples": 100, "paths": 8192},
        "scheme": {
            "name": scheme, "source": message or "a book", "claims": ["energy"], "mean_square_order": None,
            "weak_order": None, "solver_tolerance": 0.0, "truncation": 2,
        },
        "counts": counts | {verdict: 1},
        "laws": [law],
    }  # fmt: skip


def comparison(method: str) -> dict[str, Any]:
    size = {"value": 1e-3, "low": 9e-4, "high": 1.1e-3}
    point = {
        "method": method, "h": 0.1, "steps": 10, "paths": 64, "failures": 0, "strong_error": size, "weak_error": size,
        "energy_defect": 0.0, "casimir_defect": None, "ns_per_step": 5.0, "evaluations_per_step": {method[:40]: 2.0},
        "iterations_per_step": None, "seconds": {"median": 1e-3, "low": 1e-3, "high": 1e-3, "wall": 1e-3, "first": 0.0},
    }  # fmt: skip
    return {
        "format": 1, "problem": method, "T": 1.0, "seed": 0, "repeats": 3, "confidence": 0.99,
        "environment": {method[:40]: method}, "methods": [{"name": method, "source": method}], "points": [point],
        "times_to_error": [
            {"method": method, "error": 1e-2, "microseconds": None, "energy_defect": None, "how": "never"}
        ],
    }  # fmt: skip


def reproduction(text: str) -> dict[str, Any]:
    statement = {
        "text": text, "source": text, "verdict": "fails", "measured": text, "criterion": text, "correction": text,
    }  # fmt: skip
    panel = {
        "key": "4.1-energy", "figure": "4.1", "title": text, "source": text, "x": {"label": text, "log": False},
        "y": {"label": text, "log": True}, "parameters": {}, "chosen": [text], "slopes": [], "statements": [statement],
        "description": text, "equal": False, "window": None, "seconds": 1.0, "numbers": {},
        "series": [{"name": text, "x": [0.0, 1.0, None], "y": [1.0, 1e300, -1.0], "scheme": text, "style": "line"}],
    }  # fmt: skip
    about = {
        "name": "sepv", "version": text[:30], "seed": 0, "share": 1.0, "engine": "auto", "seconds": 1.0,
        "processor_seconds": 1.0, "workers": 2, **dict.fromkeys(("python", "numpy", "scipy", "of"), text),
    }  # fmt: skip
    counts = {"holds": 0, "fails": 2, "open": 0}
    return {"reproduction": about, "counts": counts, "panels": [panel], "text": [statement]}


def bench(target: str) -> dict[str, Any]:
    case = {"name": target, "h": 0.1, "steps": 4, "paths": 64}
    found = {"case": case, "counters": {target[:30]: 7, "lost": None}}
    found |= dict.fromkeys(("error", "energy", "casimir"), [(0.25).hex()] * 32)
    records = [{"target": target, "cases": [found]}]
    return {"format": 1, "environment": {target[:30]: target}, "records": records}


@cache
def hostile_page() -> str:
    sources = Sources()
    for evil in EVIL:
        sources.verify.append(verify_report(evil, evil))
        sources.compare.append(comparison(evil))
        sources.reproduce.append(reproduction(evil))
        sources.bench.append(bench(evil))
    return render(sources, title=EVIL[0])


class Reader(Tags):
    """Every tag with its attributes, all text, and the nesting."""

    VOID = frozenset(("meta", "use", "rect", "line", "path", "br", "img", "link"))

    def __init__(self, page: str) -> None:
        self.open: list[str] = []
        self.words: list[str] = []
        super().__init__(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        super().handle_starttag(tag, attrs)
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        super().handle_starttag(tag, attrs)

    def handle_endtag(self, tag: str) -> None:
        if tag in self.VOID:  # as a browser writes them down: <line></line>
            return
        assert self.open.pop() == tag, tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)


ELEMENTS = """html head meta title style body a header h1 h2 h3 p sub nav ul li main section div table caption thead
tbody tr th td span bdi details summary pre figure figcaption svg defs desc use rect line text path clippath g dl
dt dd"""
ALLOWED = frozenset(ELEMENTS.split())


def empty_page() -> str:
    return render(Sources())


@cache
def hostile_report() -> str:
    """One scheme by a stranger, whose numbers fit nothing."""
    report = verify_report(EVIL[0])
    curves: list[Any] = [[1e308, None, -1e308, 2.0, 3.0], [0.0] * 5, [1.0], []]
    for n, (drift, x, y) in enumerate(product(curves, repeat=3)):
        evil, states = EVIL[n % len(EVIL)], [x, y][: 1 + len(drift) % 2]
        course = {
            "components": [7, 1], "states": states, "exact": states[::-1], "kept": "H", "drift": drift, "size": 1e308,
            "ended": evil, **({"defects": drift, "bounds": x} if n % 3 else {}),
        }  # fmt: skip
        law = {"law": f"{n}{evil}"[:70], "course": course}
        report["laws"].append(verify_report("", evil)["laws"][0] | law)
    sizes = (None, 0.0, False), (-1.0, 1e-308, True), (1e308, 1e-308, False), (0.0, 1.0, True)
    for law, size in zip(report["laws"], sizes, strict=False):
        law |= dict(zip(("defect", "bound", "at_least"), size, strict=True))
    report["suite"]["laws"], report["laws"][0]["share"] = len(report["laws"]), None
    assert "course" not in fault(report, schema("report"))
    return render(Sources(verify=[report]))
