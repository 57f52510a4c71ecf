"""Make the HTML page from a template and a style sheet.
The content security policy has the style sheet's hash.
"""

from __future__ import annotations

import base64
import hashlib
import json
from importlib.resources import files
from typing import Any

from sepv._version import __version__
from sepv.page import _verdicts as verdicts
from sepv.page import _views as views
from sepv.page._changes import changes
from sepv.page._pictures import Pictures
from sepv.page._sources import Sources
from sepv.page._text import plain

REPORT_TITLE = "Which structural properties hold?"


def render(sources: Sources, *, title: str | None = None) -> str:
    """Return the complete HTML page, without scripts, fonts, pictures or styles from other places.

    If no `title` is given, the title of a page of one scheme contains the scheme's name.
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
    usual = f"{schemes[0]['name']}: which structural properties hold?" if alone else REPORT_TITLE
    return filled(
        "page.html",
        title=plain(title or usual, 200),
        version=__version__,
        # The style is not escaped, because it has no text of the files read.
        style=Markup(style),
        style_hash=digest,
        laws=verdicts.law_texts(laws),
        headline=verdicts.headline(sources.verify) if sources.verify else "",
        fingerprint=fingerprint(),
        schemes=schemes,
        changes=changes(sources.verify),
        comparisons=comparisons,
        benches=[views.bench(b) for b in sources.bench],
        reproductions=reproductions,
        definitions=pictures.definitions,
        versions=sorted({_version(r) for r in (*sources.verify, *sources.reproduce)}),
    )


def fingerprint() -> str:
    """Return a hash of sepv's version, the laws with their texts,
    and the claims of built-in schemes.

    Every page contains this hash. If a committed page has another one, it is out of date.
    """
    from sepv import schemes
    from sepv.properties import load_laws

    laws = [(law.name, law.statement, law.source) for law in load_laws()]
    built_in = [
        (s.name, sorted(s.claims), s.mean_square_order, s.weak_order)
        for s in (*schemes.PAPER.values(), *schemes.EXTENSIONS.values())
    ]
    return hashlib.sha256(json.dumps([__version__, laws, built_in]).encode()).hexdigest()[:16]


def _version(record: dict[str, Any]) -> str:
    """Return the version of sepv that made a report or a reproduction."""
    return plain(record.get("suite", record.get("reproduction", {})).get("version", "?"), 40)
