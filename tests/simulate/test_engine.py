"""The compiled engine: the NumPy batch to a few ulp, the same bits however the paths are
divided.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from functools import partial

import numpy as np
import pytest
from drawn import EP, both, quartic, same
from hypothesis import given
from hypothesis import strategies as st

import sepv
from benchmarks.units import Scale, scaled
from sepv import problems, schemes
from sepv.core.newton import Status
from sepv.problem import HamiltoniansProblem
from sepv.record import EPS
from sepv.schemes import divided
from sepv.simulate.targets.cuda.devices import compiler

pytest.importorskip("numba", reason="the extra `fast` is not installed")


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
    """Exponential, root and power in H, a domain with two conditions, B of y:
    everything that is recorded.
    """

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


# Scheme, problem, 1/h, steps, and by how much a step and the flow multiply a rounding. Each kernel
# costs two to five seconds of compilation where the cache is cold: most wait for a deep run.
EVERY = [
    ("energy-preserving", "rigid-body", 32, 16, 32), ("energy-preserving", "pendulum", 32, 16, 32),
    ("energy-preserving", "lotka-volterra", 128, 64, 8), ("midpoint", noisy, 16, 8, 32),
    ("milstein", noisy, 16, 8, 32), ("discrete-gradient", noisy, 16, 8, 32),
    ("several-structures", "noncommuting-tops", 32, 8, 64), ("stochastic-midpoint", "random-inertia", 64, 8, 32),
    ("stochastic-midpoint", without_mean_gradient, 64, 8, 32), ("both-invariants", "lotka-volterra", 128, 128, 8),
    # Steps of every kind: most by sweeps, some by a finer rule, some by Newton's iteration, some
    # without solution.
    ("collocation-2", "lotka-volterra", 8, 8, 16), ("projected-8", "rigid-body", 16, 16, 64),
    *((name, "henon-heiles", 16, 32, 64) for name in ("leapfrog", "yoshida-4", "blanes-moan-4")),
    # By functions, which are recorded; means by rule, where NumPy's engine has its quadrature.
    ("energy-preserving", spring, 16, 8, 40), ("energy-preserving", hanging, 128, 32, 8),
    ("energy-preserving", silent, 16, 8, 32),
    # S₃ by recorded derivatives, in the numbers Δ and 3c²h.
    ("modified-weak-2", "pendulum", 16, 16, 32), ("modified-weak-2", "rigid-body", 16, 16, 32),
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
    ("modified-weak-2", "lotka-volterra", 256, 32, 64),
]  # fmt: skip


ROWS = [*EVERY, *(pytest.param(*row, marks=pytest.mark.deep) for row in DEEP)]


# The text of a card's kernel runs on the processor.
NO_COMPILER = pytest.mark.skipif(
    compiler() is None, reason="no C compiler: the text of a card's kernel cannot run here"
)
ENGINES = pytest.mark.parametrize("engine", ["compiled", pytest.param("cuda-on-host", marks=NO_COMPILER)])


@ENGINES
@pytest.mark.parametrize(("name", "problem", "rate", "steps", "spread"), ROWS)
def test_both_engines_agree_to_a_few_ulp(
    name: str, problem, rate: int, steps: int, spread: float, engine: str
) -> None:
    system = problems.by_name(problem) if isinstance(problem, str) else problem()
    paths = 4 if problem is without_mean_gradient else 150  # single lanes, and blocks
    y0 = {} if system.initial is not None else {"y0": (0.6, 0.3)}
    arguments = {"h": 1 / rate, "steps": steps, "paths": paths, "seed": 3} | y0
    fast, plain = both(schemes.by_name(name), system, engine, **arguments)
    assert (fast.engine, plain.engine) == (engine, "numpy")
    assert np.array_equal(fast.W, plain.W)
    assert np.mean(fast.status == plain.status) >= 0.98  # next to a fold a last bit decides
    solved = (fast.status == 0) & (plain.status == 0)
    assert solved.mean() >= 0.8
    assert np.max(np.abs(fast.y - plain.y)[:, solved]) <= spread * steps * EPS * np.max(np.abs(plain.y))
    # Largest of random walks of rounding, in multiples of that of the other engine and of a
    # rounding of H.
    floor = 8 * steps**0.5 * EPS * np.max(np.abs(system.hamiltonian(plain.y)))
    assert fast.energy_defect[solved].max() <= 3 * plain.energy_defect[solved].max() + floor
    assert fast.casimir_defect[solved].max() <= 3 * plain.casimir_defect[solved].max() + 8 * steps**0.5 * EPS
    assert (fast.iterations > 0) == (plain.iterations > 0)


@ENGINES
@pytest.mark.parametrize(
    ("name", "rate"), [("energy-preserving", 8), ("collocation-2", 4), ("projected-4", 4)]
)
def test_both_engines_refuse_the_same_steps(name: str, rate: int, engine: str) -> None:
    """A lane that a kernel leaves over is solved as NumPy's engine solves it,
    with damped steps where full ones fail.

    Beyond the fold Newton's iteration is chaotic: of 9000 paths of this problem in 8 a last bit of
    y decided whether it came upon another solution.
    """
    fast, plain = both(
        schemes.by_name(name), problems.lotka_volterra(), engine, h=1 / rate, T=1.0, paths=100, seed=0
    )
    assert 1 < np.count_nonzero(plain.status) < 100
    assert np.count_nonzero(fast.failed_step != plain.failed_step) <= 1
    assert np.count_nonzero(fast.status != plain.status) <= 1
    assert np.all(np.isfinite(fast.y))


def test_evaluations_of_a_projection_are_counted() -> None:
    """Twelve stages, then B and the gradient at the end, once in a step;
    an average for each iteration.
    """
    ends = sepv.ensemble("projected-8", "rigid-body", h=1 / 16, steps=16, paths=150, engine="compiled")
    assert not ends.status.any()
    assert ends.structure_evaluations == 150 * 16 * 13
    assert ends.gradient_evaluations == 150 * 16 * 13 + ends.iterations


def test_problems_of_other_classes_are_refused_in_words() -> None:
    tops, inertia = problems.noncommuting_tops(), problems.random_inertia()
    for name, problem, words in (
        ("energy-preserving", tops, "takes one"), ("energy-preserving", inertia, "several Hamiltonians"),
        ("midpoint", inertia, "several Hamiltonians"), ("stochastic-midpoint", tops, "not several"),
        ("both-invariants", "pendulum", r"Problem\.nambu"),
    ):  # fmt: skip
        with pytest.raises(sepv.UsageError, match=words):
            sepv.ensemble(name, problem, h=1 / 32, T=1 / 32, paths=9, engine="compiled")


@pytest.mark.parametrize("engine", ["numpy", "compiled"])
def test_roundings_of_the_energy_have_no_sign_where_h_is_in_other_units(engine: str) -> None:
    """Units of 10⁻⁶ in which H″ and the slope of the averaged ∇H differ by a rounding.

    With the last correction of Newton's iteration left out, the mean after 64 steps is 2.4 ulp, 25
    standard errors. Six of them are allowed: a chance of 2e-9.
    """
    problem, paths = scaled(problems.harmonic_oscillator(), Scale(1e-6, 1e6, 1e-6)), 1000
    found = sepv.ensemble(EP, problem, h=0.25, steps=64, paths=paths, engine=engine, seed=5)
    squares = sum(Fraction(float(v)) ** 2 for v in problem.initial)
    off = [float((sum(Fraction(float(v)) ** 2 for v in y) / squares - 1) / Fraction(EPS)) for y in found.y.T]
    assert abs(np.mean(off)) <= 6 * np.std(off) / math.sqrt(paths)


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
    from sepv.faults.saboteurs import SABOTEURS
    from sepv.schemes import energy_preserving
    from sepv.simulate._compiled.schemes import formula_of

    own = formula_of(energy_preserving)
    assert own is not None
    families = schemes.gauss(3), schemes.collocation(2)
    for scheme in (*schemes.PAPER.values(), *schemes.EXTENSIONS.values(), *families):
        taken = scheme.name != "splitting"
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
    values = rng.uniform(-0.4, 0.4, (8, 8)) + 0.001 * np.arange(1, 9) / 7
    quartics = [quartic(row) for row in values.tolist()]
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
    # |Δ| ≤ 1 and |f′| ≤ 1: each step adds a dozen roundings of terms of the size of y and
    # multiplies by e at most.
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
    assert np.array_equal(plain.states, sepv.integrate(EP, problem, h=1 / 16, T=2.0, seed=3).y[:, [16, 32]])
    failed = sepv.long_path(EP, problems.lotka_volterra(), h=1 / 4, T=400.0, seed=0, engine="numpy")
    assert failed.status != Status.CONVERGED
    assert 0 <= failed.failed_step == failed.steps < failed.planned
    drawn = sepv.simulate.increments(0, T=400.0, steps=1600, noises=1, paths=1)[: failed.steps]
    assert (failed.t, failed.W.tolist()) == (failed.steps / 4, np.add.accumulate(drawn)[-1, :, 0].tolist())


def test_a_problem_that_cannot_be_recorded_says_why() -> None:
    def branches(y):
        return np.stack([y[0], STIFFNESS * y[1]]) if np.all(y < 1e9) else y

    for changes, why in (
        ({"hamiltonian": lambda y: branches(y)[0] * y[0] / 2 + STIFFNESS * y[1] ** 2 / 2}, "branches on a value"),
        ({"hamiltonian": lambda y: (y[0] ** 2 + STIFFNESS * y[1] ** 2 + np.spacing(1.0)) / 2}, ""),
        ({"hamiltonian": lambda y: y[0] ** 2 / 2 + np.cosh(y[0] * y[1]), "degree": None,
          "gradient": lambda y: np.stack([y[0] + y[1] * np.sinh(y[0] * y[1]), y[0] * np.sinh(y[0] * y[1])])},
         "no exact mean gradient: H contains cosh of what is not affine"),
    ):  # fmt: skip
        result = sepv.ensemble(EP, spring(**changes), h=0.5, T=1.0, paths=2)
        assert result.engine == ("numpy" if why else "compiled")
        assert why in result.reason


@pytest.mark.parametrize("scheme", [EP, schemes.midpoint])
def test_a_step_on_which_sweeps_do_not_contract_is_begun_anew(scheme: sepv.Scheme) -> None:
    """Steps of the pendulum with |Δ| up to 40: sweeps end anywhere,
    and Newton's iteration from there elsewhere.
    """
    problem = problems.pendulum()
    for scale in (3.0, 10.0):
        dW = scale * np.random.default_rng(5).standard_normal((1, 2, 2000))
        fast, plain = both(scheme, problem, h=0.01, steps=1, dW=dW, truncation=None)
        assert not fast.status.any()
        assert not plain.status.any()
        # Roots are of order one apart; the same root differs by roundings of y and of Δ g, |Δ|
        # ≤ 40, g ≤ 4.
        assert np.max(np.abs(fast.y - plain.y)) < 64 * 2.0**-52 * 160
