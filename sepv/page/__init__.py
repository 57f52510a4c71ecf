"""One self-contained HTML page from the JSON files of verify, compare, bench and reproduce."""

from __future__ import annotations

from sepv.page._render import render as render
from sepv.page._sources import load as load
