"""One self-contained HTML page from the JSON files of verify, compare, bench and reproduce."""

from __future__ import annotations

from sepv.page.render import render as render
from sepv.page.sources import load as load
