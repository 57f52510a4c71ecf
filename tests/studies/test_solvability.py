"""Solvability by folds and simulation, paths that leave a set,
and energy over long times by three derivations.
"""

import math
from math import pi, sin, sqrt
from pathlib import Path

import numpy as np
import pytest
from doors import command, written
from sepv.properties._growth import exponent, kind_of
from sepv.properties._orders.gaussian import rule

import sepv
from benchmarks.exits import COMPACT_SETS, bound, measured, moments
from sepv import UsageError, problems, schemes
from sepv.problem import Array
from sepv.simulate import _truncation as bounded
from sepv.studies._energy_diffusion import energy_diffusion
from sepv.studies._energy_growth import SLOPE_DOUBLINGS, growth, judged
from sepv.studies._solvability.branch import End, follow
from sepv.studies._solvability.map import Ending, chance_outside, solvability_map
from sepv.studies._solvability.paths import Exits, follow_paths

# H = q²p: the equation of q alone is Δq1² + (Δ − 3)q1 + Δ + 3 = 0 from q0 = 1, with the
# discriminant 9 − 18Δ − 3Δ²: a fold at Δ = 2√3 − 3. Backwards p1 has a pole where q1 = 0, at
# Δ = −3.
FOLDED = problems.build(
    problems.from_json({"dimension": 2, "hamiltonian": [[[1, 2], 1]], "structure": [[0, 1, [[[0, 0], -1]]]]})
)
START = np.array([[1.0, -0.5], [1.0, 1.0]])


def test_a_fold_is_found_where_the_discriminant_vanishes() -> None:
    branch = follow(FOLDED, START, 1.0)
    assert branch.end.tolist() == [End.FOLD, End.FOLD]
    assert branch.reach == pytest.approx(2 * math.sqrt(3) - 3, rel=1e-9)


def test_a_pole_is_an_escape_to_infinity() -> None:
    branch = follow(FOLDED, START, -10.0)
    assert branch.end.tolist() == [End.INFINITY, End.INFINITY]
    assert branch.reach == pytest.approx(3.0, rel=0.01)


def test_bounded_levels_have_solutions_as_far_as_asked() -> None:
    """|y1| = |y0| for the rigid body; p is bounded and q moves by at most |Δ| |p| for the
    pendulum.
    """
    for name, furthest in (("rigid-body", 5.0), ("pendulum", 4.0)):
        problem = problems.by_name(name)
        y = np.repeat(np.asarray(problem.initial)[:, None], 2, axis=1)
        for sign in (1, -1):
            assert follow(problem, y, sign * furthest).end.tolist() == [End.RANGE, End.RANGE]


def test_the_map_agrees_with_the_fold_of_lotka_volterra() -> None:
    """Steps of |Δ| up to about 0.26 were solved from every state that was tried,
    beyond not from all of them.
    """
    found = solvability_map(problems.lotka_volterra(), furthest=1.0, states=24, grid=4, time=3.0)
    low, high = found.safe
    assert 0.26 < high < 0.29
    assert -0.6 < low < -0.4
    inside = (found.delta > low) & (found.delta < high)
    assert (found.findings[inside] == Ending.FOUND).all()
    assert sum(found.counts().values()) == found.findings.size == 8 * 24
    assert found.counts()[Ending.NONE] > 0
    assert found.counts()[Ending.UNKNOWN] == 0
    p = [found.chances(2.0**-n, 2).mean() for n in (3, 4, 5, 7)]
    assert p[0] > p[1] > p[2] > 0 == p[3]


def test_the_shortest_branches_do_not_hang_on_the_number_of_states() -> None:
    """Of 12 states none is nearer to a fold than 0.273; between them there are some at 0.267462."""
    few = solvability_map(problems.lotka_volterra(), states=12, grid=2)
    assert few.forward.reach.min() > 0.27
    assert few.safe == pytest.approx((-0.425082, 0.267462), rel=1e-4)
    assert few.chances(2.0**-6, 2).max() == 0 < few.worst(2.0**-6, 2)
    # Where every branch goes on, there is nothing to refine.
    assert not solvability_map(problems.rigid_body(), states=4, grid=2).refined.theta.size


