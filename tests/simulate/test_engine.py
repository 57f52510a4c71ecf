"""The compiled engine: the NumPy batch to a few ulp, the same bits however the paths are divided."""

import gc
import math
import subprocess
import sys
import weakref
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sepv
from benchmarks.units import Scale, scaled
from sepv import problems, schemes
from sepv.problem import HamiltoniansProblem
from sepv.schemes import divided
from sepv.simulate import _wiener as wiener
from sepv.simulate._compiled.block_run import Chunk
from sepv.simulate._ensembles.task import Task
from sepv.solve import Status

pytest.importorskip("numba", reason="the extra `fast` is not installed")

EP = schemes.energy_preserving
EPS = 2.0**-52


def both(scheme, problem, **arguments):
    """The same ensemble by both engines."""
    return (sepv.ensemble(scheme, problem, engine=engine, **arguments) for engine in ("compiled", "numpy"))


def same(a, b) -> bool:
    keys = ("y", "W", "status", "failed_step", "energy_defect", "casimir_defect", "states")
    return (
        all(np.array_equal(getattr(a, key), getattr(b, key)) for key in keys) and a.iterations == b.iterations
    )


def quartic(values=(0.7, 0.4, 0.3, 0.1, -0.05, 1.0, 0.25, -0.125), noise=(0.5, 0.25)) -> sepv.Problem:
    """A random-looking quartic H in the plane with B(y) of degree one: nodes, derivatives and parameters all matter."""
    a, b, c, e, f, *B = values
    from sepv.problem import PolynomialSystem
    from sepv.record import polynomial

    H = polynomial(2, {(2, 0): a, (0, 2): b, (1, 2): c, (4, 0): e, (2, 2): f})
    entry = polynomial(2, {(0, 0): B[0], (1, 0): B[1], (0, 1): B[2]})
    return problems.polynomial_problem(PolynomialSystem(2, H, ((0, 1, entry),), noise))


STIFFNESS = 0.75


def spring(**changes) -> sepv.Problem:
    """A problem of a user's own, by functions of arrays alone."""
    given = {
        "dimension": 2,
        "structure": problems.harmonic_oscillator().structure,
        "hamiltonian": lambda y: 0.5 * y[0] ** 2 + 0.5 * STIFFNESS * y[1] ** 2,
        "gradient": lambda y: np.stack([y[0], STIFFNESS * y[1]]),
        "degree": 2,
        "initial": (0.2, 0.1),
        "name": "spring",
    }
    return sepv.Problem(**given | changes)


def hanging() -> sepv.Problem:
    """Exponential, root and power in H, a domain with two conditions, B of y: everything that is recorded."""

    def structure(y):
        B = np.zeros((2, 2, *y.shape[1:]), dtype=y.dtype)
        B[0, 1] = y[0] * (2 + np.sin(y[1]))
        B[1, 0] = -B[0, 1]
        return B

    return sepv.Problem(
        dimension=2,
        structure=structure,
        hamiltonian=lambda y: np.exp(y[0] - y[1]) + np.sqrt(y[0]) + y[0] ** 1.5 - np.cos(2 * y[1]) + 1 / (1 + y[0]),
        gradient=lambda y: np.stack([
            np.exp(y[0] - y[1]) + 0.5 / np.sqrt(y[0]) + 1.5 * np.sqrt(y[0]) - 1 / (1 + y[0]) ** 2,
            -np.exp(y[0] - y[1]) + 2 * np.sin(2 * y[1]),
        ]),
        domain=lambda y: (y[0] > 0) & (np.abs(y[1]) < 50),
        initial=(1.0, 0.3),
        noise=0.2,
    )  # fmt: skip


