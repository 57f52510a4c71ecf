"""The page: a template and a style sheet whose hash the content security policy names."""

from __future__ import annotations

import base64
import hashlib
import json
from importlib.resources import files
from typing import Any

from sepv._version import __version__
from sepv.files import made
from sepv.page import _verdicts as verdicts
from sepv.page import _views as views
from sepv.page._pictures import Pictures
from sepv.page._sources import Sources
from sepv.page._text import plain
from sepv.verification import Report, with_courses

TITLE = "Which structural properties hold?"


def of_report(report: Report) -> str:
    """The page of one report, as ``sepv verify --html`` writes it; the scheme is asked again, for the pictures."""
    return render(Sources(verify=[{"made": made("report")} | with_courses(report)]))


def render(sources: Sources, *, title: str | None = None) -> str:
    """The HTML page, complete: no script, no font, no picture and no style from anywhere else.

    A page of one scheme has its name as the title, unless another is given.
    """
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup

    folder = files(__name__.rpartition(".")[0])
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
    )  # fmt: skip

    def filled(template: str, **names: Any) -> str:
        text = (folder / f"{template}.j2").read_text(encoding="utf-8")
        return environment.from_string(text).render(**names)

    pictures = Pictures(*views.drawn(sources))
    comparisons = [views.comparison(c, pictures) for c in sources.compare]
    reproductions = [views.reproduction(r, pictures) for r in sources.reproduce]
    style = filled("style.css", colours=pictures.colours)
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    laws, schemes = verdicts.schemes(sources.verify)
    alone = len(schemes) == 1 and not (comparisons or reproductions or sources.bench)
    usual = f"{schemes[0]['name']}: which structural properties hold?" if alone else TITLE
    return filled(
        "page.html",
        title=plain(title or usual, 200),
        version=__version__,
        # The style has no text of the files read, so it is the one text that is not escaped.
        style=Markup(style),
        style_hash=digest,
        laws=verdicts.law_texts(laws),
        headline=verdicts.headline(sources.verify) if sources.verify else "",
        fingerprint=fingerprint(),
        schemes=schemes,
        comparisons=comparisons,
        benches=[views.bench(b) for b in sources.bench],
        reproductions=reproductions,
        definitions=pictures.definitions,
        versions=sorted({_version(r) for r in (*sources.verify, *sources.reproduce)}),
    )


def fingerprint() -> str:
    """A hash of what every page shows beside its files: the release, the laws and their texts, the schemes' claims.

    A committed page with another fingerprint is out of date.
    """
    from sepv import schemes
    from sepv.verification import load_laws

    laws = [(law.name, law.statement, law.source) for law in load_laws()]
    built_in = [
        (s.name, sorted(s.claims), s.mean_square_order, s.weak_order)
        for s in (*schemes.PAPER.values(), *schemes.EXTENSIONS.values())
    ]
    return hashlib.sha256(json.dumps([__version__, laws, built_in]).encode()).hexdigest()[:16]


def _version(record: dict[str, Any]) -> str:
    """The version of sepv that made a report or a reproduction."""
    return plain(record.get("suite", record.get("reproduction", {})).get("version", "?"), 40)
