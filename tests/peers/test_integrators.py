"""Integrators of samplers and simulators through their own code. Each library is skipped where it is missing."""

import ast
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from sepv.reference.peers.peer import Peer, names

from benchmarks.peers import integrators as page
from benchmarks.peers.deviations import _notes
from sepv.errors import Skipped, TargetError
from sepv.exact import exact_flow
from sepv.problem import Problem
from sepv.problems import by_name, henon_heiles, pendulum, planets, rigid_body
from sepv.problems._mechanical import positions_first
from sepv.schemes import Scheme, leapfrog, load_scheme
from sepv.studies._compare.method import load_method
from sepv.verification import Effort, verify

LIBRARIES = (
    "ase", "blackjax", "diffrax", "jax_md", "mici", "numpyro", "openmm", "pymc", "rebound", "scipy", "torch_sim",
)  # fmt: skip
DOCS = Path(__file__).resolve().parents[2] / "docs"
SCRIPTS = [path for folder in ("peers", "integrators") for path in sorted((DOCS / folder).glob("*.py"))]
NONE = np.zeros(0)


def peer(library: str) -> Peer:
    pytest.importorskip(library, reason=f"{library} is not installed: the extras `samplers` and `simulators`")
    found: Peer = import_module(f"sepv.reference.peers.{library}").PEER
    return found


def error(scheme: Scheme, problem: Problem, h: float) -> float:
    y = np.array(problem.initial, dtype=np.float64)
    exact = exact_flow(problem, np.array([h])).y[:, 0]
    return float(np.abs(scheme.step(problem, y, h, NONE) - exact).max())


@pytest.mark.parametrize("library", LIBRARIES)
def test_every_integrator_steps_with_its_order(library: str) -> None:
    for name, scheme in peer(library).integrators.items():
        if scheme.order is None or name == "implicit-leapfrog":
            continue
        problem = planets(noise=()) if scheme.problems else henon_heiles(noise=())
        far, near = error(scheme, problem, 0.4), error(scheme, problem, 0.2)
        # Errors of h^(p+1) with a little of the next power; those of order 8 end in rounding.
        assert far < 1e-2
        assert near < 1e-15 or np.log2(far / near) > scheme.order + 0.5, name


@pytest.mark.parametrize(
    "name", ["mici-leapfrog", "ase-velocity-verlet", "numpyro-velocity-verlet", "openmm-verlet"]
)
def test_a_library_is_given_masses_and_forces_in_either_order_of_y(name: str) -> None:
    peer(name.split("-", maxsplit=1)[0])
    scheme = load_scheme(name)
    for problem in (pendulum(noise=()), by_name("pendulum-chain")):
        y, h = np.array(problem.initial, dtype=np.float64), 0.125
        y1 = scheme.step(problem, y, h, np.zeros(problem.noises))
        assert np.allclose(y1, leapfrog.step(problem, y, h, np.zeros(problem.noises)), rtol=0, atol=4e-15)


def test_mici_keeps_what_it_claims_but_a_step_of_its_implicit_leapfrog_is_two() -> None:
    found = peer("mici").integrators
    report = verify(found["leapfrog"], laws="contract,symplecticity,symmetry", effort=Effort(examples=20))
    assert [f.verdict.text for f in report.findings] == ["holds"] * 3
    problem = henon_heiles(noise=())
    y, h = np.array(problem.initial), 0.01
    twice = exact_flow(problem, np.array([2 * h])).y[:, 0]
    assert np.allclose(found["implicit-leapfrog"].step(problem, y, h, NONE), twice, rtol=0, atol=1e-6)


def test_systems_that_a_library_cannot_take_are_left_out() -> None:
    scheme = peer("scipy").integrators["dop853"]
    with pytest.raises(Skipped, match="mechanical problem"):
        scheme.step(rigid_body(noise=()), np.ones(3), 0.1, NONE)


def test_an_integrator_is_compared_step_by_step_and_a_wrong_name_lists_them() -> None:
    scheme, problem = peer("mici").integrators["leapfrog"], henon_heiles(noise=())
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
    scheme = peer("rebound").integrators["whfast"]
    problem, h = orbit_in_space(2.5, 0.0), 0.3
    start = np.array(problem.initial, dtype=np.float64)
    # The Wisdom-Holman map of two bodies is Kepler's motion.
    exact = exact_flow(problem, np.array([h])).y[:, 0]
    assert np.allclose(scheme.step(problem, start, h, NONE), exact, rtol=0, atol=2e-14)
    for other in (orbit_in_space(2.5, 1e-3), henon_heiles(noise=()), by_name("lennard-jones")):
        with pytest.raises(Skipped, match="gravity alone"):
            scheme.step(other, np.array(other.initial, dtype=np.float64), h, np.zeros(other.noises))


def test_every_library_has_a_file_and_only_libraries_do() -> None:
    assert set(LIBRARIES) <= set(names())
    assert not [name for name in names() if name.startswith("_")]


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_quotes_the_library_and_does_not_know_sepv(script: Path) -> None:
    tree = ast.parse(script.read_text("utf-8"))
    assert _notes(script.name, tree)
    assert "import sepv" not in script.read_text("utf-8")
    assert "from sepv" not in script.read_text("utf-8")


def test_the_page_names_claims_defects_and_scripts() -> None:
    scheme = Scheme("lib verlet", lambda problem, y, h, dW: y, order=2, source='its manual: "symplectic"')
    held = {"verdict": "holds", "claimed": True, "message": "", "defect": 1.0, "bound": 2.0}
    found = dict.fromkeys(page.ASKED, held)
    found["symplecticity"] = {**held, "verdict": "violated", "defect": 30.0}
    here = [page.Deviation("lib verlet", "### lib verlet: no.")]
    text = page.document([page.Row("lib", "1.0", scheme, found)], here, [], "the command")
    assert "lib verlet (2) †" in text
    assert "defects against bounds" not in text, "the script shows them"
    assert 'its manual: "symplectic"' in text
    assert "- † [differs from its documentation](integrator-deviations.md): lib verlet\n" in text
    text = page.document([page.Row("lib", "1.0", scheme, found)], [], here, "the command")
    assert "- † [keeps these invariants, but not to rounding](integrator-rounding.md): lib verlet\n" in text
    text = page.document([page.Row("lib", "1.0", scheme, found)], [], [], "the command")
    assert "- lib verlet, defects against bounds: symplecticity 30 against 2" in text
    assert "\n## lib verlet: no." in page.rounding(here, "the command")
