"""The compliance table of other libraries' solvers, and the scripts that show their deviations."""

import ast
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from doors import ROOT
from sepv.reference.peers.peer import Peer
from sepv.reference.peers.posing import PathSolver

from benchmarks.peers import compliance, deviations
from benchmarks.peers import compliance_measurements as measurements
from benchmarks.peers import compliance_rows as rows
from benchmarks.peers.deviations import Shown as Script
from benchmarks.peers.deviations import _notes
from sepv.errors import TargetError, UsageError
from sepv.problem import Problem, vector_field
from sepv.schemes import Scheme
from sepv.verification import Effort, load_laws

DOCS = ROOT / "docs"
QUICK = Effort(examples=20, paths=256, shrink_checks=30)


def _row(**changes: object) -> compliance.Row:
    given: dict[str, object] = {
        "library": "lib", "release": "1.0", "solver": "heun", "source": "its manual",
        "energy": ("5", "6"), "verdicts": {"energy": "–", "contract": "holds +"},
    }  # fmt: skip
    return compliance.Row(**{**given, **changes})


def test_the_page_groups_solvers_by_their_verdicts_and_marks_what_is_contradicted() -> None:
    marks = {"energy": "– +", "symmetry": "? +", "casimir": "holds", "truncation": "n/a"}
    others = {"solver": "twin"}, {"library": "other", "solver": "box"}, {"solver": "open", "verdicts": marks}
    found = [_row(), *(_row(**changes) for changes in others)]
    page = compliance.document(found, [deviations.Deviation("lib heun", "### lib heun: no")], "the command")
    lines = page.splitlines()
    assert "Not measured: reproducibility, identity, " in page
    assert "| lib heun †; twin; other box | 1 of 1 |  |" in lines
    assert "| lib open | 0 of 2; energy violated; symmetry open | casimir |" in lines
    assert "- pendulum: lib heun 6; other solvers 6 to 6" in lines
    assert "the command" in page
    assert "† less than documented: [shown in the library's own terms](deviations.md)." in lines


def absent(name: str) -> Peer:
    raise TargetError(expected=f"the library {name}", received=f"No module named {name!r}", remedy="pip")


def test_a_missing_library_is_left_out_and_said_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compliance, "solver_cells", lambda *_: [])
    monkeypatch.setattr(compliance, "scheme_row", lambda *_: _row())
    monkeypatch.setattr(compliance, "load", absent)
    result = CliRunner().invoke(compliance.main, ["--library", "torchsde"])
    assert result.exit_code == 0
    assert "torchsde left out" in result.stderr


def test_an_interrupted_table_goes_on_where_it_was_and_is_the_same(tmp_path, monkeypatch):
    laws = ("identity", "truncation", "mean-square-order")
    measured: list[str] = []
    original = measurements._finding

    def finding(scheme: Scheme, law: str, effort: Effort) -> dict[str, Any]:
        measured.append(law)
        if measured == ["identity", "truncation"]:
            raise KeyboardInterrupt
        return original(scheme, law, replace(effort, examples=3, paths=64))

    monkeypatch.setattr(compliance, "load", absent)
    monkeypatch.setattr(compliance, "LAWS", laws)
    monkeypatch.setattr(compliance, "load_laws", lambda: load_laws(laws))
    monkeypatch.setattr(measurements, "_finding", finding)
    monkeypatch.setattr(rows, "LAWS", laws)
    keep, out = tmp_path / "kept", tmp_path / "table.md"
    arguments = ["--library", "sdeint", "--keep", str(keep), "--out", str(out)]

    stopped = CliRunner().invoke(compliance.main, arguments)
    assert (stopped.exit_code, out.exists()) == (130, False)
    assert f"interrupted: what was measured is in {keep}" in stopped.stderr
    assert CliRunner().invoke(compliance.main, arguments).exit_code == 0
    assert measured == ["identity", "truncation", "truncation", "mean-square-order"]
    first = out.read_text("utf-8")
    assert "| sepv energy-preserving | 2 of 3; mean-square-order open |  |" in first
    assert CliRunner().invoke(compliance.main, arguments).exit_code == 0
    assert len(measured) == 4
    assert out.read_text("utf-8") == first
    # Another seed is another measurement.
    assert CliRunner().invoke(compliance.main, [*arguments, "--seed", "1"]).exit_code == 0
    assert len(measured) == 7
    (file,) = keep.iterdir()
    file.write_text("[]")
    damaged = CliRunner().invoke(compliance.main, arguments)
    assert damaged.exit_code != 0
    assert "remove it" in damaged.stderr + str(damaged.exception)


