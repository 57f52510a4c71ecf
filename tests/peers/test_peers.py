"""Other libraries' solvers through their own code, and the compliance table. Each library is skipped where missing."""

from __future__ import annotations

import ast
import subprocess
import sys
from dataclasses import replace
from importlib import import_module
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings

from benchmarks.peers import compliance, deviations
from benchmarks.peers import compliance_measurements as measurements
from benchmarks.peers import compliance_rows as rows
from benchmarks.peers.deviations import Shown as Script
from benchmarks.peers.deviations import _notes
from sepv import problems
from sepv.commands._cli import main
from sepv.errors import Skipped, TargetError, UsageError
from sepv.peers.peer import Peer, names
from sepv.peers.posing import PathSolver, in_blocks, pose
from sepv.problem import PolynomialSystem, Problem, vector_field
from sepv.schemes import Scheme, load_scheme
from sepv.verification import Case, Effort, Verdict, load_laws, verify
from sepv.verification.strategies import any_steps

DOCS = Path(__file__).resolve().parents[2] / "docs"
QUICK = Effort(examples=20, paths=256, shrink_checks=30)


def adapter(library: str) -> ModuleType:
    pytest.importorskip(library, reason=f"{library} is not installed: the extra `peers`")
    return import_module(f"sepv.peers.{library}")


# The problems as data


@given(any_steps())
@settings(max_examples=50, deadline=None)
def test_the_field_in_another_namespace_is_the_field(case: Case) -> None:
    problem, y, _h, _dW = case.build()
    ours = vector_field(problem, y)
    size = np.abs(problem.structure(y)) @ np.abs(problem.gradient(y))
    for padded in (True, False):
        formulas, numbers = pose(problem, padded=padded)
        theirs = formulas.field(np, numbers, y)
        # Both sum the same few dozen terms, in different orders; cancellation inside B and ∇H is covered by the 1.
        assert np.all(np.abs(theirs - ours) <= 1e-13 * (size + np.abs(y).max() + 1))


def test_a_problem_without_data_is_refused_with_a_remedy() -> None:
    problem = Problem(2, lambda y: y, lambda y: y, lambda y: y, check=False)
    with pytest.raises(Skipped, match="polynomial_problem"):
        pose(problem)


@pytest.mark.parametrize("count", [1, 2, 3, 7, 8])
def test_blocks_are_always_full_and_only_what_was_asked_for_comes_back(count: int) -> None:
    seen = []

    def double(y: np.ndarray, dW: np.ndarray) -> np.ndarray:
        seen.append((y.shape, dW.shape))
        return 2 * y

    y = np.arange(2.0 * count).reshape(2, count)
    assert np.array_equal(in_blocks(double, y, np.ones((0, count)), 3), 2 * y)
    assert set(seen) == {((2, 3), (0, 3))}
    assert np.array_equal(in_blocks(double, y[:, 0], np.ones(1), 3), 2 * y[:, 0])


# One law of each library against theory, and the library's own integration of the same step


@pytest.mark.parametrize("library", ["diffrax", "torchsde"])
def test_heun_converges_to_the_stratonovich_solution_and_does_not_keep_the_energy(library: str) -> None:
    report = verify(adapter(library).heun, laws=["contract", "energy", "right-limit"], effort=QUICK)
    assert report.finding("contract").verdict is Verdict.HOLDS
    assert report.finding("energy").verdict is Verdict.VIOLATED
    assert report.finding("right-limit").verdict is Verdict.HOLDS


def test_sdeints_runge_kutta_method_gets_its_repeated_integrals_and_does_not_keep_the_energy() -> None:
    module = adapter("sdeint")
    import sdeint

    problem, h, dW = problems.rigid_body(), 0.125, np.array([0.3])
    y = np.asarray(problem.initial)

    def f(state: np.ndarray, _t: float) -> np.ndarray:
        return vector_field(problem, state)

    # One noise: its repeated integral is ½ΔW² whatever sdeint draws.
    theirs = sdeint.stratSRS2(f, [f], y, np.array([0.0, h]), dW=dW[None])[-1]
    assert np.allclose(module.strat_srs2.step(problem, y, h, dW), theirs, rtol=0, atol=4e-16)
    report = verify(module.strat_srs2, laws=["contract", "energy"], effort=QUICK)
    assert report.finding("contract").verdict is Verdict.HOLDS
    assert report.finding("energy").verdict is Verdict.VIOLATED