def test_paths_leave_the_orbit_and_come_to_steps_that_are_refused() -> None:
    """Lotka-Volterra, h = 2⁻⁷, at which no step from the orbit fails: (2.1)
    loses the Casimir and all paths.
    """
    pytest.importorskip("numba")
    problem, h = problems.lotka_volterra(), 2.0**-7
    arguments = {"until": 384.0, "paths": 16, "seconds": math.inf}
    said: list[str] = []
    (lost,) = follow_paths(problem, schemes.energy_preserving, [h], progress=said.append, **arguments)
    (kept,) = follow_paths(problem, schemes.both_invariants, [h], **arguments)
    assert solvability_map(problem, states=24, grid=2, time=3.0).worst(h, 2) == 0
    assert lost.failed == 16
    # The first of 48 failed at 110, half of them by 160.
    assert 60 < lost.first < lost.median < 384
    assert lost.share == 1
    assert "to t = 2" in said[0]
    assert (kept.failed, kept.until, kept.first, kept.median) == (0, 384.0, None, None)
    assert not kept.cut_short


def test_paths_are_followed_no_longer_than_the_seconds_allow() -> None:
    how = {"until": 1e6, "paths": 4, "seconds": 0.0}
    (cut,) = follow_paths(problems.rigid_body(), schemes.energy_preserving, [0.125], **how)
    assert cut.cut_short
    assert cut.until == 256 * 0.125
    assert cut.asked == 1e6
    # Nobody failed: 0.95 = 1 − (1 − p)⁴.
    assert cut.share == pytest.approx(1 - 0.05**0.25)


def test_exits_are_counted() -> None:
    some = Exits("any", 0.5, 8.0, 5, np.array([1.0, 2.5, 4.0]), {"LEFT_DOMAIN": 3}, 8.0)
    assert (some.failed, some.first, some.median) == (3, 1.0, 4.0)
    # P(at most 3 of 5 fail) = 5 % at p = 0.9236.
    p = some.share
    assert math.fsum(math.comb(5, j) * p**j * (1 - p) ** (5 - j) for j in range(4)) == pytest.approx(0.05)


@pytest.mark.parametrize(("noise", "k"), [((0.5,), 2), ((0.5,), None), ((0.4, 0.3), 1), ((0.4, 0.3), None)])
def test_chances_are_those_of_simulated_steps(noise: tuple[float, ...], k: int | None) -> None:
    h, low, high = 2.0**-3, np.array([-0.2, -0.05]), np.array([0.3, 0.45])
    rng = np.random.default_rng(2)
    dW = bounded.truncate(math.sqrt(h) * rng.standard_normal((len(noise), 400_000)), h, k)
    delta = h + np.array(noise) @ dW
    for i in range(2):
        chance = float(chance_outside(h, noise, low[i : i + 1], high[i : i + 1], k)[0])
        seen = float(np.mean((delta <= low[i]) | (delta >= high[i])))
        # Six standard errors: 2e-9 of false alarm for each of the eight comparisons.
        assert abs(seen - chance) < 6 * math.sqrt(chance / delta.size)


def test_truncation_makes_far_steps_impossible() -> None:
    h = 2.0**-8
    reach = h + 0.5 * math.sqrt(h) * bounded.truncation_bound(h, 2)
    inside, outside = (np.array([factor * reach]) for factor in (0.999, 1.001))
    low = np.array([-10.0])
    assert chance_outside(h, [0.5], low, outside, 2)[0] == 0
    assert chance_outside(h, [0.5], low, inside, 2)[0] > 0
    assert chance_outside(h, [0.5], low, outside, None)[0] > 0
    assert chance_outside(h, [], low, outside, 2)[0] == 0
    assert chance_outside(0.5, [], low, np.array([0.4]), 2)[0] == 1