def test_whole_paths_of_a_solver_of_order_one_have_their_order_and_their_limit() -> None:
    """Heun's method as a solver of paths; and Euler's, whose limit is Itô's."""
    verdicts = {}
    for name, half in (("heun", 0.5), ("euler", 0.0)):

        def path(problem: Problem, y0: Any, h: float, dW: Any, half: float = half) -> np.ndarray:
            states = [np.repeat(y0[:, None], dW.shape[2], axis=1)]
            for row in dW:
                y, delta = states[-1], problem.random_step(h, row)
                f = vector_field(problem, y)
                states.append(y + delta * ((1 - half) * f + half * vector_field(problem, y + delta * f)))
            return np.array(states)

        solver = PathSolver(f"own {name}", path, 1.0)
        cells = {(c.solver, c.name): c.measure() for c in measurements.path_cells("sepv", solver, QUICK)}
        cells |= {(solver.name, f"energy defect, {s.problem}"): "1" for s in measurements.SETUPS}
        verdicts[name] = rows.path_row("sepv", solver, cells).verdicts
    assert verdicts["heun"] == {"mean-square-order": "holds +", "right-limit": "holds +"}
    assert verdicts["euler"] == {"mean-square-order": "– +", "right-limit": "– +"}


def test_a_note_says_why_a_mark_is_not_what_it_seems() -> None:
    order = {"verdict": "violated", "message": "", "measured": [{"interval": [0.45, 0.6]}]}
    limit = {"verdict": "violated", "message": "wrong by 5 %", "measured": ()}
    message = "not measured:\ny = 0\nThe scheme raised.\nExpected\nRemedy"
    error = {"verdict": "error", "message": message, "measured": ()}
    scheme = Scheme("own", lambda problem, y, h, dW: y)
    found = list(rows._notes(scheme, {"identity": error, "mean-square-order": order, "right-limit": limit}))
    assert found[0] == "own, identity: The scheme raised."
    assert found[1].startswith("own, right-limit: the error itself falls")
    order["measured"] = [{"interval": [-0.1, 0.2]}]  # the error stays: then it is a wrong limit
    assert not list(rows._notes(scheme, {"mean-square-order": order, "right-limit": limit}))


NOTED = 'NOTES = [("README, 1.0", "2020-02-29", "order 1, not tested")]\n'


NO_NOTES = (
    "",
    "NOTES = []\n",
    'NOTES = [("README", "soon", "x")]\n',
    'NOTES = [("README", "2020-02-29", " ")]\n',
    "NOTES = 3\n",
)


@pytest.mark.parametrize("notes", NO_NOTES)
def test_nothing_is_published_without_what_the_library_itself_says(tmp_path: Path, notes: str) -> None:
    (tmp_path / "one.py").write_text(f'"""lib heun: statement."""\n{notes}raise SystemExit(1)\n')
    with pytest.raises(UsageError, match="what the library itself says"):
        deviations.deviations_shown_by(tmp_path)


def test_only_scripts_that_still_show_a_deviation_are_quoted(tmp_path: Path) -> None:
    for name, code in (("gone", 0), ("there", 1), ("broken", 2)):
        (tmp_path / f"{name}.py").write_text(
            f'"""lib {name}: statement.\n\nWhy.\n"""\n{NOTED}print("shown")\nraise SystemExit({code})\n'
        )
    (tmp_path / "crash.py").write_text(f'"""lib crash: statement."""\n{NOTED}raise ValueError\n')
    (found,) = deviations.deviations_shown_by(tmp_path)
    assert found.solver == "lib there"
    assert "### lib there: statement." in found.text
    assert found.text.index("README, 1.0, 2020-02-29: “order 1, not tested”") < found.text.index("Why.")
    assert "shown" in found.text


@pytest.mark.parametrize("script", sorted((DOCS / "peers").glob("*.py")), ids=lambda p: p.stem)
def test_every_script_is_quoted_on_the_page(script: Path) -> None:
    """Its statement, the library's own words, the measurement: on deviations.md or on integrator-deviations.md."""
    pages = {name: (DOCS / name).read_text("utf-8") for name in deviations.TITLES}
    (name,) = (name for name, text in pages.items() if f"peers/{script.name}) prints" in text)
    page = pages[name]
    tree = ast.parse(script.read_text("utf-8"))
    title, _, rest = (ast.get_docstring(tree) or "").partition("\n")
    output = page.partition(f"peers/{script.name}) prints")[2].split("```")[1].strip()
    body, notes = rest.split("Exit code 1")[0].strip(), _notes(script.name, tree)
    shown = Script(script.name, title, body, notes, 1, output, "")
    section = deviations.section(shown, "peers")
    assert section.removeprefix("#") in page
    assert deviations.Deviation(shown.solver, section).page == name


def test_a_script_shows_its_deviation_without_sepv() -> None:
    torchsde = pytest.importorskip("torchsde", reason="torchsde is not installed: the extra `peers`")
    if torchsde.__version__ != "0.2.6":
        pytest.skip(f"shown for torchsde 0.2.6, this is {torchsde.__version__}")
    script = DOCS / "peers" / "torchsde_milstein.py"
    assert subprocess.run([sys.executable, script], capture_output=True, check=False).returncode == 1
