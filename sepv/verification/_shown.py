"""The report of a run, which shows itself: as text, as a page, and as a picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from sepv.files import made
from sepv.law import Verdict
from sepv.verification._outcome import Outcome


@dataclass(frozen=True, repr=False)
class Report(Outcome):
    """The findings of all laws of a run on one scheme. `print` shows them as a table,
    and so does a notebook.

    Attributes
    ----------
    scheme : Scheme
    findings : tuple of Finding
        One for each law of the run, in the order of the suite: verdict, defect, bound, message,
        witness.
    effort : Effort
    interrupted : bool
        True if some laws were not measured.
    lost : str
        If they were not because a cluster of workers was lost, how; else empty.
    pinned : frozenset of str or None
        The laws that held when the run's pin was written; None without a pin. A pin is a file of
        expected verdicts. With a pin the run fails at each violation that the pin does not list.
    pins : bool
        True if the command writes a pin of this report.
    gaps : tuple of str
        Sentences about differences between this run and the pin: in the scheme, its problems or the
        measured laws.
    target : str
        The arguments that name the scheme and its problems on a command line; empty if there are
        none.
    required : tuple of Requirement
        The profiles, named sets of laws, that the scheme must have.
    """

    def __str__(self) -> str:
        """The table of the laws, the counterexamples and the last line,
        as `sepv verify` prints them.
        """
        from sepv.verification._report import as_text

        return as_text(self)

    def __repr__(self) -> str:
        """One line: the scheme and the counts."""
        counts = ", ".join(Verdict(k).of(n) for k, n in self.counts.items() if n)
        return f"<Report of {self.scheme.name}: {counts}>"

    def html(self) -> str:
        """The report as one HTML page: the defects on a scale,
        each counterexample with a picture and its replay.

        The scheme's step is called again for the pictures. ``sepv verify --html`` writes this page.
        """
        from sepv.page import Sources, render
        from sepv.verification._course import with_courses

        return render(Sources(verify=[{"made": made("report")} | with_courses(self)]))

    def _repr_html_(self) -> str:
        """The HTML for a notebook: the report's page in a frame,
        and the report's last line below the frame.
        """
        from sepv.verification._report import in_notebook

        return in_notebook(self, self.html())

    def plot(self) -> Any:
        """Draw the measured laws on one scale: the defect of each in units of its bound,
        1 and less if it holds.

        Returns
        -------
        matplotlib.figure.Figure
            A notebook shows it; `savefig` writes it to a file. Names of claimed laws are bold.

        Raises
        ------
        UsageError
            If matplotlib, the extra ``plots``, is not installed, or if no law was measured against
            a bound.
        """
        from sepv.verification._picture import report_figure

        return report_figure(self)
