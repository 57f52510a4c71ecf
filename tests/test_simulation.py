"""Paths and ensembles: the same numbers however they are asked for, and no failure unmarked."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

import sepv
from sepv import problems, schemes
from sepv.implicit import Status
from sepv.simulation import CHUNK

# These are about the NumPy batch; the compiled engine has its own file.
ensemble = partial(sepv.ensemble, engine="numpy")


def test_a_path_of_an_ensemble_is_the_single_path() -> None:
    problem = problems.pendulum()
    many = ensemble(schemes.energy_preserving, problem, h=1 / 32, T=1.0, paths=70, seed=9)
    one = sepv.integrate(schemes.energy_preserving, problem, h=1 / 32, T=1.0, seed=9)
    assert np.array_equal(one.y[:, -1], many.y[:, 0])
    assert one.t[-1] == 1.0
    assert one.y.shape == (2, 33)
    assert many.gradient_evaluations > 0
    assert many.iterations >= 70 * 32
    few = ensemble(schemes.energy_preserving, problem, h=1 / 32, T=1.0, paths=5, seed=9)
    assert np.array_equal(few.y, many.y[:, :5])
    assert np.array_equal(few.W, many.W[:, :5])


def test_chunks_do_not_change_the_bits() -> None:
    problem = problems.harmonic_oscillator()
    many = ensemble(schemes.euler_heun, problem, h=0.25, T=1.0, paths=CHUNK + 3, seed=1)
    few = ensemble(schemes.euler_heun, problem, h=0.25, T=1.0, paths=CHUNK, seed=1)
    assert np.array_equal(many.y[:, :CHUNK], few.y)


def test_invariants_are_kept_and_shown() -> None:
    problem = problems.rigid_body()
    kept = ensemble(schemes.energy_preserving, problem, h=1 / 64, T=1.0, paths=50)
    lost = ensemble(schemes.euler_heun, problem, h=1 / 64, T=1.0, paths=50)
    # 64 steps, each with a few roundings of an energy of size 1.2.
    assert kept.energy_defect.max() < 64 * 8 * 2.3e-16
    assert kept.casimir_defect.max() < 64 * 8 * 2.3e-16
    assert lost.energy_defect.min() > 1e-6


def test_failed_paths_are_marked_and_the_others_go_on() -> None:
    problem = problems.lotka_volterra()
    result = ensemble(schemes.energy_preserving, problem, h=1 / 8, T=1.0, paths=100, seed=0)
    failed = result.status != Status.CONVERGED
    assert 10 < failed.sum() < 70  # 41 % of the paths meet a step without solution at this step size
    assert np.all((result.failed_step >= 0) == failed)
    assert np.all(np.isfinite(result.y))
    assert result.energy_defect[~failed].max() < 1e-12
    # Path 0 of a seed is path 0 of its ensemble: take a seed whose path 0 fails.
    seed = next(
        s for s in range(20)
        if ensemble(schemes.energy_preserving, problem, h=1 / 8, T=1.0, paths=1, seed=s).status[0]
    )  # fmt: skip
    with pytest.raises(sepv.StepFailure, match="Remedy"):
        sepv.integrate(schemes.energy_preserving, problem, h=1 / 8, T=1.0, seed=seed)


def test_explicit_schemes_that_leave_the_domain_are_marked() -> None:
    result = ensemble(schemes.euler_maruyama, problems.lotka_volterra(), h=1 / 8, T=2.0, paths=64)
    assert {Status(s) for s in result.status} >= {Status.LEFT_DOMAIN}
    assert np.all(np.isfinite(result.y))


def test_one_lane_functions_can_be_run_as_ensembles() -> None:
    def one_state(problem, y, h, dW):
        assert y.ndim == 1
        return schemes.euler_heun.step(problem, y, h, dW)

    problem = problems.rigid_body()
    slow = ensemble(sepv.Scheme("one", one_state), problem, h=1 / 8, T=1.0, paths=7)
    fast = ensemble(schemes.euler_heun, problem, h=1 / 8, T=1.0, paths=7)
    assert np.array_equal(slow.y, fast.y)


@pytest.mark.parametrize(
    "wrong",
    [
        {"h": 0.0},
        {"h": -0.1},
        {"h": float("nan")},
        {"h": 0.3},
        {"T": float("inf")},
        {"T": -1.0},
        {"paths": 0},
        {"paths": 2.5},
        {"seed": -1},
        {"h": 1.0},
        {"y0": (1.0,)},
        {"y0": (float("nan"), 0.0, 0.0)},
    ],
)
def test_wrong_arguments_are_refused(wrong) -> None:
    arguments = {"h": 0.25, "T": 1.0, "paths": 3, **wrong}
    with pytest.raises(sepv.UsageError, match="Expected"):
        ensemble(schemes.energy_preserving, problems.rigid_body(), **arguments)


def test_wrong_arguments_of_a_path_are_refused() -> None:
    for wrong in ({"steps": 0}, {"steps": 3, "T": 1.0}, {}, {"steps": 3, "dW": np.zeros((4, 1))}):
        with pytest.raises(sepv.UsageError, match="Expected"):
            sepv.integrate(schemes.midpoint, problems.rigid_body(), h=0.25, **wrong)
