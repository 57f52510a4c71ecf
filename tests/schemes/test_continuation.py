"""Steps that Newton's iteration does not solve from y, followed along their curve of solutions and counted."""

from dataclasses import replace

import numpy as np
import pytest

import sepv
from sepv import problems, schemes
from sepv.errors import StepFailure, UsageError
from sepv.schemes import continued, divided

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


def test_schemes_without_a_start_are_refused() -> None:
    for scheme in (schemes.euler_heun, schemes.collocation(2), divided(EP), replace(EP, solve=None)):
        with pytest.raises(UsageError, match="start"):
            continued(scheme)
