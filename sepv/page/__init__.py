"""One self-contained HTML page from reports and the JSON files of verify, compare,
bench and reproduce.
"""

from __future__ import annotations

from sepv.page._asv import write_asv as write_asv
from sepv.page._changes import changes as changes
from sepv.page._render import render as render
from sepv.page._sources import Sources as Sources
from sepv.page._sources import load as load