def test_the_command_prints_numbers_and_writes_json(tmp_path) -> None:
    line = "solvability lotka-volterra --range 0.5 --states 6 --grid 4 --time 2 --until 1 --paths 4"
    wrong = ({"safe": [0.0]}, {"map": [[5]]}, {"truncation": 0}, {"paths": [{}]}, {"a": 1})
    shown, data = written(line, tmp_path / "map.json", "solvability", *wrong, COLUMNS="140")
    words = "solution connected to y0, turns back at a fold, 2^-3, worst, rough from, first exit, safe"
    assert not [word for word in words.split(", ") if word not in shown]
    assert len(data["forward"]["reach"]) == len(data["theta"]) == 6
    assert len(data["map"][0]) == len(data["delta"]) == 8
    assert sum(data["findings"].values()) == 48
    assert {(e["scheme"], e["until"], e["paths"]) for e in data["paths"]} == {("energy-preserving", 1.0, 4)}
    assert data["refined"]["theta"]
    assert data["safe"][1] <= min(data["forward"]["reach"])


def test_the_command_draws(tmp_path) -> None:
    pytest.importorskip("matplotlib")
    out = tmp_path / "map.svg"
    command(f"solvability rigid-body --range 0.5 --states 4 --grid 2 --until 1 --picture {out}")
    assert "connected solution, found" in out.read_text()
    assert "none failed until there" in out.read_text()


def test_a_fold_predicts_the_failures_of_steps() -> None:
    """Of 4096 first steps of Lotka-Volterra from its most delicate states,
    those beyond the fold fail, and no others.

    Six standard errors.
    """
    problem, h, y = problems.lotka_volterra(), 2.0**-3, np.array([[0.5030815], [0.98331253], [3.8172917]])
    reach = [follow(problem, y, sign * 3.0).reach for sign in (-1.0, 1.0)]
    chance = float(chance_outside(h, problem.c, -reach[0], reach[1], 2)[0])
    assert 0.1 < chance < 0.3
    arguments = {"h": h, "T": h, "paths": 4096, "seed": 4, "engine": "numpy", "y0": y[:, 0]}
    ends = sepv.ensemble(schemes.energy_preserving, problem, **arguments)
    assert abs(np.mean(ends.status != 0) - chance) < 6 * math.sqrt(chance / 4096)


PATHS = 400


@pytest.fixture(scope="module")
def pendulum():
    return COMPACT_SETS["pendulum"][0]()


@pytest.mark.parametrize(
    ("scheme", "limit_of", "steps", "within"),
    [
        ("midpoint", "midpoint", 16, True),
        ("euler-heun", "euler-heun", 64, True),
        ("euler-maruyama", "midpoint", 16, False),
    ],
)
def test_no_more_paths_leave_than_the_bound_allows(pendulum, scheme, limit_of, steps, within) -> None:
    """The lower end of a one-sided interval of level 1e-6, the false-alarm rate of this test.

    Euler-Maruyama drifts, and leaves D more often than the midpoint rule may.
    """
    low, _ = measured(pendulum, scheme, steps, PATHS).interval(2e-6)
    allowed = bound(pendulum, limit_of, steps)
    assert allowed < 1
    assert (low <= allowed) == within


def test_the_energy_preserving_scheme_never_leaves_and_its_bound_is_rounding(pendulum) -> None:
    found = measured(pendulum, "energy-preserving", 16, PATHS)
    assert found.left == 0
    assert bound(pendulum, "energy-preserving", 16) < 1e-24


def test_errors_of_paths_that_stay_have_order_one(pendulum) -> None:
    """Halved four times with h; 400 paths on the same seeds,
    where the ratio's spread is some per cent.
    """
    coarse, fine = (measured(pendulum, "midpoint", n, PATHS).rms for n in (16, 64))
    assert 2.5 < coarse / fine < 7


def test_the_moments_of_a_step_fall_as_theory_says(pendulum) -> None:
    """The midpoint rule moves H by Δ³G + O(Δ⁴): m = O(h²), v = O(h³)."""
    (m0, v0), (m1, v1) = (moments(pendulum, "midpoint", h) for h in (2.0**-8, 2.0**-10))
    assert np.log2(m0 / m1) / 2 == pytest.approx(2, abs=0.15)
    assert np.log2(v0 / v1) / 2 == pytest.approx(3, abs=0.15)


