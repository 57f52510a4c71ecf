"""The drivers of other libraries: fast, and still the library's own method. Each is skipped where it is missing."""

import numpy as np
import pytest

from sepv import problems
from sepv.peers.peer import Peer, load
from sepv.problem import Array, Problem
from sepv.simulate import _wiener as wiener
from sepv.studies._compare.method import Method
from sepv.studies._compare.run import compare

PROBLEMS = ("rigid-body", "pendulum", "lotka-volterra")


def peer(library: str) -> Peer:
    pytest.importorskip(library, reason=f"{library} is not installed: the extra `peers`")
    return load(library)


def given(problem: Problem, steps: int = 4, paths: int = 3) -> tuple[Array, float, Array]:
    h = 1e-2
    dW = wiener.increments(5, T=h * steps, steps=steps, noises=problem.noises, paths=paths)
    return np.array(problem.initial, dtype=np.float64), h, dW


def ends(method: Method, problem: Problem) -> Array:
    y0, h, dW = given(problem)
    job = method.prepare(problem, y0, h, dW)
    first, again = job(), job()
    assert np.array_equal(first.y, again.y)
    followed = method.follow(problem, y0, h, dW)
    assert np.allclose(followed.ends.y, first.y, rtol=0, atol=1e-14)
    assert not first.status.any()
    return first.y


@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize(
    ("library", "driven", "stepped"),
    [
        ("diffrax", "heun", "heun"), ("diffrax", "heun-vmap", "heun"), ("diffrax", "euler-heun", "euler-heun"),
        ("torchsde", "heun", "heun"), ("torchsde", "midpoint", "midpoint"), ("sdeint", "heun", "strat-heun"),
    ],
)  # fmt: skip
def test_a_driver_makes_the_steps_that_the_library_makes_one_by_one(library, driven, stepped, name):
    problem = problems.by_name(name)
    method, step = peer(library).methods[driven], peer(library).schemes[stepped].step
    y0, h, dW = given(problem)
    expected = []
    for lane in range(dW.shape[2]):
        y = y0
        for increment in dW[:, :, lane]:
            y = step(problem, y, h, increment)
        expected.append(y)
    # The drivers pose the m noises as the one that they are, which changes the order of some sums.
    assert np.allclose(ends(method, problem), np.stack(expected, axis=1), rtol=1e-13, atol=1e-14)


def test_two_evaluations_of_reversible_heun_share_a_state() -> None:
    """Whole paths hand the second solution on: the adapter's paths do, and the driver must."""
    problem = problems.rigid_body()
    theirs = peer("diffrax")
    y0, h, dW = given(problem)
    whole = theirs.paths[0].path(problem, y0, h, dW)
    assert np.allclose(ends(theirs.methods["reversible-heun"], problem), whole[-1], rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize(
    ("name", "order"), [("tsit5", 5), ("dopri8", 8), ("spark", 1), ("slow-rk", 1.5), ("reversible-heun", 1)]
)
def test_drivers_converge_to_the_exact_solution_with_their_order(name: str, order: float) -> None:
    method = peer("diffrax").methods[name]
    steps = (8, 16, 32) if order == 8 else (16, 32, 64)
    found = compare([method], problems.rigid_body(), steps=steps, paths=128, repeats=1)
    errors = [p.strong.value for p in found.points]
    slope = float(np.log2(errors[0] / errors[-1]) / 2)
    # Order p of an ordinary method in the random step is mean-square order p/2, for even p (Milstein's theorem),
    # and (p − 1)/2 at least for odd ones. No confidence is claimed: the paths are fixed, and so is the slope.
    least = order if order < 2 else order / 2 - 0.5
    assert least - 0.25 <= slope
    assert all(p.failures == 0 for p in found.points)
