"""The result of a comparison, which shows itself: as tables, and as a picture."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from typing import Any

from sepv.console import html
from sepv.pictures import require_matplotlib
from sepv.studies._compare.record import Compared


@dataclass(frozen=True)
class Comparison(Compared):
    """The result of `compare`: points in the order of methods and step sizes,
    and the settings of the run.
    """

    def _repr_html_(self) -> str:
        """The tables of `sepv compare` for a notebook: points, times to given errors, notes."""
        from sepv.studies._compare.table import heading, notes, point_tables, target_tables

        lines = "".join(f"<p>{escape(note)}</p>" for note in notes(self))
        return (
            f"<p>{escape(heading(self))}</p>{html(*point_tables(self))}"
            f"{''.join(html(t) for t in target_tables(self))}{lines}"
        )

    def plot(self) -> Any:
        """Draw the strong error, and the largest change of H,
        of each method against processor time.

        Returns
        -------
        matplotlib.figure.Figure
            A notebook shows it; `savefig` writes it to a file. Markers are hollow where paths
            failed.

        Raises
        ------
        UsageError
            If matplotlib, the extra ``plots``, is not installed.
        """
        from sepv.studies._compare.picture import comparison_figure

        require_matplotlib("tables, JSON and CSV need no extra")
        return comparison_figure(self)