def test_energy_and_casimir_of_lotka_volterra_bound_a_compact_set() -> None:
    """With u = ln y2, v = ln y3 and C = C(y0), H = 2 exp(C − (u + v)/2) + e^u + 2e^v + u − 2v is
    convex.

    Of all directions only zero has −(u + v), u, v ≤ 0: H grows in each, and far out exceeds H(y0).
    """
    D = COMPACT_SETS["lotka-volterra"][0]()
    y0 = np.asarray(D.problem.initial)
    C0, angles = float(D.F(y0)), np.linspace(0, 2 * np.pi, 720)
    u, v = 12 * np.array([np.cos(angles), np.sin(angles)])
    y = np.array([np.exp(C0 - 0.5 * (u + v)), np.exp(u), np.exp(v)])
    assert np.allclose(D.F(y), C0, atol=1e-10)
    formula = 2 * y[0] + y[1] + 2 * y[2] + u - 2 * v
    assert np.allclose(D.problem.hamiltonian(y), formula, rtol=1e-10)
    assert np.min(formula) > D.problem.hamiltonian(y0) + 1


PENDULUM = problems.pendulum()
C2 = 1.25  # c1² + c2²


def leading_order() -> tuple[float, float, float]:
    """Offset/h, drift/h² and D/h² of the midpoint rule on the pendulum, untruncated,
    from c − c̃ and by quadrature.

    With r² = H + 1, p = √2 r cos α, sin(q/2) = r sin α/√2 the flow is α′ = cos(q/2): dθ
    = dα/cos(q/2) on an orbit, and G = H‴(f, f, f)/24 = −p³ sin q/24, H₂ = −H″(f, f)/24 = −(sin²q
    + p² cos q)/24.
    """
    alpha = 2 * pi * np.arange(256) / 256

    def integrals(energy: float) -> tuple[float, float, float]:
        """The period, ∮G²dθ and ∮H₂dθ."""
        p, half = sqrt(2 * energy) * np.cos(alpha), sqrt(energy / 2) * np.sin(alpha)
        q, weight = 2 * np.arcsin(half), 2 * pi / alpha.size / np.sqrt(1 - half**2)
        G, H2 = -(p**3) * np.sin(q) / 24, -(np.sin(q) ** 2 + p**2 * np.cos(q)) / 24
        return float(weight.sum()), float(weight @ G**2), float(weight @ H2)

    p0, q0 = PENDULUM.initial
    energy = p0**2 / 2 + 2 * sin(q0 / 2) ** 2
    period, squares, modified = integrals(energy)
    step = 1e-4
    slope = (integrals(energy + step)[1] - integrals(energy - step)[1]) / (2 * step)
    start = -(sin(q0) ** 2 + p0**2 * np.cos(q0)) / 24
    walk = 3 * C2**3  # half of c⁶ Var(ξ³ − 3ξ)
    return 3 * C2 * (start - modified / period), walk * slope / period, walk * squares / period


def test_the_steps_themselves_and_the_local_error_give_one_walk_drift_and_offset() -> None:
    """Both agree as h → 0: the relative difference falls with h,
    and its extrapolation by h and h² is below 1 %.
    """
    found = []
    for h in (2.0**-5, 2.0**-6, 2.0**-7):
        d = energy_diffusion(schemes.midpoint, PENDULUM, h)
        found.append(np.array([d.offset / h, d.drift / h**2, d.diffusion / h**2]) / leading_order())
    coarse, middle, fine = found
    assert np.all(coarse < middle)
    assert np.all(middle < fine)
    extrapolated = (4 * (2 * fine - middle) - (2 * middle - coarse)) / 3
    assert np.all(np.abs(extrapolated - 1) < 0.01), extrapolated