def without_mean_gradient() -> HamiltoniansProblem:
    """A pair of which the mean gradient has no closed form."""
    return HamiltoniansProblem(
        2, problems.pendulum().structure, lambda y: np.log(1 + y[0] ** 2 + y[1] ** 2), noise=(0.5,),
        noise_hamiltonians=(lambda y: y[0] * y[1],), initial=(0.5, 0.25), name="no mean gradient",
    )  # fmt: skip


def stiff() -> sepv.Problem:
    """H is 100 times |y|²/2: a turn by an angle of 100Δ multiplies the rounding of Δ as much."""
    fast = problems.from_json(
        {"dimension": 2, "hamiltonian": [[[2, 0], 50.0], [[0, 2], 50.0]], "structure": [[0, 1, [[[0, 0], 1.0]]]]}
    )  # fmt: skip
    return replace(problems.polynomial_problem(fast), noise=(0.5,), initial=(0.6, 0.3), check=False)


def noisy() -> sepv.Problem:
    return problems.harmonic_oscillator(noise=(0.5, 1.0))


def silent() -> sepv.Problem:
    return problems.rigid_body(noise=())


def started(name: str, y0: tuple[float, ...]) -> Callable[[], sepv.Problem]:
    return lambda: replace(problems.by_name(name), initial=y0, check=False)


# Scheme, problem, 1/h, steps, and by how much a step and the flow multiply a rounding. Each kernel costs two to five
# seconds of compilation where the cache is cold: most wait for a deep run.
EVERY = [
    ("energy-preserving", "rigid-body", 32, 16, 32), ("energy-preserving", "pendulum", 32, 16, 32),
    ("energy-preserving", "lotka-volterra", 128, 64, 8), ("midpoint", noisy, 16, 8, 32),
    ("milstein", noisy, 16, 8, 32), ("discrete-gradient", noisy, 16, 8, 32),
    ("several-structures", "noncommuting-tops", 32, 8, 64), ("stochastic-midpoint", "random-inertia", 64, 8, 32),
    ("stochastic-midpoint", without_mean_gradient, 64, 8, 32), ("both-invariants", "lotka-volterra", 128, 128, 8),
    # Steps of every kind: most by sweeps, some by a finer rule, some by Newton's iteration, some without solution.
    ("collocation-2", "lotka-volterra", 8, 8, 16), ("projected-8", "rigid-body", 16, 16, 64),
    # By functions, which are recorded; means by rule, where NumPy's engine has its quadrature.
    ("energy-preserving", spring, 16, 8, 40), ("energy-preserving", hanging, 128, 32, 8),
    ("energy-preserving", silent, 16, 8, 32),
]  # fmt: skip
DEEP = [
    *((name, noisy, 16, 8, 32) for name in (
        "euler-heun", "euler-maruyama", "explicit-4", "explicit-8", "collocation-2", "collocation-3", "gauss-2",
        "gonzalez", "itoh-abe", "several-structures")),
    ("milstein", "lotka-volterra", 8, 16, 64), ("milstein", spring, 16, 8, 40),
    ("both-invariants", "rigid-body", 128, 128, 8), ("energy-preserving", quartic, 16, 16, 32),
    ("collocation-4", "lotka-volterra", 32, 32, 16), ("collocation-4", "pendulum", 8, 8, 16),
    # Two rules agree no better than one rounding of the angle lets them.
    ("collocation-2", started("pendulum", (0.5, 1e8)), 8, 8, 16), ("collocation-2", stiff, 8, 8, 200),
    ("projected-8", "pendulum", 16, 16, 64), ("projected-8", "lotka-volterra", 16, 16, 64),
]  # fmt: skip


ROWS = [*EVERY, *(pytest.param(*row, marks=pytest.mark.deep) for row in DEEP)]


