"""Other libraries' solvers through their own code, skipped where missing,
and problems posed in their arrays.
"""

import importlib.util
import re
import subprocess
import sys
from importlib import import_module
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from doors import command, doc, measured, verdicts
from hypothesis import given

import sepv
from sepv import TargetError, problems
from sepv.law.strategies import any_steps
from sepv.peers.peer import names
from sepv.posing import field_in, in_blocks, pose
from sepv.problem import vector_field
from sepv.schemes import SchemeCrash, ask, load_scheme
from sepv.verification import Case, Verdict

FEW = {"examples": 20, "paths": 256, "shrink_checks": 30}


def adapter(library: str) -> ModuleType:
    pytest.importorskip(library, reason=f"{library} is not installed: the extra `peers`")
    return import_module(f"sepv.peers.{library}")


# The problems as data


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
    found = verdicts(adapter(library).PEER.schemes["heun"], "contract,energy,right-limit", **FEW)
    assert found == {"contract": "holds", "energy": "violated", "right-limit": "holds"}


@pytest.mark.parametrize("name", ["stratHeun", "itoEuler"])
def test_an_adapter_of_sdeint_runs_its_own_code(name: str) -> None:
    """Euler's rule of Itô's kind gets Stratonovich's coefficients,
    as a user would hand them over by mistake.
    """
    sdeint, module = pytest.importorskip("sdeint"), adapter("sdeint")
    problem, h, dW = problems.pendulum(), 0.1, np.array([0.2, -0.1])
    y, integrator = np.asarray(problem.initial), getattr(sdeint, name)
    step = {
        "stratHeun": module.PEER.schemes["strat-heun"].step,
        "itoEuler": module._step_by(integrator, False),
    }[name]
    f = lambda state, _t: vector_field(problem, np.asarray(state))  # noqa: E731  (sdeint wants a callable)
    G = lambda state, _t: np.outer(f(state, _t), problem.c)  # noqa: E731  (the same)
    theirs = integrator(f, G, y, np.array([0.0, h]), dW=dW[None])[-1]
    assert np.array_equal(step(problem, y, h, dW), theirs)


def test_sdeints_runge_kutta_method_gets_its_repeated_integrals_and_does_not_keep_the_energy() -> None:
    scheme = adapter("sdeint").PEER.schemes["strat-srs2"]
    import sdeint

    problem, h, dW = problems.rigid_body(), 0.125, np.array([0.3])
    y = np.asarray(problem.initial)

    def f(state: np.ndarray, _t: float) -> np.ndarray:
        return vector_field(problem, state)

    # One noise: its repeated integral is ½ΔW² whatever sdeint draws.
    theirs = sdeint.stratSRS2(f, [f], y, np.array([0.0, h]), dW=dW[None])[-1]
    assert np.allclose(scheme.step(problem, y, h, dW), theirs, rtol=0, atol=4e-16)
    assert verdicts(scheme, "contract,energy", **FEW) == {
        "contract": "holds",
        "energy": "violated",
    }


@pytest.mark.parametrize("library", ["diffrax", "torchsde"])
def test_a_path_has_the_same_bits_alone_and_in_a_batch(library: str) -> None:
    problem, rng = problems.pendulum(), np.random.default_rng(5)
    y, dW = rng.standard_normal((2, 70)), 0.1 * rng.standard_normal((2, 70))
    scheme = adapter(library).PEER.schemes["heun"]
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
        for name, solver in (
            ("heun", diffrax.Heun()),
            ("midpoint", diffrax.Midpoint()),
            ("reversible-heun", diffrax.ReversibleHeun()),
        ):
            scheme = module.PEER.schemes[name]
            theirs = diffrax.diffeqsolve(terms, solver, 0.0, h, h, y0).ys[0]
            ours = scheme.step(problem, np.asarray(problem.initial), h, dW)
            assert np.allclose(ours, theirs, rtol=0, atol=4e-16), scheme.name
    assert not jax.config.jax_enable_x64


def test_diffrax_compiles_nothing_for_another_polynomial_problem() -> None:
    module = adapter("diffrax")
    before, B = None, [[0, 1, [[[1, 0, 0], 1.0]]]]
    for entry in (1.0, 2.0):
        data = problems.from_json({"dimension": 3, "hamiltonian": [[[2, 0, 1], entry]], "structure": B})
        module.PEER.schemes["heun"].step(problems.build(data), np.ones(3), 0.1, np.array([0.1]))
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
    assert verdicts(adapter("diffrax").PEER.schemes["slow-rk"], "mean-square-order", **FEW) == {
        "mean-square-order": "holds"
    }