def expectations(h: float, T: float) -> tuple[Array, Array, Array]:
    """Times, E[H − H(y0)] and Var H of the midpoint rule without a sample:
    powers of the Markov operator.

    It acts on functions of r² = H + 1, Chebyshev's polynomials, and of the angle α, Fourier's.
    Paths that leave the interval of r² stop there: six standard deviations at T.
    """
    low, high, N, waves = 0.1, 0.95, 28, np.arange(-10, 11)

    def basis(y: Array) -> Array:
        P, Q = y[0] / sqrt(2), sqrt(2) * np.sin(y[1] / 2)
        x = 2 * (np.clip(P**2 + Q**2, low, high) - low) / (high - low) - 1
        around = np.exp(1j * np.outer(np.arctan2(Q, P), waves))
        radial = np.polynomial.chebyshev.chebvander(x, N - 1)
        return (radial[:, :, None] * around[:, None, :]).reshape(len(x), -1)

    radii = low + (high - low) * (np.cos(pi * (np.arange(N) + 0.5) / N) + 1) / 2
    energy, angle = np.repeat(radii, waves.size), np.tile(2 * pi * np.arange(waves.size) / waves.size, N)
    y = np.stack([np.sqrt(2 * energy) * np.cos(angle), 2 * np.arcsin(np.sqrt(energy / 2) * np.sin(angle))])
    nodes, from_values = rule(2, h, 2, 8), np.linalg.inv(basis(y))
    ends = np.zeros((energy.size, energy.size), dtype=complex)
    for zeta, weight in zip(nodes.zeta.T, np.bincount(nodes.index, nodes.weights), strict=True):
        dW = np.sqrt(h) * np.repeat(zeta[:, None], energy.size, axis=1)
        ends += weight * basis(schemes.midpoint.step(PENDULUM, y, h, dW))
    operator, start = ends @ from_values, np.array(PENDULUM.initial)
    row, shift, moments = basis(start[:, None])[0] @ from_values, PENDULUM.hamiltonian(start) + 1, []
    for _ in range(round(T / h)):
        row = row @ operator
        moments.append([(row @ (energy - shift) ** power).real for power in (1, 2)])
    mean, square = np.array(moments).T
    return h * np.arange(1, mean.size + 1), mean, square - mean**2


def test_powers_of_the_markov_operator_have_the_drift_the_walk_and_the_offset() -> None:
    """Nothing of the theory is used: no orbit, no action, no sample.
    The theory leaves terms of relative size h.
    """
    h = 2.0**-4
    t, mean, variance = expectations(h, 128.0)
    theory = energy_diffusion(schemes.midpoint, PENDULUM, h)
    late = t >= 32
    drift, offset = np.polyfit(t[late], mean[late], 1)
    assert drift == pytest.approx(theory.drift, rel=h)
    assert offset == pytest.approx(theory.offset, rel=h)
    assert np.polyfit(t[late], variance[late], 1)[0] / 2 == pytest.approx(theory.diffusion, rel=h)


def test_paths_show_the_walk_and_the_drift_of_the_theory() -> None:
    found = growth(schemes.midpoint, PENDULUM, h=2.0**-3, T=128.0, paths=800, engine="numpy")
    assert found.kind == "a random walk"
    theory = found.derived
    # Five standard errors: a false alarm in a million; beside them the theory's own error, h of the
    # drift.
    expected = theory.offset + theory.drift * 128
    assert abs(found.mean[-1] - expected) < 5 * found.error[-1] + found.derived.drift * 128 / 8
    assert found.rms[-1] == pytest.approx(np.sqrt(2 * theory.diffusion * 128), rel=0.2)


def test_a_scheme_that_keeps_the_energy_is_at_rounding_and_has_no_drift() -> None:
    for problem in (PENDULUM, problems.rigid_body()):
        found = growth(schemes.energy_preserving, problem, h=2.0**-5, T=8.0, paths=64, engine="numpy")
        assert found.kind == "rounding"
        assert not found.drifts
    assert energy_diffusion(schemes.energy_preserving, PENDULUM, 0.1) is None  # not symplectic
    assert energy_diffusion(schemes.midpoint, problems.rigid_body(), 0.1) is None  # three dimensions


def test_an_explicit_scheme_multiplies_the_oscillators_mean_energy_in_each_step() -> None:
    problem, h, T = problems.harmonic_oscillator(), 2.0**-4, 16.0
    nodes = rule(1, h, 2, 12)
    dW = np.sqrt(h) * nodes.zeta[:, nodes.index]
    unit = np.repeat([[1.0], [0.0]], dW.shape[1], axis=1)
    factor = float(np.sum(schemes.euler_heun.step(problem, unit, h, dW) ** 2, axis=0) @ nodes.weights)
    found = growth(schemes.PAPER["euler-heun"], problem, h=h, T=T, paths=4000, engine="numpy")
    start = problem.hamiltonian(np.array(problem.initial))
    expected = start * (factor ** np.round(found.times / h) - 1)
    assert factor > 1 + h**2 / 2
    assert np.all(np.abs(found.mean - expected) < 5 * found.error)
    assert found.drifts