@pytest.mark.parametrize(("name", "problem", "rate", "steps", "spread"), ROWS)
def test_both_engines_agree_to_a_few_ulp(name: str, problem, rate: int, steps: int, spread: float) -> None:
    system = problems.by_name(problem) if isinstance(problem, str) else problem()
    paths = 4 if problem is without_mean_gradient else 150  # single lanes, and blocks
    y0 = {} if system.initial is not None else {"y0": (0.6, 0.3)}
    fast, plain = both(schemes.by_name(name), system, h=1 / rate, steps=steps, paths=paths, seed=3, **y0)
    assert (fast.engine, plain.engine) == ("compiled", "numpy")
    assert np.array_equal(fast.W, plain.W)
    assert np.mean(fast.status == plain.status) >= 0.98  # next to a fold a last bit decides
    solved = (fast.status == 0) & (plain.status == 0)
    assert solved.mean() >= 0.8
    assert np.max(np.abs(fast.y - plain.y)[:, solved]) <= spread * steps * EPS * np.max(np.abs(plain.y))
    # Largest of random walks of rounding, in multiples of that of the other engine and of a rounding of H.
    floor = 8 * steps**0.5 * EPS * np.max(np.abs(system.hamiltonian(plain.y)))
    assert fast.energy_defect[solved].max() <= 3 * plain.energy_defect[solved].max() + floor
    assert fast.casimir_defect[solved].max() <= 3 * plain.casimir_defect[solved].max() + 8 * steps**0.5 * EPS
    assert (fast.iterations > 0) == (plain.iterations > 0)


@pytest.mark.parametrize(
    ("name", "rate"), [("energy-preserving", 8), ("collocation-2", 4), ("projected-4", 4)]
)
def test_both_engines_refuse_the_same_steps(name: str, rate: int) -> None:
    """A lane that a kernel leaves over is solved as NumPy's engine solves it, with damped steps where full ones fail.

    Beyond the fold Newton's iteration is chaotic: of 9000 paths of this problem in 8 a last bit of y decided whether it
    came upon another solution.
    """
    fast, plain = both(schemes.by_name(name), problems.lotka_volterra(), h=1 / rate, T=1.0, paths=100, seed=0)
    assert 1 < np.count_nonzero(plain.status) < 100
    assert np.count_nonzero(fast.failed_step != plain.failed_step) <= 1
    assert np.count_nonzero(fast.status != plain.status) <= 1
    assert np.all(np.isfinite(fast.y))


def test_evaluations_of_a_projection_are_counted() -> None:
    """Twelve stages and the gradient at the end once in a step, an average for each iteration of the projection."""
    ends = sepv.ensemble("projected-8", "rigid-body", h=1 / 16, steps=16, paths=150, engine="compiled")
    assert not ends.status.any()
    assert ends.structure_evaluations == 150 * 16 * 12
    assert ends.gradient_evaluations == 150 * 16 * 13 + ends.iterations


def test_problems_of_other_classes_are_refused_in_words() -> None:
    tops, inertia = problems.noncommuting_tops(), problems.random_inertia()
    for name, problem, words in (
        ("energy-preserving", tops, "takes one"), ("energy-preserving", inertia, "several Hamiltonians"),
        ("midpoint", inertia, "several Hamiltonians"), ("both-invariants", "pendulum", r"Problem\.nambu"),
    ):  # fmt: skip
        with pytest.raises(sepv.UsageError, match=words):
            sepv.ensemble(name, problem, h=1 / 32, T=1 / 32, paths=9, engine="compiled")


def test_any_constant_that_reaches_compiled_code_changes_its_name(monkeypatch) -> None:
    from sepv.simulate._compiled import store

    text = Path(store.__file__).with_name("lanes.py").read_text(encoding="utf-8")
    name, changed = store.name_of(text), set()
    for module in store.linked(text):
        for key, value in list(vars(module).items()):
            if key[:2] != "__" and type(value) in (int, float, bool, np.int64, np.ndarray):
                other = value + np.ones_like(value) if isinstance(value, np.ndarray) else value + 1
                with monkeypatch.context() as patch:
                    patch.setattr(module, key, other)
                    assert store.name_of(text) != name, (module.__name__, key)
                changed.add(key)
    assert {"MIXING", "STREAMS", "_PART_1", "LANES"} <= changed
    assert store.name_of(text) == name
    for place, value in (
        ("numba.__version__", "0"), ("llvmlite.__version__", "0"),
        ("llvmlite.binding.get_host_cpu_name", lambda: "another"),
    ):  # fmt: skip
        with monkeypatch.context() as patch:
            patch.setattr(place, value)
            store._machine.cache_clear()
            assert store.name_of(text) != name
    store._machine.cache_clear()


