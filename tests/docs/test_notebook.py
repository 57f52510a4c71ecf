"""The example notebook runs from top to bottom, and what a notebook shows of results is short and
drawn.
"""

import ast
import json
import sys
from dataclasses import replace
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest
from doors import ROOT

import sepv
from sepv.errors import UsageError
from sepv.schemes import midpoint

NOTEBOOK = ROOT / "examples" / "notebook.ipynb"
CELLS = [c for c in json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"] if c["cell_type"] == "code"]
# A repr above this length hides the rest of a notebook's page.
LONGEST = 500


@pytest.fixture(scope="module")
def shown() -> list[Any]:
    """The values of the cells' last expressions, as Jupyter takes them:
    its own packages are in no extra of sepv.
    """
    scope: dict[str, Any] = {"__name__": "__main__"}
    values = []
    for cell in CELLS:
        *body, last = ast.parse("".join(cell["source"])).body
        ends_in_value = isinstance(last, ast.Expr)
        exec(compile(ast.Module(body if ends_in_value else [*body, last], []), str(NOTEBOOK), "exec"), scope)
        if ends_in_value:
            values.append(eval(compile(ast.Expression(last.value), str(NOTEBOOK), "eval"), scope))
    return [value for value in values if value is not None]


@pytest.fixture(scope="module")
def report() -> sepv.Report:
    return sepv.verify(
        midpoint, laws="energy,casimir,identity", effort=sepv.Effort(examples=8, shrink_checks=0)
    )


class Tags(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.texts: list[str] = []

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def test_the_notebook_runs_and_each_kind_of_result_is_a_table_or_a_picture(shown: list[Any]) -> None:
    kinds = {type(value).__name__ for value in shown}
    assert {"Problem", "Trajectory", "Ensemble", "Comparison", "NotebookFigure"} <= kinds
    for value in shown:
        if type(value).__name__ == "NotebookFigure":
            assert value._repr_png_().startswith(b"\x89PNG")
        elif not isinstance(value, float):
            page = Tags()
            page.feed(value._repr_html_())
            assert page.open == []
            assert len(page.texts) > 8


def test_outputs_are_not_stored() -> None:
    """They would grow old: the notebook is run by its reader."""
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in CELLS)


def test_reprs_of_large_results_are_short() -> None:
    problem = sepv.problems.toda()
    path = sepv.integrate("euler-heun", problem, h=1e-3, steps=50)
    ends = sepv.ensemble("euler-heun", problem, h=1e-3, steps=50, paths=64)
    named = sepv.Problem(dimension=2, structure=lambda y: np.array([[0.0, 1.0], [-1.0, 0.0]]),
                         hamiltonian=lambda y: y[0] ** 2 + y[1] ** 2, noise=(1.0,) * 40, name="n" * 3000)  # fmt: skip
    for value in (problem, path, ends, named):
        assert len(repr(value)) <= LONGEST, repr(value)


def test_tables_escape_names_of_others() -> None:
    problem = sepv.problems.pendulum()
    page = replace(problem, name="<script>x</script>\u202e", check=False)._repr_html_()
    assert "<script" not in page
    assert "\u202e" not in page


@pytest.mark.parametrize("kind", ["path", "ends", "report"])
def test_a_picture_without_matplotlib_names_the_remedy(
    kind: str, report: sepv.Report, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = {"problem": "pendulum", "h": 0.1, "steps": 4}
    value = {
        "path": lambda: sepv.integrate(midpoint, **given),
        "ends": lambda: sepv.ensemble(midpoint, **given, paths=4),
        "report": lambda: report,
    }[kind]()
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(UsageError, match=r"pip install 'sepv\[plots\]'"):
        value.plot()


def test_a_picture_of_reduced_paths_names_the_remedy() -> None:
    ends = sepv.ensemble(midpoint, "pendulum", h=0.1, steps=4, paths=4, reduce={"q": lambda e: e.y[1]})
    with pytest.raises(UsageError, match="store= keeps the paths"):
        ends.plot()
    assert "standard error" in ends._repr_html_()


def test_a_path_draws_the_change_of_its_energy_and_a_failed_path_is_left_out() -> None:
    path = sepv.integrate("euler-heun", "pendulum", h=0.1, steps=40)
    (curve,) = path.plot().axes[1].lines
    drawn = curve.get_ydata()
    assert drawn[0] == 0.0
    assert drawn[-1] == pytest.approx(float(path.energy()[-1] - path.energy()[0]))
    wild = sepv.ensemble("midpoint", "lotka-volterra", h=0.5, steps=8, paths=64, seed=1)
    failed = int(np.count_nonzero(wild.status))
    assert 0 < failed < 64
    figure = wild.plot()
    assert f"{failed} that failed" in figure.get_suptitle()
    assert len(figure.axes[0].lines[0].get_xdata()) == 64 - failed


def test_a_report_draws_each_measured_law_once_on_its_side_of_the_bound(report: sepv.Report) -> None:
    axes = report.plot().axes[0]
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert names == [f.law for f in report.findings]
    points = {names[int(n)]: x for line in axes.lines[1:] for x, n in zip(*line.get_data(), strict=True)}
    assert points["energy"] > 1 > points["casimir"] >= points["identity"]