@pytest.mark.parametrize("library", ["diffrax", "torchsde"])
def test_a_path_has_the_same_bits_alone_and_in_a_batch(library: str) -> None:
    problem, rng = problems.pendulum(), np.random.default_rng(5)
    y, dW = rng.standard_normal((2, 70)), 0.1 * rng.standard_normal((2, 70))
    scheme = adapter(library).heun
    together = scheme.step(problem, y, 0.125, dW)
    for lane in (0, 63, 64, 69):
        assert np.array_equal(scheme.step(problem, y[:, lane], 0.125, dW[:, lane]), together[:, lane])


def test_diffrax_steps_as_diffeqsolve_does() -> None:
    module = adapter("diffrax")
    import diffrax
    import jax
    import jax.numpy as jnp

    problem, h, dW = problems.pendulum(), 0.125, np.array([0.2, -0.3])
    with jax.enable_x64(True):
        path = diffrax.LinearInterpolation(jnp.array([0.0, h]), jnp.stack([jnp.zeros(2), jnp.asarray(dW)]))

        def f(_t: float, y: jax.Array, _args: None) -> jax.Array:
            return jnp.stack([-jnp.sin(y[1]), y[0]])

        def g(t: float, y: jax.Array, args: None) -> jax.Array:
            return jnp.outer(f(t, y, args), jnp.asarray(problem.c))

        terms = diffrax.MultiTerm(diffrax.ODETerm(f), diffrax.ControlTerm(g, path))
        y0 = jnp.asarray(problem.initial)
        for scheme, solver in (
            (module.heun, diffrax.Heun()),
            (module.midpoint, diffrax.Midpoint()),
            (module.reversible_heun, diffrax.ReversibleHeun()),
        ):
            theirs = diffrax.diffeqsolve(terms, solver, 0.0, h, h, y0).ys[0]
            ours = scheme.step(problem, np.asarray(problem.initial), h, dW)
            assert np.allclose(ours, theirs, rtol=0, atol=4e-16), scheme.name
    assert not jax.config.jax_enable_x64


def test_diffrax_compiles_nothing_for_another_polynomial_problem() -> None:
    module = adapter("diffrax")
    before = None
    for entry in (1.0, 2.0):
        H = problems.from_json(
            {"dimension": 3, "hamiltonian": [[[2, 0, 1], entry]], "structure": [[0, 1, [[[1, 0, 0], 1.0]]]]}
        )
        assert isinstance(H, PolynomialSystem)
        module.heun.step(problems.build(H), np.ones(3), 0.1, np.array([0.1]))
        size = module._steps._cache_size()
        assert before in (None, size)
        before = size


def test_the_space_time_area_is_normal_with_variance_h_over_12_and_independent_of_the_increment() -> None:
    module = adapter("diffrax")
    import jax

    h, M = 0.25, 4096
    dW = np.sqrt(h) * np.random.default_rng(0).standard_normal((M, 1))
    with jax.enable_x64(True):
        area = np.asarray(jax.vmap(lambda w: module._space_time_area(np.float64(h), w))(dW))[:, 0]
    # The increments are fixed, hence so is everything here: five standard errors, once and for all.
    assert abs(np.mean(area**2) * 12 / h - 1) < 5 * np.sqrt(2 / M)
    assert abs(np.mean(area)) < 5 * np.sqrt(h / 12 / M)
    assert abs(np.corrcoef(area, dW[:, 0])[0, 1]) < 5 / np.sqrt(M)


def test_slow_rk_has_order_one_and_a_half_with_the_area_it_asks_for() -> None:
    report = verify(adapter("diffrax").slow_rk, laws=["mean-square-order"], effort=QUICK)
    assert report.finding("mean-square-order").verdict is Verdict.HOLDS