def test_a_constant_that_changes_reaches_compiled_code(tmp_path, monkeypatch) -> None:
    from sepv.simulate._compiled import store

    monkeypatch.setenv("SEPV_CACHE_DIR", str(tmp_path))
    text = (
        "from numba import njit\nfrom sepv.simulate._wiener import MIXING\n\n\n"
        "@njit('int64()', cache=True)\ndef rounds():\n    return MIXING\n"
    )
    for more in (0, 6):
        monkeypatch.setattr(wiener, "MIXING", wiener.MIXING + more)
        assert store.load.__wrapped__(text).rounds() == wiener.MIXING


def backwards(function, tasks):
    return [function(task) for task in reversed(tasks)]


def test_workers_are_any_map_and_the_bits_stay() -> None:
    problem, arguments = problems.rigid_body(), {"h": 1 / 64, "T": 1.0, "paths": 2100, "chunk": 1024}
    here = sepv.ensemble(EP, problem, **arguments)
    with ThreadPoolExecutor(2) as threads, ProcessPoolExecutor(2) as processes:
        for workers in (map, backwards, threads.map, processes.map):
            there = sepv.ensemble(EP, problem, workers=workers, **arguments)
            assert there.repeated == 0
            assert same(here, there)


@dataclass
class Step:
    """Equality without a hash, as dataclasses have it."""

    share: float

    def __call__(self, problem, y, h, dW):
        return y + self.share * h * problem.structure(y) @ problem.gradient(y)


def test_what_cannot_be_compiled_is_said() -> None:
    own, run = sepv.Scheme("energy-preserving", Step(1.0)), {"h": 0.5, "T": 1.0, "paths": 2}
    result = sepv.ensemble(own, problems.rigid_body(), **run)
    assert result.engine == "numpy"
    assert "no code for the scheme" in result.reason
    with pytest.raises(sepv.UsageError, match="no code for the scheme"):
        sepv.ensemble(own, problems.rigid_body(), engine="compiled", **run)
    undefined = sepv.ensemble(schemes.several_structures, problems.commuting_oscillators(), **run)
    assert "undefined at critical points" in undefined.reason  # S_j of several Hamiltonians is none there


def test_bits_depend_neither_on_threads_nor_on_chunks() -> None:
    problem, arguments = problems.rigid_body(), {"h": 1 / 64, "T": 1.0, "seed": 2, "engine": "compiled"}
    one = sepv.ensemble(EP, problem, paths=1500, times=[0.25, 1.0], **arguments)
    two = sepv.ensemble(EP, problem, paths=1500, times=[0.25, 1.0], workers=2, **arguments)
    assert same(one, two)
    few = sepv.ensemble(EP, problem, paths=3, **arguments)  # path by path
    assert np.array_equal(few.y, one.y[:, :3])
    assert np.array_equal(one.states[1], one.y)


def test_given_increments_are_the_drawn_ones() -> None:
    problem = problems.rigid_body()
    drawn = sepv.ensemble(EP, problem, h=1 / 64, T=1.0, paths=100, seed=5, engine="compiled")
    dW = wiener.increments(5, T=1.0, steps=64, noises=1, paths=100)
    given = sepv.ensemble(EP, problem, h=1 / 64, T=1.0, dW=dW, engine="compiled")
    assert same(drawn, given)


