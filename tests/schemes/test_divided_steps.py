"""Steps that the iteration does not solve from y: divided, or followed along their curve of solutions, and counted."""

import numpy as np
import pytest

import sepv
from sepv import problems, schemes
from sepv.errors import StepFailure
from sepv.schemes import continued, divided


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
    assert not scheme.claims
    assert scheme.source == "Cohen and Dujardin (2014), equation (2.1); failed steps in up to 2^8 parts"
    assert "2^20 parts" in divided(schemes.energy_preserving, 20).source
    with pytest.raises(StepFailure) as caught:
        divided(schemes.energy_preserving, 1).step(
            problems.lotka_volterra(noise=(0.5,)), np.array([1.0, 1.9, 0.5]), 0.25, np.array([40.0])
        )
    assert caught.value.delta == 20.25


EP = schemes.energy_preserving


PENDULUM = problems.pendulum()
# States (columns) and Δ of the pendulum: the iteration from y fails for all but the first, whatever its roundings.
LONG = np.array([[0.2, 0.62, 0.45, 1.13, -2.37], [1.0, 1.5, 1.65, -1.59, 1.45]])
DELTA = np.array([0.1, 13.7, 17.1, 22.0, 19.52])
STEPS = np.stack([DELTA, np.zeros(5)])  # c = (1, ½), h = 0


def test_long_steps_of_the_pendulum_are_reached_along_their_curve() -> None:
    """The curve of the last one ends before the step does."""
    plain, found = EP.solve(PENDULUM, LONG, 0.0, STEPS), continued(EP).solve(PENDULUM, LONG, 0.0, STEPS)
    assert (plain.status == 0).tolist() == [True, False, False, False, False]
    assert (found.status == 0).tolist() == [True, True, True, True, False]
    assert found.continuations[0] == 0 < found.continuations[1:].min()
    assert np.array_equal(found.value[:, 0], plain.value[:, 0])  # nothing else is touched
    assert np.array_equal(found.value[:, :4], (LONG + found.change)[:, :4])
    drift = np.abs(PENDULUM.hamiltonian(found.value) - PENDULUM.hamiltonian(LONG))[:4]
    assert drift.max() < 1e-13
    assert found.residual[:4].max() < 1e-12
    assert (found.iterations > plain.iterations).tolist() == [False, True, True, True, True]


def test_the_solution_is_the_one_that_belongs_to_y() -> None:
    """Against 1024 short shares by hand, each from the last."""
    y, z = LONG[:, 1:2], np.zeros((2, 1))
    for share in np.arange(1, 1025) / 1024:
        part = EP.solve(PENDULUM, y, 0.0, share * STEPS[:, 1:2], start=z)
        assert not part.status.any()
        assert np.abs(part.change - z).max() < 0.2
        z = part.change
    found = continued(EP).solve(PENDULUM, y, 0.0, STEPS[:, 1:2])
    assert np.allclose(found.change, z, rtol=0, atol=1e-12)


@pytest.mark.parametrize("delta", [1.14, 2.0])
def test_beyond_a_fold_there_is_no_solution_to_be_found(delta: float) -> None:
    """The curve of Lotka-Volterra from the paper's state ends at Δ = 1.139 in y = (1, 1.9, 0.5)."""
    problem, y = problems.lotka_volterra(), np.array([1.0, 1.9, 0.5])
    with pytest.raises(StepFailure):
        continued(EP).step(problem, y, delta, np.array([0.0]))
    assert np.isfinite(continued(EP).step(problem, y, 1.139, np.array([0.0]))).all()


def test_ensembles_and_paths_count_what_was_continued() -> None:
    options = {"h": 1e-9, "y0": LONG[:, 1], "truncation": None}
    dW = np.repeat(STEPS[None, :, [1, 0, 1]], 2, axis=0)
    dW[1] *= 0.01
    plain = sepv.ensemble(EP, PENDULUM, dW=dW, steps=2, engine="numpy", **options)
    ends = sepv.ensemble(continued(EP), PENDULUM, dW=dW, steps=2, **options)
    assert (plain.status > 0).tolist() == [True, False, True]
    assert not ends.status.any()
    assert plain.continuations == 0 < ends.continuations
    assert ends.energy_defect.max() < 1e-13
    both = sepv.ensemble(divided(continued(EP)), PENDULUM, dW=dW, steps=2, **options)
    assert (both.continuations, both.divisions) == (ends.continuations, 0)
    path = sepv.integrate(continued(EP), PENDULUM, dW=dW[:, :, 0], steps=2, **options)
    assert path.continuations == ends.continuations / 2


def test_every_scheme_of_one_stage_takes_a_start_and_claims_nothing_when_continued() -> None:
    for scheme in (schemes.midpoint, schemes.discrete_gradient, schemes.both_invariants):
        step = problems.rigid_body(), np.asarray(problems.rigid_body().initial), 0.1, np.zeros(1)
        again = continued(scheme)
        assert not again.claims
        assert np.array_equal(again.step(*step), scheme.step(*step))
