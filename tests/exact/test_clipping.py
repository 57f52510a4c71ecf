"""What clipped increments cost: the closed form against integrals and simulation, and beside the errors of schemes."""

import math

import mpmath
import numpy as np
import pytest
from sepv.properties._orders.tilting import tilted_errors

from sepv import exact_flow, problems, schemes
from sepv.errors import UsageError
from sepv.exact import clipping_error
from sepv.exact._truncation_error import lost_mean_square
from sepv.record._binary64 import EPS
from sepv.schemes._scheme import truncation_for
from sepv.simulate import _truncation as bounded
from sepv.simulate import _wiener as wiener


@pytest.mark.parametrize("A", [0.0, 0.5, 2.0, 5.0, 12.0])
def test_the_mean_square_of_what_is_clipped_is_an_integral(A: float) -> None:
    ctx = mpmath.mp.clone()
    ctx.dps = 40
    exact = 2 * ctx.quad(lambda x: (x - A) ** 2 * ctx.npdf(x), [A, A + 4, A + 30])
    # Its two terms cancel to 2/A⁴ of their size.
    assert lost_mean_square(A) == pytest.approx(float(exact), rel=16 * EPS * (1 + A**4))


@pytest.mark.parametrize(("problem", "k"), [(problems.rigid_body(), 1), (problems.pendulum(), 2)])
def test_clipping_alone_moves_the_end_as_far_as_it_says(problem: problems.Problem, k: int) -> None:
    """The exact flow at the clipped and at the unclipped random time, 20000 paths of 8 steps."""
    raw = wiener.increments(3, T=1.0, steps=8, noises=problem.noises, paths=20_000)
    cut = bounded.truncate(raw, 1 / 8, k)
    ends = [exact_flow(problem, problem.random_step(1.0, dW.sum(axis=0))).y for dW in (raw, cut)]
    squared = np.sum((ends[0] - ends[1]) ** 2, axis=0)
    error = float(np.std(squared)) / math.sqrt(squared.size)
    # Six standard errors of the sample, 2e-9 of false alarm, and a tenth for the higher orders of what is cut off.
    said = clipping_error(problem, T=1.0, steps=8, k=k) ** 2
    assert abs(said - squared.mean()) < 6 * error + 0.1 * said
    assert 6 * error < 0.6 * said


def test_what_clipping_costs_on_the_rigid_body() -> None:
    """The figures of docs/higher-order.md, by the formula at a glance: |f|² = 0.43 to 0.55 on the way, T = c = 1."""
    body = problems.rigid_body()
    for steps, k, expected in ((128, 2, 7.0e-4), (128, 4, 3.4e-6), (128, 6, 2.0e-8), (8, 8, 1.5e-5)):
        found = clipping_error(body, T=1.0, steps=steps, k=k)
        A = bounded.truncation_bound(1 / steps, k)
        assert found == pytest.approx(expected, rel=0.12)
        assert 0.6 < found / math.sqrt(lost_mean_square(A)) < 0.8
    assert clipping_error(body, T=1.0, steps=8, k=None) == 0
    assert clipping_error(problems.rigid_body(noise=()), T=1.0, steps=8, k=2) == 0
    with pytest.raises(UsageError, match="0 < h < 1"):
        clipping_error(body, T=1.0, steps=1, k=2)


@pytest.mark.parametrize("s", [2, 3, 4])
def test_clipping_costs_little_beside_the_errors_of_a_scheme(s: int) -> None:
    """With the default k = 4s a tenth of the error of 8 steps; with k = 2s as much as that error, and more."""
    body, scheme = problems.rigid_body(), schemes.collocation(s)
    assert scheme.truncation == truncation_for(s) == 4 * s
    own = tilted_errors(scheme, body, T=1.0, steps=(8,), paths=range(512), seed=1, order=s).rms()[0]
    costs = [clipping_error(body, T=1.0, steps=8, k=k) for k in (4 * s, 2 * s)]
    assert costs[0] < 0.1 * own
    assert costs[1] > 0.5 * own
