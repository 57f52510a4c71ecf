"""Drivers and integrators of other libraries, skipped where missing,
and the table of orders for general noise.
"""

import ast
import math
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.peers import integrators as page
from benchmarks.peers import solver_measurements as measurements
from benchmarks.peers import solvers
from benchmarks.peers.deviations import _notes
from benchmarks.peers.solver import NOISE_KINDS, problem_of
from benchmarks.peers.solver import scheme as scheme_for
from sepv import Effort, Skipped, TargetError, exact_flow, integrate, problems, verify
from sepv.peers.peer import Peer, Solver, load, names
from sepv.posing import pose_fields
from sepv.problem import Array, Problem, column, ito_drift, noise_field, vector_field
from sepv.problems import by_name, henon_heiles, pendulum, planets, rigid_body
from sepv.problems._mechanical import positions_first
from sepv.schemes import Scheme, leapfrog, load_scheme
from sepv.schemes._further_increments import answer
from sepv.simulate import _areas as areas
from sepv.simulate import _wiener as wiener
from sepv.studies._compare.method import Method, load_method
from sepv.studies._compare.run import compare

LIBRARIES = ("diffrax", "torchsde", "sdeint")
LOCAL = ("local-mean", "local-mean-square", "local-weak")


def solver(library: str, name: str) -> Solver:
    pytest.importorskip(library, reason=f"{library} is not installed: the extra `peers`")
    return next(each for each in load(library).solvers if each.name == f"{library} {name}")


