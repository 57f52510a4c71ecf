"""Large sparse problems: the same steps as the dense core makes, invariants at rounding, failures marked."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import sepv
from sepv import ProblemError, StepFailure, large, schemes
from sepv.large import LargeProblem
from sepv.large import _schemes as steps
from sepv.problem import Array
from sepv.solve import Status

EPS = float(np.finfo(np.float64).eps)
CHAINS: dict[str, Callable[[int], LargeProblem]] = {
    "volterra": lambda n: large.volterra_lattice(2 * n + 1),
    "periodic volterra": lambda n: large.volterra_lattice(2 * n, periodic=True),
    "toda": large.toda_chain,
    "schroedinger": large.nonlinear_schroedinger,
    "spins": large.spin_chain,
}
STEPS = {"energy-preserving": large.energy_preserving, "midpoint": large.midpoint}


def dense(problem: LargeProblem) -> sepv.Problem:
    """The same system for the dense core, without its analytic slopes."""

    def over_lanes(function: Callable[[Array], Any]) -> Callable[[Array], Array]:
        def batch(y: Array) -> Array:
            flat = y.reshape(y.shape[0], -1)
            values = [np.asarray(function(flat[:, k])) for k in range(flat.shape[1])]
            return np.stack(values, axis=-1).reshape(*np.shape(values[0]), *y.shape[1:])

        return batch

    mean = problem.mean_gradient

    def mean_gradient(y0: Array, y1: Array) -> Array:
        assert mean is not None
        return np.stack([mean(y0[:, k], y1[:, k]) for k in range(y0.shape[1])], axis=1)

    parts = (lambda y: problem.structure(y).toarray(), problem.energy, problem.gradient)
    known = {"noise": problem.noise, "degree": problem.degree, "check": False}
    average = None if mean is None else mean_gradient
    return sepv.Problem(problem.dimension, *map(over_lanes, parts), mean_gradient=average, **known)


@pytest.mark.parametrize("scheme", STEPS)
@pytest.mark.parametrize("name", CHAINS)
def test_a_step_is_that_of_the_dense_core(name: str, scheme: str) -> None:
    problem = CHAINS[name](4)
    y, dW = np.array(problem.initial), np.array([0.08])
    solution = STEPS[scheme](problem, y, problem.random_step(0.02, dW))
    assert solution.status is Status.CONVERGED
    expected = schemes.PAPER[scheme].step(dense(problem), y, 0.02, dW)
    # Both stagnate at the rounding of a residual of a few dozen operations.
    assert np.max(np.abs(solution.value - expected)) <= 32 * EPS * np.max(np.abs(y))


@pytest.mark.parametrize("name", CHAINS)
def test_the_parts_of_the_problems_belong_together(name: str) -> None:
    for n in (2, 5, 50):
        large.check_large(CHAINS[name](n), seed=n)


@pytest.mark.parametrize("name", CHAINS)
def test_energy_and_quadratic_casimirs_are_kept_to_rounding(name: str) -> None:
    problem = CHAINS[name](200)
    path = large.integrate(large.energy_preserving, problem, h=0.02, steps=50)
    # 50 steps of rounding at the size of the terms, added up like a random walk over steps and terms, generously.
    assert path.energy_defect <= 10 * EPS * path.energy_scale
    assert path.casimir_defect <= 50 * EPS
    assert path.iterations <= 8 * 50


def test_the_midpoint_rule_loses_a_quartic_energy_and_keeps_the_casimirs() -> None:
    path = large.integrate(large.midpoint, large.spin_chain(100), h=0.02, steps=50)
    assert path.energy_defect > 1e-7 * path.energy_scale
    assert path.casimir_defect <= 50 * EPS


def test_casimirs_that_are_not_quadratic_are_lost_and_said_so() -> None:
    path = large.integrate(large.energy_preserving, large.volterra_lattice(101), h=0.02, steps=50)
    assert path.other_casimir_defect > 1e-6
    assert path.casimir_defect == 0


@pytest.mark.parametrize("name", CHAINS)
def test_the_band_solver_and_the_sparse_one_agree(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = CHAINS[name](60)
    delta = 0.05
    banded = large.energy_preserving(problem, problem.initial, delta)
    monkeypatch.setattr(steps, "WIDEST_BAND", -1)
    sparse = large.energy_preserving(problem, problem.initial, delta)
    assert banded.status is sparse.status is Status.CONVERGED
    assert np.max(np.abs(banded.value - sparse.value)) <= 32 * EPS * np.max(np.abs(problem.initial))


def test_neighbour_couplings_are_narrow_bands_and_rings_are_not(monkeypatch: pytest.MonkeyPatch) -> None:
    """So the cost is linear in d: a band of fixed width, whatever the length of the chain."""
    import scipy.linalg

    widths = []
    original = scipy.linalg.solve_banded

    def spy(bands: tuple[int, int], *args: Any, **more: Any) -> Array:
        widths.append(bands)
        return np.asarray(original(bands, *args, **more))

    monkeypatch.setattr(scipy.linalg, "solve_banded", spy)
    for name in ("volterra", "toda", "schroedinger", "spins"):
        chain = CHAINS[name](500)
        assert large.energy_preserving(chain, chain.initial, 0.01).status is Status.CONVERGED
    assert 0 < max(lower for lower, _ in widths) <= 5
    before, ring = len(widths), CHAINS["periodic volterra"](50)
    assert large.energy_preserving(ring, ring.initial, 0.01).status is Status.CONVERGED
    assert len(widths) == before


def test_memory_grows_like_d() -> None:
    import tracemalloc

    peaks = []
    for n in (500, 4000):
        problem = large.nonlinear_schroedinger(n)
        large.energy_preserving(problem, problem.initial, 0.01)
        tracemalloc.start()
        large.energy_preserving(problem, problem.initial, 0.01)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 10 * peaks[0]
    assert peaks[1] < 4000 * 8192


def test_a_path_uses_the_increments_it_is_given_and_is_the_same_again() -> None:
    problem = large.toda_chain(10)
    dW = sepv.simulate.increments(3, T=0.2, steps=10, noises=1)[:, :, 0]
    one = large.integrate(large.energy_preserving, problem, h=0.02, steps=10, seed=3)
    two = large.integrate(large.energy_preserving, problem, h=0.02, steps=10, dW=dW)
    assert np.array_equal(one.y, two.y)
    assert np.array_equal(one.W, dW.sum(axis=0))


def test_the_energy_difference_is_exact() -> None:
    problem = large.volterra_lattice(101)
    y = problem.initial
    shifted = y.copy()
    shifted[7] += 2.0**-52
    assert problem.energy_difference(shifted, y) == shifted[7] - y[7] != 0


# What goes wrong is marked


@pytest.mark.parametrize(
    ("change", "status"),
    [
        ({"gradient": lambda y: y * np.nan, "degree": 4, "mean_gradient": None}, Status.OVERFLOW),
        ({"domain": lambda _y: False}, Status.LEFT_DOMAIN),
        ({"hessian": lambda y: large.toda_chain(5).hessian(y) * 1e300 * 1e300}, Status.OVERFLOW),
        ({"hessian": lambda y: -30 * large.toda_chain(5).hessian(y)}, Status.NO_CONVERGENCE),
    ],
)
def test_failures_have_a_status_and_end_a_path(change: dict[str, Any], status: Status) -> None:
    problem = replace(large.toda_chain(5), **change)
    solution = large.energy_preserving(problem, problem.initial, 0.5)
    assert solution.status is status
    with pytest.raises(StepFailure, match=status.text):
        large.integrate(large.energy_preserving, problem, h=0.5, steps=2)


def test_a_singular_matrix_is_no_solution() -> None:
    from scipy.sparse import eye_array

    ones = np.ones((200, 1))
    assert np.isnan(steps.newton_correction(eye_array(4).tocsr(), ones[:4])).all()
    ring = eye_array(200, k=150) + eye_array(200, k=-50)  # I minus a permutation
    assert np.isnan(steps.newton_correction(ring.tocsr(), ones)).all()
    # ½Δ B H″ = 1 where H″ is −4B, B² = −1 and Δ = ½.
    chain = large.toda_chain(5)
    singular = replace(chain, hessian=lambda y: -4 * chain.structure(y))
    assert large.midpoint(singular, chain.initial, 0.5).status is Status.SINGULAR


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"gradient": lambda y: -large.spin_chain(4).gradient(y)}, "gradient"),
        ({"hessian": lambda y: 2 * large.spin_chain(4).hessian(y)}, "hessian"),
        ({"structure_slope": None}, "structure_slope"),
        ({"structure": lambda y: abs(large.spin_chain(4).structure(y))}, "skew"),
        ({"casimirs": lambda y: y[:3] ** 2}, "casimirs"),
        ({"terms": lambda y: y**2}, "gradient"),
        ({"degree": None, "mean_gradient": lambda y0, _: large.spin_chain(4).gradient(y0)}, "mean_gradient"),
    ],
)
def test_parts_that_contradict_each_other_are_found(change: dict[str, Any], word: str) -> None:
    large.check_large(large.spin_chain(4))
    with pytest.raises(ProblemError, match=word):
        large.check_large(replace(large.spin_chain(4), **change))
