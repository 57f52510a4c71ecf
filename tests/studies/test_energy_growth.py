"""Energy over long times: three derivations of the midpoint rule's walk and drift, and verdicts by intervals."""

from math import pi, sin, sqrt
from pathlib import Path

import numpy as np
import pytest
from doors import written
from sepv.properties._growth import exponent, kind_of
from sepv.properties._orders.gaussian import rule

from sepv import UsageError, problems, schemes
from sepv.problem import Array
from sepv.studies._energy_diffusion import energy_diffusion
from sepv.studies._energy_growth import DOUBLINGS, growth, judged

PENDULUM = problems.pendulum()
C2 = 1.25  # c1² + c2²


def leading_order() -> tuple[float, float, float]:
    """Offset/h, drift/h² and D/h² of the midpoint rule on the pendulum, untruncated, from c − c̃ and by quadrature.

    With r² = H + 1, p = √2 r cos α, sin(q/2) = r sin α/√2 the flow is α′ = cos(q/2): dθ = dα/cos(q/2) on an orbit, and
    G = H‴(f, f, f)/24 = −p³ sin q/24, H₂ = −H″(f, f)/24 = −(sin²q + p² cos q)/24.
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
    """Both agree as h → 0: the relative difference falls with h, and its extrapolation by h and h² is below 1 %."""
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
    """Times, E[H − H(y0)] and Var H of the midpoint rule without a sample: powers of the Markov operator.

    It acts on functions of r² = H + 1, Chebyshev's polynomials, and of the angle α, Fourier's. Paths that leave the
    interval of r² stop there: six standard deviations at T.
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
    """Nothing of the theory is used: no orbit, no action, no sample. The theory leaves terms of relative size h."""
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
    # Five standard errors: a false alarm in a million; beside them the theory's own error, h of the drift.
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
    """Of 1000 runs of each kind 1 is expected to be called another one, and 1 of each two to drift: more than 6 are a
    chance of 1e-4. Long walks are decided."""  # fmt: skip
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
    with pytest.raises(UsageError, match=f"multiple of {2**DOUBLINGS} h"):
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
