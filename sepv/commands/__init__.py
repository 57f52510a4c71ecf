"""The commands of ``sepv``, one a file; `_cli` loads the one that is asked for, `_shared` has what several take."""

from __future__ import annotations

from sepv.commands._cli import main as main