def test_what_is_raised_while_a_lane_is_solved_is_raised_when_the_compiled_loop_is_back(monkeypatch) -> None:
    from sepv.solve import _newton

    arguments = {"h": 0.1, "steps": 40, "engine": "compiled", "truncation": None, "seed": 2}
    whole = sepv.long_path(EP, "lotka-volterra", **arguments)
    assert whole.failed_step > 0
    approach, asked = _newton.approach, []

    def interrupted(*given):
        asked.append(given)
        if len(asked) == 1:
            raise KeyboardInterrupt
        return approach(*given)

    monkeypatch.setattr(_newton, "approach", interrupted)
    path = sepv.long_path(EP, "lotka-volterra", **arguments)
    assert path.interrupted
    assert len(asked) > 1
    # The step was made all the same, so that the path is at the end of a piece.
    assert (path.failed_step, path.status, path.t) == (whole.failed_step, whole.status, whole.t)
    assert np.array_equal(path.y, whole.y)
    asked.clear()
    with pytest.raises(sepv.errors.Interrupted):
        sepv.ensemble(EP, "lotka-volterra", paths=20, **arguments)

    def broken(*given):
        raise ArithmeticError("no such thing")

    monkeypatch.setattr(_newton, "approach", broken)
    with pytest.raises(sepv.errors.ChunkFailure, match="no such thing"):
        sepv.ensemble(EP, "lotka-volterra", paths=20, **arguments)


def test_what_a_broken_worker_did_not_finish_is_computed_here() -> None:
    problem, arguments = problems.rigid_body(), {"h": 1 / 64, "T": 1.0, "paths": 2100, "chunk": 1024}
    here = sepv.ensemble(EP, problem, **arguments)

    def second_fails(function, tasks):
        for number, task in enumerate(tasks):
            yield function(task) if number != 1 else (False, "broken")

    def stops(function, tasks):
        yield function(tasks[0])
        raise ConnectionError("the cluster is gone")

    for workers, repeated in ((second_fails, 1), (stops, 2)):
        result = sepv.ensemble(EP, problem, workers=workers, **arguments)
        assert result.repeated == repeated
        assert same(here, result)


@pytest.mark.parametrize("engine", ["numpy", "compiled"])
def test_roundings_of_the_energy_have_no_sign_where_h_is_in_other_units(engine: str) -> None:
    """Units of 10⁻⁶ in which H″ and the slope of the averaged ∇H differ by a rounding.

    With the last correction of Newton's iteration left out, the mean after 64 steps is 2.4 ulp, 25 standard errors.
    Six of them are allowed: a chance of 2e-9.
    """
    problem, paths = scaled(problems.harmonic_oscillator(), Scale(1e-6, 1e6, 1e-6)), 1000
    found = sepv.ensemble(EP, problem, h=0.25, steps=64, paths=paths, engine=engine, seed=5)
    squares = sum(Fraction(float(v)) ** 2 for v in problem.initial)
    defects = [
        float((sum(Fraction(float(v)) ** 2 for v in y) / squares - 1) / Fraction(EPS)) for y in found.y.T
    ]
    assert abs(np.mean(defects)) <= 6 * np.std(defects) / math.sqrt(paths)


def test_compensated_summation_keeps_the_energy_better() -> None:
    problem = problems.rigid_body()
    arguments = {"h": 0.01, "steps": 4000, "paths": 64, "seed": 1}
    plain = sepv.ensemble(EP, problem, engine="compiled", **arguments)
    kept = sepv.ensemble(EP, problem, engine="compiled", compensated=True, **arguments)
    assert np.sqrt(np.mean(kept.energy_defect**2)) < 0.25 * np.sqrt(np.mean(plain.energy_defect**2))
    assert math.isfinite(kept.energy_defect.max())


