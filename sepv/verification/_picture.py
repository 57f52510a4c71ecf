"""Picture of a report: the defect of each law in units of its bound. It needs the extra
``plots``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sepv.errors import UsageError
from sepv.law import Finding, Verdict
from sepv.pictures import GUIDE_COLOUR, SOFT_COLOUR, TEXT_COLOUR, Axis, figure, frame, require_matplotlib

if TYPE_CHECKING:
    from sepv.verification._outcome import Outcome

# The ends of the scale: defects outside are drawn at its ends.
SCALE_MIN, SCALE_MAX = 1e-4, 1e12
# Colours of Okabe and Ito (2008) with a marker of their own, so that they also differ in grey.
VERDICT_MARKERS = {
    Verdict.HOLDS: ("#0072B2", "o"),
    Verdict.VIOLATED: ("#D55E00", "X"),
    Verdict.INCONCLUSIVE: ("#E69F00", "s"),
    Verdict.ERROR: ("#CC79A7", "P"),
}


def report_figure(report: Outcome) -> Any:
    """One row for each law that was measured against a bound, in the order of the suite,
    on a logarithmic scale.
    """
    require_matplotlib("the report as text and as HTML needs none")
    rows = [(f, ratio) for f in report.findings if (ratio := f.ratio) is not None]
    if not rows:
        raise UsageError(
            expected="a report with a law that was measured against a bound",
            received=f"the laws {', '.join(f.law for f in report.findings) or 'none'}",
            remedy="measure more laws, or read the report as text",
        )
    with figure(7.0, 1.2 + 0.21 * len(rows), layout="constrained") as drawn:
        axes = drawn.subplots(1, 1)
        axes.axvline(1.0, color=GUIDE_COLOUR, linewidth=1)
        for verdict, (colour, marker) in VERDICT_MARKERS.items():
            of = [
                (min(max(ratio, SCALE_MIN), SCALE_MAX), n)
                for n, (f, ratio) in enumerate(rows)
                if f.verdict is verdict
            ]
            if of:
                axes.plot(*zip(*of, strict=True), marker, color=colour, label=verdict.text, clip_on=False)
        axes.set_xlim(SCALE_MIN, SCALE_MAX)
        frame(axes, Axis(f"defect / bound, between {SCALE_MIN:g} and {SCALE_MAX:g}", log=True), Axis(""))
        axes.set_yticks(range(len(rows)), [f.law for f, _ in rows])
        for label, (finding, _) in zip(axes.get_yticklabels(), rows, strict=True):
            label.set(
                fontweight="bold" if finding.claimed else "normal",
                color=TEXT_COLOUR if finding.claimed else SOFT_COLOUR,
            )
        axes.set_ylim(len(rows) - 0.5, -0.5)
        axes.annotate(
            "bound",
            (1.0, 1.0),
            xycoords=("data", "axes fraction"),
            ha="center",
            va="bottom",
            color=SOFT_COLOUR,
        )
        drawn.legend(loc="outside lower center", ncols=len(VERDICT_MARKERS))
        drawn.suptitle(f"{report.scheme.name}: {_in_words(rows)}")
        return drawn


def _in_words(rows: list[tuple[Finding, float]]) -> str:
    verdicts = [f.verdict for f, _ in rows]
    return ", ".join(v.of(verdicts.count(v)) for v in VERDICT_MARKERS if v in verdicts)