def test_torchsde_steps_as_sdeint_with_a_brownian_interval_does() -> None:
    module = adapter("torchsde")
    import torch
    import torchsde

    class Oscillator(torch.nn.Module):  # type: ignore[misc]
        noise_type, sde_type = "scalar", "stratonovich"

        def f(self, _t: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
            return torch.stack([-y[:, 1], y[:, 0]], dim=1)

        def g(self, t: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
            return self.f(t, y).unsqueeze(-1)

    y, h, dW = np.array([0.2, 0.1]), 0.125, np.array([-0.4])
    W = torchsde.BrownianInterval(0.0, h, W=torch.as_tensor(dW[None]), levy_area_approximation="foster")
    for scheme, method in ((module.midpoint, "midpoint"), (module.log_ode, "log_ode")):
        theirs = torchsde.sdeint(Oscillator(), torch.as_tensor(y[None]), [0.0, h], bm=W, method=method, dt=h)[
            -1, 0
        ]
        ours = scheme.step(problems.harmonic_oscillator(), y, h, dW)
        assert np.allclose(ours, theirs.numpy(), rtol=0, atol=1e-16)


def test_torchsdes_milstein_does_not_hold_its_declared_order() -> None:
    with np.errstate(over="ignore"):  # most of its paths leave every bound
        report = verify(adapter("torchsde").milstein, laws=["mean-square-order"], effort=QUICK)
    assert report.finding("mean-square-order").verdict in (Verdict.VIOLATED, Verdict.ERROR)
    assert report.exit_code != 0


@pytest.mark.parametrize("library", ["diffrax", "torchsde", "sdeint"])
def test_whole_paths_begin_with_the_single_step(library: str) -> None:
    module = adapter(library)
    problem, h, rng = problems.pendulum(), 0.125, np.random.default_rng(1)
    dW = np.sqrt(h) * rng.standard_normal((4, 2, 3))
    start = np.asarray(problem.initial)
    (solver,) = module.PEER.paths
    states = solver.path(problem, start, h, dW)
    assert states.shape == (5, 2, 3)
    first = list(module.PEER.schemes.values())[-1]
    for lane in range(3):
        expected = first.step(problem, start, h, dW[0, :, lane])
        assert np.allclose(states[1, :, lane], expected, rtol=0, atol=4e-16)
        # And go on with the state they carry: a second step afresh is another one.
        afresh = first.step(problem, states[1, :, lane].copy(), h, dW[1, :, lane])
        assert np.max(np.abs(states[2, :, lane] - afresh)) > 1e-10


# The registry


def test_a_package_offers_a_library_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One file and one entry point: the other commands know it by name then."""
    (tmp_path / "stepper.py").write_text(
        "from sepv.peers.peer import Peer\n"
        "from sepv.schemes import Scheme, midpoint\n"
        "from sepv.studies._compare.method import from_scheme\n"
        "from sepv.problems import rigid_body\n"
        "own = Scheme(name='stepper half', step=midpoint.step, mean_square_order=1.0)\n"
        "PEER = Peer('stepper', {'half': own}, {'half': from_scheme(own, rigid_body())})\n"
    )
    info = tmp_path / "stepper-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: stepper\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[sepv.peers]\nstepper = stepper:PEER\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    assert "stepper" in names()
    listed = CliRunner().invoke(main, ["peers"]).stdout
    assert "stepper-half" in listed
    judged = CliRunner().invoke(
        main, ["verify", "stepper-half", "--law", "energy,casimir", "--examples", "2"]
    )
    assert "energy violated" in judged.stdout
    shown = CliRunner().invoke(
        main, ["compare", "stepper-half", "--paths", "32", "--steps", "4,8", "--repeats", "1"]
    )
    assert shown.exit_code == 0, shown.output
    assert "stepper half" in shown.stdout
    wrong = CliRunner().invoke(main, ["verify", "stepper-hlaf"])
    assert wrong.exit_code == 3
    assert "did you mean 'stepper-half'" in wrong.stderr


def test_an_entry_point_that_gives_no_peer_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    point = EntryPoint("other", "sepv.problems:PAPER", "sepv.peers")
    monkeypatch.setattr("sepv.peers.peer.metadata.entry_points", lambda **_: [point])
    with pytest.raises(TargetError, match=r"a sepv.peers.peer.Peer at sepv.problems:PAPER"):
        load_scheme("other-heun")


def test_a_library_is_named_by_what_imports_it_and_its_own_solvers() -> None:
    assert {"diffrax", "sdeint", "torchsde"} <= set(names())
    scheme = load_scheme("sdeint-strat-heun")
    assert scheme.name == "sdeint stratHeun"


# The table


def _row(**changes: object) -> compliance.Row:
    given: dict[str, object] = {
        "library": "lib",
        "release": "1.0",
        "solver": "heun",
        "source": "its manual",
        "claimed": "1 / 1",
        "orders": ("1.0", "1.1"),
        "energy": ("5", "6"),
        "verdicts": {"energy": "–", "contract": "holds +"},
    }
    return compliance.Row(**{**given, **changes})  # type: ignore[arg-type]


def test_the_page_groups_solvers_by_their_verdicts_and_marks_what_is_contradicted() -> None:
    marks = {"energy": "– +", "symmetry": "? +", "casimir": "holds", "truncation": "n/a"}
    found = [
        _row(),
        _row(solver="twin"),
        _row(library="other", solver="box"),
        _row(solver="open", verdicts=marks),
    ]
    page = compliance.document(found, [deviations.Deviation("lib heun", "### lib heun: no")], "the command")
    lines = page.splitlines()
    assert "5 laws were measured: contract, energy, casimir, symmetry, truncation." in page
    assert "| lib heun; twin; other box | 1 of 1 |  |  |" in lines
    assert "| lib open | 0 of 2; energy violated; symmetry open | casimir | truncation |" in lines
    assert "| lib heun | 1 / 1 † | 1.0 | 1.1 | 5 | 6 |" in lines
    assert "the command" in page
    assert "- lib heun: no ([shown](deviations.md))." in lines


def absent(name: str) -> Peer:
    raise TargetError(expected=f"the library {name}", received=f"No module named {name!r}", remedy="pip")


def test_a_missing_library_is_left_out_and_said_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compliance, "solver_cells", lambda *_: [])
    monkeypatch.setattr(compliance, "scheme_row", lambda *_: _row())
    monkeypatch.setattr(compliance, "load", absent)
    result = CliRunner().invoke(compliance.main, ["--library", "torchsde"])
    assert result.exit_code == 0
    assert "torchsde left out" in result.stderr


def test_an_interrupted_table_goes_on_where_it_was_and_is_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
    assert "| sepv energy-preserving | 2 of 3; mean-square-order open |  |  |" in first
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

        def path(
            problem: Problem, y0: np.ndarray, h: float, dW: np.ndarray, half: float = half
        ) -> np.ndarray:
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
    error = {
        "verdict": "error",
        "message": "not measured:\ny = 0\nThe scheme raised.\nExpected\nRemedy",
        "measured": (),
    }
    scheme = Scheme("own", lambda problem, y, h, dW: y)
    found = list(rows._notes(scheme, {"identity": error, "mean-square-order": order, "right-limit": limit}))
    assert found[0] == "own, identity: The scheme raised."
    assert found[1].startswith("own, right-limit: the error itself falls")
    order["measured"] = [{"interval": [-0.1, 0.2]}]  # the error stays: then it is a wrong limit
    assert not list(rows._notes(scheme, {"mean-square-order": order, "right-limit": limit}))


NOTED = 'NOTES = [("README, 1.0", "2020-02-29", "order 1, not tested")]\n'


@pytest.mark.parametrize(
    "notes",
    [
        "",
        "NOTES = []\n",
        'NOTES = [("README", "soon", "x")]\n',
        'NOTES = [("README", "2020-02-29", " ")]\n',
        "NOTES = 3\n",
    ],
)
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
    """Its statement, what the library itself says, and then the measurement."""
    page = (DOCS / "deviations.md").read_text("utf-8")
    tree = ast.parse(script.read_text("utf-8"))
    title, _, rest = (ast.get_docstring(tree) or "").partition("\n")
    output = page.partition(f"peers/{script.name}) prints")[2].split("```")[1].strip()
    body, notes = rest.split("Exit code 1")[0].strip(), _notes(script.name, tree)
    shown = Script(script.name, title, body, notes, 1, output, "")
    assert deviations.section(shown, "peers").removeprefix("#") in page


def test_a_script_shows_its_deviation_without_sepv() -> None:
    torchsde = pytest.importorskip("torchsde", reason="torchsde is not installed: the extra `peers`")
    if torchsde.__version__ != "0.2.6":
        pytest.skip(f"shown for torchsde 0.2.6, this is {torchsde.__version__}")
    script = DOCS / "peers" / "torchsde_milstein.py"
    assert "sepv" not in script.read_text("utf-8")
    assert subprocess.run([sys.executable, script], capture_output=True, check=False).returncode == 1