@pytest.mark.parametrize("kind", NOISE_KINDS)
def test_each_kind_has_a_problem_of_its_kind_whose_fields_are_posed(kind: str) -> None:
    problem = problem_of(kind)
    assert column(problem) == kind
    y = np.random.default_rng(0).uniform(-1, 1, (problem.dimension, 5))
    for ito in (False, True):
        fields, numbers = pose_fields(problem, ito=ito)
        drift = ito_drift(problem, y) if ito else vector_field(problem, y)
        assert np.allclose(fields.drift(np, numbers, y), drift, rtol=1e-13, atol=1e-13)
        noise = [c * noise_field(problem, j, y) for j, c in enumerate(problem.c)]
        assert np.allclose(fields.noise(np, numbers, y), noise, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize(
    ("library", "name"),
    [("diffrax", "SlowRK"), ("torchsde", "srk"), ("torchsde", "log_ode"), ("sdeint", "itoSRI2")],
)
def test_a_solver_follows_the_path_of_the_reference(library, name, monkeypatch):
    """Of another path, or of areas of another path, the error would stay."""
    monkeypatch.setattr(measurements, "SOLVER_STEPS", (4, 32))
    monkeypatch.setattr(measurements, "BATCH_PATHS", 64)
    monkeypatch.setattr(measurements, "UNBATCHED_PATHS", 32)
    found = measurements._over_paths(solver(library, name), "one", 0)
    assert found["failed"] == 0
    assert found["rms"][1] < found["rms"][0] / 5 < 0.01


def test_areas_of_the_wrong_sign_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = solver("torchsde", "log_ode")
    right = measurements._local(asked, "general", Effort())["local-mean-square"]["slope"]
    step = asked.step("general")
    monkeypatch.setattr(measurements, "LOCAL_LAWS", ("local-mean-square",))
    wrong = replace(asked, name="turned", step=lambda _: lambda p, y, h, dW, A: step(p, y, h, dW, -A))
    turned = measurements._local(wrong, "general", Effort())["local-mean-square"]["slope"]
    assert right == pytest.approx(1.5, abs=0.1)
    assert turned == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("library", LIBRARIES)
def test_limits_are_told_apart(library: str) -> None:
    names = {
        "diffrax": {"Euler": "Itô", "Heun": "Stratonovich"},
        "torchsde": {"srk": "Itô", "midpoint": "Stratonovich"},
        "sdeint": {"itoEuler": "Itô", "stratHeun": "Stratonovich"},
    }[library]
    for name, expected in names.items():
        asked = solver(library, name)
        assert measurements.limit_of(measurements._limit(asked, "one")) == expected
        assert measurements.limit_of(measurements._limit(asked, "additive")) == "both"
    if library == "torchsde":  # ½ΔW²(∂g/∂y)ᵀg, see docs/peers
        asked = solver(library, "milstein, Stratonovich")
        assert measurements.limit_of(measurements._limit(asked, "one")) == "neither"


@pytest.mark.parametrize("library", LIBRARIES)
def test_a_step_is_its_library_s_own_run(library: str) -> None:
    """One state and a batch agree, and rows of areas reach the solver."""
    name = {"diffrax": "SPaRK", "torchsde": "log_ode", "sdeint": "stratSRS2"}[library]
    asked = solver(library, name)
    problem, scheme = problems.by_name("random-inertia"), scheme_for(asked, "general")
    rows = areas.drawn(1, T=0.5, steps=2, noises=2, paths=3).rows(2, asked.asks)[0]
    y = np.array(problem.initial)
    single = [answer(scheme, problem, y, 0.25, rows[:, k]) for k in range(3)]
    if asked.batched:
        batch = answer(scheme, problem, np.repeat(y[:, None], 3, axis=1), 0.25, rows)
        assert np.array_equal(batch, np.stack(single, axis=1))
    changed = rows.copy()
    changed[-1] += 0.125
    assert not np.allclose(answer(scheme, problem, y, 0.25, changed[:, 0]), single[0], atol=1e-4)


@pytest.mark.parametrize(("library", "name"), [("diffrax", "Euler"), ("torchsde", "euler")])
def test_a_solver_of_ito_equations_refuses_a_system_without_its_form(library: str, name: str) -> None:
    problem = rigid_body()
    with pytest.raises(Skipped, match="several Hamiltonians given as data"):
        solver(library, name).step("one")(problem, np.array(problem.initial), 0.1, np.zeros(problem.noises))


def _found(solver: Solver, **changes: object) -> dict[tuple[str, str], object]:
    local = {law: {"slope": s} for law, s in zip(LOCAL, (2.0, 1.5, 2.0), strict=True)}
    given: dict[str, object] = {
        "one step": local, "limit": {"share": 1.0, "left": 0.0}, "casimir": "violated", "poisson-map": "violated",
        "paths": {"order": (1.0, 0.9, 1.1), "failed": 0}, **changes,
    }  # fmt: skip
    return {(solver.name, f"one, {name}"): value for name, value in given.items()}


def test_a_line_says_where_less_was_measured_than_documented() -> None:
    asked = Solver("lib heun", {"one": (1.0, 1.0)}, "its manual", lambda _: lambda *_: None)
    good = solvers.line(asked, "one", _found(asked))
    assert good.short == ()
    assert good.cells[2:9] == ("1", "1.00", "1.00 [0.90, 1.10]", "1", "1.00", "Stratonovich", "Stratonovich")
    slow, away = {law: {"slope": 1.5} for law in LOCAL}, {"share": 0.0, "left": 0.0}
    bad = solvers.line(asked, "one", _found(asked, **{"one step": slow, "limit": away}))
    assert len(bad.short) == 3
    handed_on = replace(asked, path=lambda _: lambda *_: None)
    late = {"order": (0.5, 0.4, 0.6), "failed": 2}
    found = solvers.line(handed_on, "one", _found(asked, **{"one step": slow, "paths": late}))
    assert found.short == ("strong order 0.50 [0.40, 0.60], 2 failed over paths (documented: 1)",)
    assert math.isinf(float(solvers._number(math.inf).replace("∞", "inf")))


def test_the_documented_order_stands_beside_another_one() -> None:
    assert solvers.beside("0.97 §", "1") == "0.97 §"
    assert solvers.beside("0.50", "1") == "0.50 (1)"
    assert solvers.beside("1.00", "–") == "1.00"
    assert solvers.beside("?", "1") == "? (1)"


def test_a_missing_library_is_left_out_and_said_so(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(name: str) -> None:
        raise TargetError(expected=f"the library {name}", received="not installed", remedy="install it")

    monkeypatch.setattr(solvers, "load", absent)
    result = CliRunner().invoke(solvers.main, ["--library", "torchsde"])
    assert result.exit_code == 0
    assert "torchsde left out" in result.stderr


def test_the_page_is_of_the_solvers_that_are_here() -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "solvers.md").read_text("utf-8")
    for library in LIBRARIES:
        if find_spec(library) is None:
            continue
        for each in load(library).solvers:
            name = each.name.removeprefix(f"{library} ")
            rows = [line.removeprefix("| ").split(" | ") for line in section(page, library).splitlines()]
            (row,) = [row for row in rows if name in row[0].split("; ") and len(row) > 1]
            cells = {kind: cell.strip(" |†") for kind, cell in zip(NOISE_KINDS, row[1:], strict=True)}
            assert {kind for kind, cell in cells.items() if cell} == set(each.documented)
            for kind, documented in each.documented.items():
                for shown, order in zip(cells[kind].split("; "), documented, strict=False):
                    assert shown == solvers.beside(shown.partition(" (")[0], solvers._claim(order))
            assert each.source in section(page, library)
            itos = section(page, library).partition("These solve Itô's equation: ")[2].partition(".\n")[0]
            assert (name in itos.split("; ")) == each.ito


def section(page: str, library: str) -> str:
    return page.partition(f"## {library} ")[2].partition("\n## ")[0]


PROBLEMS = ("rigid-body", "pendulum", "lotka-volterra")


def peer(library: str) -> Peer:
    pytest.importorskip(library, reason=f"{library} is not installed: the extra `peers`")
    return load(library)


def given(problem: Problem, steps: int = 4, paths: int = 3) -> tuple[Array, float, Array]:
    h = 1e-2
    dW = wiener.increments(5, T=h * steps, steps=steps, noises=problem.noises, paths=paths)
    return np.array(problem.initial, dtype=np.float64), h, dW


def ends(method: Method, problem: Problem) -> Array:
    y0, h, dW = given(problem)
    job = method.prepare(problem, y0, h, dW)
    first, again = job(), job()
    assert np.array_equal(first.y, again.y)
    followed = method.follow(problem, y0, h, dW)
    assert np.allclose(followed.ends.y, first.y, rtol=0, atol=1e-14)
    assert not first.status.any()
    return first.y


@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize(
    ("library", "driven", "stepped"),
    [
        ("diffrax", "heun", "heun"), ("diffrax", "heun-vmap", "heun"), ("diffrax", "euler-heun", "euler-heun"),
        ("torchsde", "heun", "heun"), ("torchsde", "midpoint", "midpoint"), ("sdeint", "heun", "strat-heun"),
        ("diffrax", "reversible-heun", "reversible-heun"), ("sdeint", "strat-kp2is", "strat-kp2is"),
    ],
)  # fmt: skip
def test_a_driver_makes_the_steps_that_the_library_makes_one_by_one(library, driven, stepped, name):
    problem = problems.by_name(name)
    scheme, (y0, h, dW) = peer(library).schemes[stepped], given(problem)
    paths = [integrate(scheme, problem, h=h, T=h * len(dW), y0=y0, dW=w) for w in dW.transpose(2, 0, 1)]
    expected = np.stack([path.y[:, -1] for path in paths], axis=1)
    # The drivers pose the m noises as the one that they are, which changes the order of some sums.
    found = ends(load_method(f"{library}-{driven}", problem), problem)
    assert np.allclose(found, expected, rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize(
    ("name", "order"), [("tsit5", 5), ("dopri8", 8), ("spark", 1), ("slow-rk", 1.5), ("reversible-heun", 1)]
)
def test_drivers_converge_to_the_exact_solution_with_their_order(name: str, order: float) -> None:
    method = peer("diffrax").methods[name]
    steps = (8, 16, 32) if order == 8 else (16, 32, 64)
    found = compare([method], problems.rigid_body(), steps=steps, paths=128, repeats=1)
    errors = [p.strong.value for p in found.points]
    slope = float(np.log2(errors[0] / errors[-1]) / 2)
    # Order p of an ordinary method in the random step is mean-square order p/2, for even p
    # (Milstein's theorem), and (p − 1)/2 at least for odd ones. No confidence is claimed: the paths
    # are fixed, and so is the slope.
    least = order if order < 2 else order / 2 - 0.5
    assert least - 0.25 <= slope
    assert all(p.failures == 0 for p in found.points)


OF_INTEGRATORS = (
    "ase", "blackjax", "diffrax", "jax_md", "mici", "numpyro", "openmm", "pymc", "rebound", "scipy", "torch_sim",
)  # fmt: skip
DOCS = Path(__file__).resolve().parents[2] / "docs"
SCRIPTS = [path for folder in ("peers", "integrators") for path in sorted((DOCS / folder).glob("*.py"))]
NONE = np.zeros(0)


def loaded(library: str) -> Peer:
    pytest.importorskip(library, reason=f"{library} is not installed: the extras `samplers` and `simulators`")
    found: Peer = import_module(f"sepv.peers.{library}").PEER
    return found


def error(scheme: Scheme, problem: Problem, h: float) -> float:
    y = np.array(problem.initial, dtype=np.float64)
    exact = exact_flow(problem, np.array([h])).y[:, 0]
    return float(np.abs(scheme.step(problem, y, h, NONE) - exact).max())


@pytest.mark.parametrize("library", OF_INTEGRATORS)
def test_every_integrator_steps_with_its_order(library: str) -> None:
    for name, scheme in loaded(library).integrators.items():
        if scheme.order is None or name == "implicit-leapfrog":
            continue
        problem = planets(noise=()) if scheme.problems else henon_heiles(noise=())
        far, near = error(scheme, problem, 0.4), error(scheme, problem, 0.2)
        # Errors of h^(p+1) with a little of the next power; those of order 8 end in rounding.
        assert far < 10.0 ** -min(scheme.order, 2)
        assert near < 1e-15 or np.log2(far / near) > scheme.order + 0.5, name


@pytest.mark.parametrize(
    "name", ["mici-leapfrog", "ase-velocity-verlet", "numpyro-velocity-verlet", "openmm-verlet"]
)
def test_a_library_is_given_masses_and_forces_in_either_order_of_y(name: str) -> None:
    loaded(name.split("-", maxsplit=1)[0])
    scheme = load_scheme(name)
    for problem in (pendulum(noise=()), by_name("pendulum-chain")):
        y, h = np.array(problem.initial, dtype=np.float64), 0.125
        y1 = scheme.step(problem, y, h, np.zeros(problem.noises))
        assert np.allclose(y1, leapfrog.step(problem, y, h, np.zeros(problem.noises)), rtol=0, atol=4e-15)


# *contract* calls every step of the library hundreds of times more, and other tests ask it of
# schemes that do so too.
@pytest.mark.parametrize(
    "laws", ["poisson-map:constant,symmetry", pytest.param("contract", marks=pytest.mark.deep)]
)
def test_mici_keeps_what_it_claims(laws: str) -> None:
    report = verify(loaded("mici").integrators["leapfrog"], laws=laws, effort=Effort(examples=5))
    assert {f.verdict.text for f in report.findings} == {"holds"}


def test_a_step_of_the_implicit_leapfrog_of_mici_is_two() -> None:
    found = loaded("mici").integrators
    problem = henon_heiles(noise=())
    y, h = np.array(problem.initial), 0.01
    twice = exact_flow(problem, np.array([2 * h])).y[:, 0]
    assert np.allclose(found["implicit-leapfrog"].step(problem, y, h, NONE), twice, rtol=0, atol=1e-6)


def test_systems_that_a_library_cannot_take_are_left_out() -> None:
    scheme = loaded("scipy").integrators["dop853"]
    with pytest.raises(Skipped, match="mechanical problem"):
        scheme.step(rigid_body(noise=()), np.ones(3), 0.1, NONE)


def test_an_integrator_is_compared_step_by_step_and_a_wrong_name_lists_them() -> None:
    scheme, problem = loaded("mici").integrators["leapfrog"], henon_heiles(noise=())
    method, y = load_method("mici-leapfrog", problem), np.array(problem.initial, dtype=np.float64)
    assert method.deterministic
    after = scheme.step(problem, scheme.step(problem, y, 0.1, NONE), 0.1, NONE)
    np.testing.assert_array_equal(method.prepare(problem, y, 0.1, np.zeros((2, 0, 1)))().y[:, 0], after)
    with pytest.raises(TargetError, match="mici-leapfrog, mici-"):
        load_method("mici-leapfrogs", problem)


def orbit_in_space(G: float, tilt: float) -> Problem:
    """Two bodies, of masses 3 and ½, in space."""

    def hamiltonian(y: np.ndarray) -> np.ndarray:
        r = np.sqrt(sum((y[i] - y[i + 3]) ** 2 for i in range(3)))
        kinetic = sum(y[i] ** 2 / 6 + y[i + 3] ** 2 for i in range(6, 9))
        return kinetic - 1.5 * G / r + tilt * y[0]

    start = (0.1, 0.0, 0.2, 1.1, 0.3, 0.0, 0.1, -0.3, 0.0, -0.1, 0.9, 0.2)
    return Problem(12, positions_first, hamiltonian, noise=(), initial=start)


def test_rebound_finds_bodies_and_their_gravity_and_refuses_what_is_none() -> None:
    scheme = loaded("rebound").integrators["whfast"]
    problem, h = orbit_in_space(2.5, 0.0), 0.3
    start = np.array(problem.initial, dtype=np.float64)
    # The Wisdom-Holman map of two bodies is Kepler's motion.
    exact = exact_flow(problem, np.array([h])).y[:, 0]
    assert np.allclose(scheme.step(problem, start, h, NONE), exact, rtol=0, atol=2e-14)
    for other in (orbit_in_space(2.5, 1e-3), henon_heiles(noise=()), by_name("lennard-jones")):
        with pytest.raises(Skipped, match="gravity alone"):
            scheme.step(other, np.array(other.initial, dtype=np.float64), h, np.zeros(other.noises))


def test_every_library_has_a_file_and_only_libraries_do() -> None:
    assert set(OF_INTEGRATORS) <= set(names())
    assert not [name for name in names() if name.startswith("_")]


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_quotes_the_library_and_does_not_know_sepv(script: Path) -> None:
    tree = ast.parse(script.read_text("utf-8"))
    assert _notes(script.name, tree)
    assert "import sepv" not in script.read_text("utf-8")
    assert "from sepv" not in script.read_text("utf-8")


def test_the_page_names_claims_defects_and_scripts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "release", lambda _library: "1.0")
    scheme = Scheme("lib verlet", lambda problem, y, h, dW: y, order=2, source='its manual: "symplectic"')
    held = {"verdict": "holds", "claimed": True, "message": "", "defect": 1.0, "bound": 2.0}
    found = dict.fromkeys(page.JUDGED_LAWS, held)
    found["poisson-map:constant"] = {**held, "verdict": "violated", "defect": 30.0}
    here = [page.Deviation("lib verlet", "### lib verlet: no.")]
    text = page.document([page.Row("lib", scheme, found)], here, [], "the command")
    assert "lib verlet (2) †" in text
    assert "defects against bounds" not in text, "the script shows them"
    assert 'its manual: "symplectic"' in text
    assert "- † [The documentation differs](integrator-deviations.md): lib verlet\n" in text
    text = page.document([page.Row("lib", scheme, found)], [], here, "the command")
    assert "- † [Invariants are kept, but not to rounding](integrator-rounding.md): lib verlet\n" in text
    text = page.document([page.Row("lib", scheme, found)], [], [], "the command")
    assert "- lib verlet, defects against bounds: poisson-map:constant 30 against 2" in text
    assert "\n## lib verlet: no." in page.rounding(here, "the command")