TIMES = 2.0 ** np.arange(8)


def _errors(kind: str, rng: np.random.Generator, paths: int = 256) -> Array:
    normal = rng.standard_normal((TIMES.size, paths))
    if kind == "bounded":
        return normal
    if kind == "a random walk":
        return np.cumsum(np.sqrt(np.diff(TIMES, prepend=0))[:, None] * normal, axis=0)
    return TIMES[:, None] * np.abs(normal[0]) * np.exp(0.05 * normal)


def test_intervals_take_one_growth_for_another_as_seldom_as_they_say() -> None:
    """Of 1000 runs of each kind 1 is expected to be called another one, and 1 of each two to drift:
    more than 6 are a chance of 1e-4. Long walks are decided.
    """  # fmt: skip
    rng = np.random.default_rng(0)
    for kind in ("bounded", "a random walk", "linear"):
        runs = [judged("", TIMES, _errors(kind, rng), rounding=0.0) for _ in range(1000)]
        assert sum(run.kind not in (kind, "open") for run in runs) <= 6
        assert sum(run.kind == kind for run in runs) >= 990
        if kind != "linear":
            assert sum(run.drifts for run in runs) <= 6
    assert kind_of(*exponent(TIMES, np.exp(TIMES)[:, None] * np.ones(8))) == "faster than linear"
    assert judged("", TIMES, _errors("linear", rng), rounding=0.0).drifts


def test_what_cannot_be_judged_is_not() -> None:
    failed = judged("mine", TIMES, np.ones((TIMES.size, 4)), rounding=0.0, failed=1)
    assert failed.kind == "open"
    assert not failed.drifts
    assert "1 of 4 paths failed" in failed.sentence()
    alone = np.zeros((TIMES.size, 3))
    alone[:, 0] = TIMES
    assert judged("", TIMES, alone, rounding=0.0).kind == "open"  # one path is the whole rms
    with pytest.raises(UsageError, match=f"multiple of {2**SLOPE_DOUBLINGS} h"):
        growth(schemes.midpoint, PENDULUM, h=0.25, T=1.0, paths=8)


def test_the_command_says_how_the_energy_grows_and_writes_it(tmp_path: Path) -> None:
    """By chance a verdict is another one twice in a thousand; the seed is fixed."""
    picture = tmp_path / "growth.svg"
    line = f"growth midpoint energy-preserving --time 64 --paths 400 -o {picture}"
    shown, data = written(line, tmp_path / "growth.json", "growth")
    assert "midpoint: t^(0.5" in shown
    assert "energy-preserving: rounding" in shown
    first, second = data["rows"]
    assert (first["kind"], second["kind"], second["derived"]) == ("a random walk", "rounding", None)
    assert first["derived"]["drift"] > 0
    assert "midpoint, theory" in picture.read_text()


def test_theory_is_not_shown_beyond_its_reach() -> None:
    """The splitting's walk leaves the well within T = 512 at this step."""
    found = energy_diffusion(schemes.by_name("splitting"), PENDULUM, 2.0**-3)
    assert found.reaches(8.0)
    assert not found.reaches(512.0)


def test_without_noise_the_command_shows_two_steps_and_the_verdict_of_the_law(tmp_path: Path) -> None:
    picture = tmp_path / "growth.svg"
    line = f"growth leapfrog explicit-4 energy-preserving --h 0.25 --time 64 --no-noise -o {picture}"
    said, data = written(line, tmp_path / "growth.json", "growth")
    rows = data["without_noise"]
    assert data["rows"] == []
    assert [row["trend"] for row in rows] == ["no trend", "a trend", "no trend"]
    coarse, fine = (curve[-1] for curve in rows[0]["largest"])
    assert coarse / fine == pytest.approx(4, rel=0.02)
    assert "leapfrog: |H − H(y0)| ≤ 0.0067 with h, 0.0017 with h/2, h^2.00; no trend" in said
    assert "which is rounding" in said
    assert "leapfrog, h/2" in picture.read_text()
