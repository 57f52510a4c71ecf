"""Formulas as MathML: no script, no font, nothing to fetch."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert


def mathml(formula: str, display: str) -> str:
    """An upright letter is text: the converter would make it italic."""
    return str(convert(re.sub(r"\\mathrm\{(\w)\}", r"\\text{\1}", formula), display=display))


def inline(translator: Any, node: nodes.math) -> None:
    """A formula in a line."""
    translator.body.append(mathml(node.astext(), "inline"))
    raise nodes.SkipNode


def display(translator: Any, node: nodes.math_block) -> None:
    """A formula of its own, which scrolls where it is wider than the page, with the keyboard
    too.
    """
    formula = mathml(node.astext(), "block")
    translator.body.append(f'<div class="math-display" tabindex="0" role="math">{formula}</div>\n')
    raise nodes.SkipNode


def setup(app: Any) -> dict[str, bool]:
    """Called by Sphinx."""
    app.add_html_math_renderer("mathml", (inline, None), (display, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