def test_torchsde_steps_as_sdeint_with_a_brownian_interval_does() -> None:
    module = adapter("torchsde")
    import torch
    import torchsde

    class Oscillator(torch.nn.Module):
        noise_type, sde_type = "scalar", "stratonovich"

        def f(self, _t: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
            return torch.stack([-y[:, 1], y[:, 0]], dim=1)

        def g(self, t: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
            return self.f(t, y).unsqueeze(-1)

    y, h, dW = np.array([0.2, 0.1]), 0.125, np.array([-0.4])
    W = torchsde.BrownianInterval(0.0, h, W=torch.as_tensor(dW[None]), levy_area_approximation="foster")
    for name, method in (("midpoint", "midpoint"), ("log-ode", "log_ode")):
        run = {"bm": W, "method": method, "dt": h}
        theirs = torchsde.sdeint(Oscillator(), torch.as_tensor(y[None]), [0.0, h], **run)[-1, 0].numpy()
        ours = module.PEER.schemes[name].step(problems.harmonic_oscillator(), y, h, dW)
        assert np.allclose(ours, theirs, rtol=0, atol=1e-16)


def test_torchsdes_milstein_does_not_hold_its_declared_order() -> None:
    with np.errstate(over="ignore"):  # most of its paths leave every bound
        report = measured(adapter("torchsde").PEER.schemes["milstein"], "mean-square-order", **FEW)
    assert report.findings[0].verdict.text in ("violated", "error")
    assert report.exit_code != 0


@pytest.mark.parametrize("library", ["diffrax", "torchsde", "sdeint"])
def test_a_path_goes_on_with_the_state_that_the_solver_carries(library: str) -> None:
    solver, problem, h = list(adapter(library).PEER.schemes.values())[-1], problems.pendulum(), 0.125
    dW = np.sqrt(h) * np.random.default_rng(1).standard_normal((2, 2))
    path = sepv.integrate(solver, problem, h=h, T=2 * h, dW=dW)
    assert np.max(np.abs(path.y[:, 2] - solver.step(problem, path.y[:, 1].copy(), h, dW[1]))) > 1e-10


# The registry


def test_a_package_offers_a_library_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One file and one entry point: the other commands know it by name then."""
    (tmp_path / "stepper.py").write_text(
        "from sepv.peers import Peer\n"
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
    assert "stepper-half" in command("peers").stdout
    assert "energy violated" in command("verify stepper-half --law energy,casimir --examples 2").stdout
    assert "stepper half" in command("compare stepper-half --paths 32 --steps 4,8 --repeats 1").stdout
    assert "did you mean 'stepper-half'" in command("verify stepper-hlaf", 3).stderr


def test_an_entry_point_that_gives_no_peer_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    point = EntryPoint("other", "sepv.problems:PAPER", "sepv.peers")
    monkeypatch.setattr("sepv.peers.peer.metadata.entry_points", lambda **_: [point])
    with pytest.raises(TargetError, match=r"a sepv.peers.Peer at sepv.problems:PAPER"):
        load_scheme("other-heun")


NAMES = ["rigid-body", "pendulum", "lotka-volterra", "harmonic-oscillator"]
ADAPTING = doc("adapting.md")


@given(any_steps())
def test_a_problem_in_another_namespace_is_the_same_problem(case: Case) -> None:
    problem, y, *_ = case.build()
    size = np.abs(problem.structure(y)) @ np.abs(problem.gradient(y)) + np.abs(y).max() + 1
    for padded in (True, False):
        formulas, numbers = pose(problem, padded=padded)
        # Both sum the same few dozen terms, in different orders; cancellation inside B and ∇H is
        # covered by the 1.
        assert np.all(np.abs(formulas.field(np, numbers, y) - vector_field(problem, y)) <= 1e-13 * size)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("lanes", [(), (3,)])
def test_a_named_problem_has_its_parts(name: str, lanes: tuple[int, ...]) -> None:
    problem = sepv.problems.by_name(name)
    start = np.array(problem.initial)
    y = start if not lanes else start[:, None] * np.array([1.0, 1.1, 0.7])
    formulas, numbers = pose(problem)
    close = {"rtol": 1e-14, "atol": 1e-15}
    for part in ("structure", "gradient", "hamiltonian"):
        posed = getattr(formulas, part)(np, numbers, y)
        np.testing.assert_allclose(posed, getattr(problem, part)(y), **close)
    np.testing.assert_allclose(field_in(np, name)(y), vector_field(problem, y), **close)


def test_powers_that_no_monomial_has_do_not_overflow() -> None:
    H = [[[2, 0], 0.5], [[0, 3], 1.0]]
    data = sepv.problems.from_json({"dimension": 2, "hamiltonian": H, "structure": []})
    single = sepv.problems.build(data)
    y = np.float32(np.array([1e15, 1e10]))
    with np.errstate(over="raise"):
        formulas, numbers = pose(single)
        assert formulas.powers > 3, "filled up"
        np.testing.assert_allclose(formulas.gradient(np, numbers, y), [1e15, 3e20], rtol=1e-6)


def test_what_is_not_given_as_data_is_asked_as_data_instead() -> None:
    """A step that needs data skips systems shown as functions:
    the law then shows the same system as data.
    """

    def step(problem: sepv.Problem, y: np.ndarray, h: float, dW: np.ndarray) -> np.ndarray:
        formulas, numbers = pose(problem)
        return np.asarray(y + problem.random_step(h, dW) * formulas.field(np, numbers, y))

    effort = sepv.Effort(examples=5, shrink_checks=30)
    contract, energy = sepv.verify(step, laws=["contract", "energy"], effort=effort).findings
    assert contract.verdict is Verdict.HOLDS
    assert contract.skipped == 0
    assert energy.verdict is Verdict.VIOLATED


@given(any_steps())
def test_a_wide_table_has_the_same_field_and_leaves_the_further_variables(case: Case) -> None:
    problem, y, _, dW = case.build()
    try:
        narrow, numbers = pose(problem)
    except sepv.Skipped:
        return
    wide, more = pose(problem, wide=True)
    seen: list[np.ndarray] = []

    def field(states: np.ndarray, _: np.ndarray) -> np.ndarray:
        seen.append(wide.field(np, more, states))
        return seen[-1]

    found = in_blocks(field, y, dW, 4, wide.width)
    # The table has the same monomials, whose sum may be taken in another order.
    expected = narrow.field(np, numbers, y)
    assert np.allclose(found, expected, rtol=1e-9, atol=1e-12 * (1 + np.abs(expected).max()))
    assert seen[0].shape == (max(wide.width, len(y)), 4)
    assert not seen[0][len(y) :].any()


def test_the_laws_give_a_wide_step_few_shapes() -> None:
    """JAX compiles a step once for each shape: more than 250 times in a whole run of a step without
    blocks.
    """
    shapes = set()

    def step(problem: sepv.Problem, y: np.ndarray, h: float, dW: np.ndarray) -> np.ndarray:
        formulas, numbers = pose(problem, wide=True)

        def block(states: np.ndarray, _: np.ndarray) -> np.ndarray:
            shapes.add((formulas, states.shape, *(a.shape for a in numbers)))
            return states

        in_blocks(block, y, dW, 64, formulas.width)
        return sepv.schemes.midpoint.step(problem, y, h, dW)

    sepv.verify(step, laws="expansion", effort=sepv.Effort(examples=4, shrink_checks=0))
    assert 3 < len(shapes) <= 12


@pytest.mark.parametrize(
    ("double", "remedy"), [(False, "jax_enable_x64"), (True, "torch.as_tensor"), (None, "torch")]
)
def test_single_precision_is_refused_with_the_switch_that_helps(
    double: bool | None, remedy: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """JAX is named where it is loaded and computes in float32;
    then NumPy's arrays are asked for with it.
    """
    jax = None if double is None else SimpleNamespace(config=SimpleNamespace(jax_enable_x64=double))
    monkeypatch.setitem(sys.modules, "jax", jax)
    single = sepv.Scheme("single", lambda p, y, h, dW: y.astype(np.float32))
    own = sepv.Scheme("own", lambda p, y, h, dW: list(y))
    arguments = sepv.problems.pendulum(), np.array([0.2, 1.0]), 0.1, np.zeros(2)
    with pytest.raises(sepv.SchemeFault, match=remedy):
        ask(single, *arguments)
    with pytest.raises(sepv.SchemeFault, match=r"np.asarray") as caught:
        ask(own, *arguments)
    assert ("jax_enable_x64" in str(caught.value)) is (double is False)


def test_numpys_functions_under_a_tracer_end_with_the_way_to_pose_them() -> None:
    class TracerArrayConversionError(TypeError):
        pass

    def step(problem: sepv.Problem, y: np.ndarray, h: float, dW: np.ndarray) -> np.ndarray:
        raise TracerArrayConversionError("called on traced array\nSee https://…")

    with pytest.raises(SchemeCrash, match=r"sepv.posing.pose") as caught:
        ask(sepv.Scheme("traced", step), sepv.problems.pendulum(), np.array([0.2, 1.0]), 0.1, np.zeros(2))
    assert "https" not in str(caught.value)


def program(library: str) -> str:
    """The scheme of docs/adapting.md for this library."""
    if importlib.util.find_spec(library) is None:
        pytest.skip(f"{library} is not installed: the extra `peers`")
    return re.search(rf"^# mine_{library}\.py\n.*?(?=^```$)", ADAPTING, re.MULTILINE | re.DOTALL)[0]


def verified(folder: Path, module: str, laws: str) -> subprocess.CompletedProcess[str]:
    words = ["--examples", "5", "--claim", laws, *(w for law in laws.split(",") for w in ("--law", law))]
    return subprocess.run(
        [sys.executable, "-m", "sepv", "verify", f"{module}:step", *words],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("library", "double", "single", "words", "laws"),
    [
        ("jax", 'jax.config.update("jax_enable_x64", True)', "", "jax_enable_x64", "contract,casimir,symmetry"),
        ("torch", ")).numpy()", ")).float().numpy()", "torch", "contract,noise-sum,expansion"),
    ],
)  # fmt: skip
def test_a_step_of_another_library_goes_from_refused_to_green(library, double, single, words, laws, tmp_path):
    body = program(library)
    (tmp_path / "single.py").write_text(body.replace(double, single))
    (tmp_path / f"mine_{library}.py").write_text(body)
    refused = verified(tmp_path, "single", "contract")
    assert refused.returncode == 1
    assert words in refused.stdout
    green = verified(tmp_path, f"mine_{library}", laws)
    assert green.returncode == 0, green.stdout
    assert "All 3 claimed laws hold" in green.stdout