# Distinct, and none that is written into the code: all examples share one kernel.
@st.composite
def coefficients(draw: st.DrawFn, count: int, low: float, high: float) -> list[float]:
    drawn = [draw(st.floats(low, high, allow_subnormal=False)) for _ in range(count)]
    return [v + 0.001 * (i + 1) / 7 for i, v in enumerate(drawn)]


def test_the_engine_takes_the_formula_of_any_scheme_and_nothing_that_is_around_one() -> None:
    from sepv.reference.faults.saboteurs import SABOTEURS

    from sepv.schemes import energy_preserving
    from sepv.simulate._compiled.schemes import formula_of

    own = formula_of(energy_preserving)
    assert own is not None
    for scheme in (
        *schemes.PAPER.values(),
        *schemes.EXTENSIONS.values(),
        schemes.gauss(3),
        schemes.collocation(2),
    ):
        taken = scheme.name not in ("splitting", "modified-weak-2")
        assert (formula_of(scheme) is not None) == taken, scheme.name
    assert formula_of(replace(EP, name="another")) == own
    broken = formula_of(SABOTEURS["b-at-y0"].scheme)
    assert broken is not None
    assert broken.recorded is not own.recorded
    around = partial(EP.step)
    for scheme in (divided(EP), replace(EP, step=around), replace(EP, solve=partial(EP.solve))):
        assert formula_of(scheme) is None
    assert formula_of(replace(schemes.projected(4), solve=around)) is None


def test_systems_that_differ_in_coefficients_share_one_kernel() -> None:
    """Of either sign: a kernel takes seconds to compile."""
    from sepv.simulate._compiled.compile import _written, code_of
    from sepv.simulate._compiled.schemes import formula_of

    rng, formula = np.random.default_rng(0), formula_of(EP)
    quartics = [
        quartic([v + 0.001 * (i + 1) / 7 for i, v in enumerate(rng.uniform(-0.4, 0.4, 8))]) for _ in range(8)
    ]
    bodies = [problems.rigid_body(inertia=rng.uniform(0.4, 2.0, 3)) for _ in range(4)]
    for family in (quartics, bodies):
        assert len({_written(code_of(p), formula, 1, 128, False)[0] for p in family}) == 1


@given(data=st.data())
def test_engines_agree_and_bits_depend_on_nothing_but_the_path(data: st.DataObject) -> None:
    seed, c = data.draw(st.integers(0, 2**32 - 1)), data.draw(st.floats(0.0, 0.5))
    if data.draw(st.booleans()):
        problem = problems.rigid_body(inertia=data.draw(coefficients(3, 0.4, 2.0)), noise=c)
        y0 = np.array(data.draw(coefficients(3, -1.0, 1.0)))
    else:
        problem = quartic(data.draw(coefficients(8, -0.4, 0.4)), (c, 0.25))
        y0 = np.array(data.draw(coefficients(2, -0.8, 0.8)))
    steps, paths = data.draw(st.integers(1, 6)), data.draw(st.integers(9, 90))
    arguments: dict = {"h": 1 / 32, "steps": steps, "seed": seed, "y0": y0}
    fast, plain = both(EP, problem, paths=paths, **arguments)
    assert fast.engine == "compiled"
    assert np.array_equal(fast.W, plain.W)
    assert np.array_equal(fast.status, plain.status)
    # |Δ| ≤ 1 and |f′| ≤ 1: each step adds a dozen roundings of terms of the size of y and multiplies by e at most.
    size = np.max(np.abs(plain.y)) + np.max(np.abs(y0))
    assert np.max(np.abs(fast.y - plain.y)) <= 12 * np.e**2 * steps * 2.3e-16 * size
    threads = sepv.ensemble(EP, problem, paths=paths, workers=3, engine="compiled", **arguments)
    assert same(fast, threads)
    few = sepv.ensemble(EP, problem, paths=data.draw(st.integers(1, 8)), engine="compiled", **arguments)
    assert np.array_equal(few.y, fast.y[:, : few.y.shape[1]])
    assert np.array_equal(few.energy_defect, fast.energy_defect[: few.y.shape[1]])


