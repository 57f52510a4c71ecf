"""Steps that have no solution, divided and counted; truncation that costs the order, said."""

import numpy as np
import pytest

import sepv
from sepv import problems, schemes
from sepv.errors import StepFailure, UsageError
from sepv.schemes import divided
from sepv.verification import verify


@pytest.mark.parametrize("name", ["energy-preserving", "both-invariants", "collocation-2"])
def test_divided_steps_reach_the_end_and_keep_the_energy(name: str) -> None:
    """Lotka-Volterra at h = 1/8: more than a tenth of the paths have a step of (2.1) without a solution."""
    problem, scheme = problems.lotka_volterra(), schemes.by_name(name)
    options = {"h": 0.125, "T": 1.0, "paths": 64, "seed": 1}
    plain = sepv.ensemble(scheme, problem, engine="numpy", **options)
    ends = sepv.ensemble(divided(scheme), problem, **options)
    assert plain.divisions == 0
    assert not ends.status.any()
    assert (ends.divisions > 0) == bool(plain.status.any())
    assert ends.energy_defect.max() < 1e-12
    fine = plain.status == 0
    assert np.array_equal(ends.y[:, fine], plain.y[:, fine])  # nothing else is touched


def by_hand(problem, y, h, dW, depth: int) -> tuple[np.ndarray, int, bool]:
    """(y1, divisions, solved) of one state, halves of halves written out with the scheme itself."""
    solution = schemes.energy_preserving.solve(problem, y, h, dW)
    if not solution.status[0]:
        return solution.value[:, 0], 0, True
    if not depth:
        return solution.value[:, 0], 0, False
    middle, first, arrived = by_hand(problem, y, h / 2, dW / 2, depth - 1)
    if not arrived:
        return middle, 1 + first, False
    end, second, solved = by_hand(problem, middle, h / 2, dW / 2, depth - 1)
    return end, 1 + first + second, solved


@pytest.mark.parametrize("depth", [1, 3])
def test_parts_are_the_steps_of_the_scheme_and_their_divisions_are_counted(depth: int) -> None:
    problem = problems.lotka_volterra(noise=(0.5,))
    dW = np.array([[0.1, 0.9, -1.4, 2.0, -2.5, 4.0, 6.0]])
    y = np.asarray(problem.initial)[:, None] * (1 + np.arange(7) / 50)
    h, solution = 0.125, divided(schemes.energy_preserving, depth).solve(problem, y, 0.125, dW)
    found = [by_hand(problem, y[:, k], h, dW[:, k], depth) for k in range(7)]
    assert np.array_equal(solution.value, np.stack([value for value, _, _ in found], axis=1))
    assert solution.divisions.tolist() == [count for _, count, _ in found]
    assert solution.divisions.dtype == np.int64
    assert (solution.status == 0).tolist() == [solved for _, _, solved in found]
    assert len({count for _, count, _ in found}) >= min(depth, 3)
    assert np.max(np.abs(solution.change - (solution.value - y))) < 1e-15
    whole = schemes.energy_preserving.solve(problem, y, h, dW)
    assert np.array_equal(solution.change[:, 0], whole.change[:, 0])


def test_a_divided_scheme_says_what_it_is_and_its_failures_what_they_were_asked() -> None:
    scheme = divided(schemes.energy_preserving)
    assert scheme.name == "energy-preserving, divided"
    assert scheme.source == "Cohen and Dujardin (2014), equation (2.1); failed steps in up to 2^8 parts"
    assert "2^20 parts" in divided(schemes.energy_preserving, 20).source
    with pytest.raises(StepFailure) as caught:
        divided(schemes.energy_preserving, 1).step(
            problems.lotka_volterra(noise=(0.5,)), np.array([1.0, 1.9, 0.5]), 0.25, np.array([40.0])
        )
    assert caught.value.delta == 20.25


def test_both_invariants_are_kept_by_the_parts() -> None:
    problem = problems.lotka_volterra()
    scheme = divided(schemes.both_invariants)
    paths = (sepv.integrate(scheme, problem, h=0.5, T=16.0, seed=seed) for seed in range(20))
    path = next(path for path in paths if path.divisions > 0)
    assert np.ptp(problem.hamiltonian(path.y)) < 1e-12
    assert np.ptp(problem.nambu.casimir(path.y)) < 1e-12


def test_depth_has_an_end_and_the_failure_is_said() -> None:
    problem = problems.lotka_volterra()
    y = np.asarray(problem.initial)
    for scheme in (schemes.energy_preserving, divided(schemes.energy_preserving, 1)):
        with pytest.raises(StepFailure):
            scheme.step(problem, y, 0.5, np.array([3.0]))
    assert np.isfinite(divided(schemes.energy_preserving, 8).step(problem, y, 0.5, np.array([3.0]))).all()


def test_division_is_never_on_in_verification() -> None:
    """A divided scheme claims nothing, and no scheme of ours is one."""
    assert not divided(schemes.energy_preserving).claims
    body, y = problems.rigid_body(), np.asarray(problems.rigid_body().initial)
    for scheme in schemes.PAPER.values():
        assert not scheme.solve or scheme.solve(body, y, 0.01, np.array([0.1])).divisions is None
    report = verify(divided(schemes.energy_preserving), laws=["truncation"])
    assert not report.findings[0].claimed


def test_bad_arguments_are_refused() -> None:
    with pytest.raises(UsageError, match="implicit scheme"):
        divided(schemes.euler_heun)
    for depth in (0, 21, 1.5, True):
        with pytest.raises(UsageError, match="depth"):
            divided(schemes.midpoint, depth)