def test_a_long_path_is_path_number_p_of_the_ensemble_and_can_be_interrupted() -> None:
    problem, arguments = problems.rigid_body(), {"h": 0.01, "steps": 6000, "seed": 8}
    whole = sepv.long_path(EP, problem, path=2, every=1000, **arguments)
    assert (whole.steps, whole.interrupted, whole.engine) == (6000, False, "compiled")
    assert whole.times.tolist() == [10.0, 20.0, 30.0, 40.0, 50.0, 60.0]
    many = sepv.ensemble(EP, problem, paths=3, **arguments)
    assert np.array_equal(whole.y, many.y[:, 2])
    assert np.array_equal(whole.states[:, -1], whole.y)

    def stop(done: int, planned: int) -> None:
        if done >= 3000:
            raise KeyboardInterrupt

    part = sepv.long_path(EP, problem, path=2, every=1000, progress=stop, **arguments)
    assert (part.steps, part.interrupted) == (3000, True)
    assert np.array_equal(part.states, whole.states[:, :3])
    rest = sepv.long_path(EP, problem, path=2, every=1000, resume=part, **arguments)
    assert np.array_equal(rest.y, whole.y)
    assert np.array_equal(rest.states, whole.states)
    assert rest.energy_defect == whole.energy_defect
    with pytest.raises(sepv.UsageError, match="same arguments"):
        sepv.long_path(EP, problem, path=1, resume=part, **arguments)


def test_a_long_path_runs_without_the_compiled_engine_and_stops_at_a_failure() -> None:
    problem = problems.rigid_body()
    plain = sepv.long_path(EP, problem, h=1 / 16, T=2.0, seed=3, every=16, engine="numpy")
    one = sepv.integrate(EP, problem, h=1 / 16, T=2.0, seed=3)
    assert np.array_equal(plain.states, one.y[:, [16, 32]])
    failed = sepv.long_path(EP, problems.lotka_volterra(), h=1 / 4, T=400.0, seed=0, engine="numpy")
    assert failed.status != Status.CONVERGED
    assert 0 <= failed.failed_step == failed.steps < failed.planned
    assert failed.t == failed.steps / 4


def test_a_problem_that_cannot_be_recorded_says_why() -> None:
    def branches(y):
        return np.stack([y[0], STIFFNESS * y[1]]) if np.all(y < 1e9) else y

    for changes, why in (
        (
            {"hamiltonian": lambda y: branches(y)[0] * y[0] / 2 + STIFFNESS * y[1] ** 2 / 2},
            "branches on a value",
        ),
        ({"hamiltonian": lambda y: (y[0] ** 2 + STIFFNESS * y[1] ** 2 + np.spacing(1.0)) / 2}, ""),
        (
            {
                "hamiltonian": lambda y: y[0] ** 2 / 2 + np.cosh(y[0] * y[1]),
                "gradient": lambda y: np.stack(
                    [y[0] + y[1] * np.sinh(y[0] * y[1]), y[0] * np.sinh(y[0] * y[1])]
                ),
                "degree": None,
            },
            "no exact mean gradient: H contains cosh of what is not affine",
        ),
    ):
        result = sepv.ensemble(EP, spring(**changes), h=0.5, T=1.0, paths=2)
        assert result.engine == ("numpy" if why else "compiled")
        assert why in result.reason


def test_more_paths_than_memory_holds_and_what_is_not_finite_are_refused_at_once() -> None:
    problem = problems.rigid_body()
    with pytest.raises(sepv.UsageError, match="paths whose ends fit into memory"):
        sepv.ensemble(EP, problem, h=0.1, T=1.0, paths=10**15)
    dW = np.zeros((10, 1, 3))
    dW[4, 0, 2] = np.nan
    with pytest.raises(sepv.UsageError, match=r"dW\[4, 0, 2\] = nan"):
        sepv.ensemble(EP, problem, h=0.1, T=1.0, dW=dW)


def test_compiled_code_that_was_cut_off_is_compiled_again(tmp_path, monkeypatch) -> None:
    from sepv.simulate._compiled import store

    monkeypatch.setenv("SEPV_CACHE_DIR", str(tmp_path))
    text = (
        "from numba import njit\n\n\n@njit('float64(float64)', cache=True)\ndef twice(x):\n    return 2 * x\n"
    )
    store.load.__wrapped__(text)
    (compiled,) = tmp_path.glob("engine/__pycache__/*.nbc")
    compiled.write_bytes(compiled.read_bytes()[:50])
    assert store.load.__wrapped__(text).twice(1.5) == 3.0


@pytest.mark.parametrize("scheme", [EP, schemes.midpoint])
def test_a_step_on_which_sweeps_do_not_contract_is_begun_anew(scheme: sepv.Scheme) -> None:
    """Steps of the pendulum with |Δ| up to 40: sweeps end anywhere, and Newton's iteration from there elsewhere."""
    problem = problems.pendulum()
    for scale in (3.0, 10.0):
        dW = scale * np.random.default_rng(5).standard_normal((1, 2, 2000))
        fast, plain = both(scheme, problem, h=0.01, steps=1, dW=dW, truncation=None)
        assert not fast.status.any()
        assert not plain.status.any()
        # Roots are of order one apart; the same root differs by roundings of y and of Δ g, |Δ| ≤ 40, g ≤ 4.
        assert np.max(np.abs(fast.y - plain.y)) < 64 * 2.0**-52 * 160


def test_the_first_ensemble_leaves_the_import_of_blas_to_code_that_calls_it() -> None:
    code = """if True:
        import sys, numpy as np, sepv
        problem = sepv.problems.rigid_body()
        sepv.ensemble(sepv.schemes.energy_preserving, problem, h=0.01, steps=1, paths=1, engine="compiled")
        assert "scipy.linalg" not in sys.modules
        from numba import njit
        A = np.eye(3) + 1.0
        assert (njit(lambda A, b: A @ b)(A, A[0]) == A @ A[0]).all()
        assert "scipy.linalg" in sys.modules
    """
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_chunk_is_gone_when_nobody_has_it() -> None:
    """Its arrays are some megabytes, which would otherwise wait for the garbage collector."""
    problem = problems.rigid_body()
    task = Task(EP, problem, np.array(problem.initial), 0.01, 4, 0, 200, 0, None, 2, (), False, True, None)
    chunk = Chunk(task, problem)
    chunk.advance(4)
    known = weakref.ref(chunk)
    gc.disable()
    try:
        del chunk
        assert known() is None
    finally:
        gc.enable()


def test_the_fingerprint_tells_schemes_problems_starts_and_steps_apart() -> None:
    body, other = problems.rigid_body(), problems.rigid_body(inertia=(1.0, 2.0, 4.0))
    asked = {
        "as it is": (EP, body, 0.01, None), "scheme": (schemes.by_name("gauss-2"), body, 0.01, None),
        "problem": (EP, other, 0.01, None), "h": (EP, body, 0.02, None), "y0": (EP, body, 0.01, [0.6, 0.8, 0.0]),
    }  # fmt: skip

    def fingerprint(key: str, engine: str) -> str:
        scheme, problem, h, y0 = asked[key]
        return sepv.ensemble(scheme, problem, h=h, steps=2, paths=20, y0=y0, engine=engine).about[
            "fingerprint"
        ]

    found = {key: fingerprint(key, "compiled") for key in asked}
    assert len(set(found.values())) == len(asked)
    # The second time it is kept, and in NumPy made anew.
    assert found == {key: fingerprint(key, "compiled") for key in asked}
    assert found == {key: fingerprint(key, "numpy") for key in asked}
