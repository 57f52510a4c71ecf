"""Newton's iteration: what it reports, each of its safeguards on its own,
and one lane to the bits of a batch.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from sepv import StepFailure, problems
from sepv.core import damped
from sepv.core.arrays import EPS
from sepv.core.equations import Equations, Evaluation, iterate
from sepv.core.newton import MAX_HALVINGS, Flagged, Root, Status, into_domain, newton
from sepv.core.step import Solution
from sepv.schemes import require_converged


class Given:
    """R and its slope as Equations; what was evaluated is counted lane by lane."""

    def __init__(self, R: Callable, slope: Callable | None = None, *, lanes: int = 1, **options) -> None:
        self.R, self.slope, self.calls = R, slope, np.zeros(lanes, dtype=np.int64)
        n = options.pop("unknowns", 1)
        self.equations = Equations(options.pop("size", np.ones((n, lanes))), self.evaluate, **options)

    def evaluate(self, z: np.ndarray, lanes: np.ndarray) -> Evaluation:
        np.add.at(self.calls, lanes, 1)
        value = self.R(z, lanes)

        def slopes() -> np.ndarray:
            assert self.slope is not None
            return self.slope(z, lanes)

        return Evaluation(value, np.isfinite(value).all(axis=0), slopes)

    def solve(self, start: np.ndarray) -> Root:
        return iterate(self.equations, start)


@pytest.mark.parametrize("lanes", [1, 3])
class TestLastCorrection:
    """z = c − rz with a slope r(1 + off), for y = 1: each correction is off·r/(1 + r)
    of the one before.
    """

    r = 0.25

    def solved(self, c: float, off: float, lanes: int, **options) -> Root:
        slope = -self.r * (1 + off)
        system = Given(
            lambda z, _: c - self.r * z,
            lambda z, _: (slope + 0 * z)[None],
            exact=True,
            lanes=lanes,
            **options,
        )
        return system.solve(np.zeros((1, lanes)))

    def test_it_is_applied_however_small_beside_the_state(self, lanes: int) -> None:
        """The second correction is 0.1 ulp of y, and 3 ulps of z."""
        found = self.solved(2.0**-5, 2.0**-46, lanes)
        assert np.all(np.abs(found.value - 2.0**-5 / 1.25) <= EPS * 2.0**-6)
        assert found.iterations.tolist() == [2] * lanes

    def test_it_is_left_out_where_it_leaves_the_domain(self, lanes: int) -> None:
        """The domain ends at the first iterate."""
        first = 2.0**-5 / (1 + self.r * (1 + 2.0**-46))
        found = self.solved(2.0**-5, 2.0**-46, lanes, inside=lambda z, _: (z <= first).all(axis=0))
        assert found.status.tolist() == [Status.CONVERGED] * lanes
        assert np.all(found.value == first)

    def test_it_is_left_out_where_code_says_so(self, lanes: int) -> None:
        """Corrections of −1/8 and of 2⁻⁵⁴; the second leaves the domain."""

        def advance(z: np.ndarray, _: np.ndarray) -> tuple[np.ndarray, np.ndarray, Flagged]:
            second = np.ravel(z) != 0
            correction = np.where(second, 2.0**-54, -0.125)[None]
            return correction, correction, Flagged(False, True, second)

        found = newton(advance, np.ones((1, lanes)), np.zeros((1, lanes)), np.arange(lanes))
        assert found.status.tolist() == [Status.CONVERGED] * lanes
        assert found.value.tolist() == [[0.125] * lanes]


def test_a_slow_jacobian_ends_with_one_of_differences() -> None:
    """R′ = −r said to be 0: after 40 iterations an error of r⁴⁰,
    small beside its own lane's size or not.

    From there two iterations with the Jacobian of R itself solve a linear equation and see that it
    is solved; where the error is not small one damped step from 0 is between.
    """
    c, r = np.array([1.0, -1e6, 1e-6, 1.0]), np.array([0.6, 0.6, 0.6, 0.8])
    system = Given(
        lambda z, lanes: np.stack([c[lanes] - r[lanes] * z[0], 1e-12 * c[lanes] - r[lanes] * z[1]]),
        lambda z, _: np.zeros((2, *z.shape)), lanes=4, unknowns=2, size=np.stack([0.1 * np.abs(c), 0 * c]),
    )  # fmt: skip
    solution = system.solve(np.zeros((2, 4)))
    assert solution.status.tolist() == [Status.CONVERGED] * 4
    assert np.all(np.abs(solution.value[0] - c / (1 + r)) <= EPS * np.abs(c))
    assert np.all(solution.residual <= EPS * np.abs(c))
    assert solution.iterations.tolist() == [42, 42, 42, 43]


def test_a_component_at_rounding_beside_the_others_converges_to_its_own() -> None:
    """z = (1, 10⁻¹⁷ · ½ cos(10¹⁷ z₂)): a share of eps|z| that is no rounding of it, 0.45 of
    10⁻¹⁷.
    """
    system = Given(
        lambda z, _: np.stack([0 * z[0] + 1, 0.5e-17 * np.cos(1e17 * z[1])]),
        lambda z, _: np.array([[0 * z[0], 0 * z[0]], [0 * z[0], -0.5 * np.sin(1e17 * z[1])]]),
        unknowns=2, size=np.array([[1.0], [0.0]]), exact=True,
    )  # fmt: skip
    solution = system.solve(np.zeros((2, 1)))
    assert solution.value[1, 0] * 1e17 == pytest.approx(0.45018361129487355, rel=1e-13, abs=0)


class TestRounding:
    """A residual that no longer shrinks is a solution only if it is what rounding leaves.

    What is evaluated to find that out belongs to a Jacobian, whose evaluations are not counted.
    """

    def test_beside_what_a_rounding_of_the_state_does_to_a_stiff_equation(self) -> None:
        """z = −L((1 + z) − ½) loses eps/2 in 1 + z, L times as much in R;
        L differs from lane to lane.
        """
        L = np.array([1e6, 1e8, 2.0])
        R, slope = lambda z, lanes: -L[lanes] * ((1 + z) - 0.5), lambda z, lanes: (-L[lanes] + 0 * z)[None]
        system = Given(R, slope, lanes=3, exact=True)
        solution = iterate(system.equations, np.full((1, 3), 0.3))
        assert solution.status.tolist() == [Status.CONVERGED] * 3
        assert np.all(np.abs(solution.value[0] + L / 2 / (1 + L)) <= 4 * EPS)
        assert np.all(solution.iterations <= 6)
        # A Jacobian that is not said to be that of R excuses nothing: its first solve goes on to
        # the end.
        vague = Given(system.R, system.slope, lanes=3)
        assert np.all(iterate(vague.equations, np.full((1, 3), 0.3)).iterations[:2] > 40)

    def test_a_residual_of_the_smallest_numbers_is_none(self) -> None:
        """Four of them, whatever the Jacobian: nothing is known of their digits."""
        tiny = 4 * 5e-324
        system = Given(lambda z, _: 0 * z + tiny, lambda z, _: 1 + 0 * z[None], size=np.zeros((1, 1)))
        solution = iterate(system.equations, np.zeros((1, 1)))
        assert solution.status.tolist() == [Status.CONVERGED]
        assert solution.iterations.tolist() == [1]


def test_damping_finds_what_full_steps_jump_over_and_leaves_the_other_lanes_alone() -> None:
    """arctan(z − a) = 0: full steps diverge from 0 for |a| > 1.39."""

    def solved(a: np.ndarray) -> Root:
        R = lambda z, lanes: z - np.arctan(z - a[lanes])  # noqa: E731
        slope = lambda z, lanes: (1 - 1 / (1 + (z - a[lanes]) ** 2))[None]  # noqa: E731
        return Given(R, slope, lanes=a.size, exact=True).solve(np.zeros((1, a.size)))

    a = np.array([1.0, 8.0, -5.0, 0.5])
    solution, alone = solved(a), solved(a[1:2])
    assert solution.status.tolist() == [Status.CONVERGED] * 4
    assert np.all(np.abs(solution.value[0] - a) <= 2 * EPS * np.abs(a))
    assert np.all(solution.iterations[[0, 3]] <= 8)
    assert np.all(solution.iterations[[1, 2]] > 8)
    assert alone.value[0, 0] == solution.value[0, 1]
    assert alone.iterations[0] == solution.iterations[1]


def test_what_blocks_a_share_is_said() -> None:
    """Out of the domain at every share; not finite at every share; inside,
    finite and never smaller.
    """
    system = Given(
        lambda z, lanes: np.where(lanes == 1, np.inf, z - 9.0), lanes=3, inside=lambda z, lanes: lanes != 0
    )
    none = np.zeros(3, dtype=np.int64)
    state = Root(np.zeros((1, 3)), np.ones(3), none, none.copy())
    F = lambda z, lanes: z - system.R(z, lanes)  # noqa: E731
    moved = damped.take_share(
        F,
        system.equations.inside,
        np.arange(3),
        state,
        np.ones(3),
        np.arange(3),
        np.ones((1, 1, 3)),
        np.ones((1, 3)),
    )
    assert not moved.any()
    assert state.status.tolist() == [Status.LEFT_DOMAIN, Status.OVERFLOW, Status.NO_CONVERGENCE]
    assert not state.value.any()


@pytest.mark.parametrize("bound", [0.75, 0.3])
def test_steps_are_cut_at_the_boundary_of_the_domain(bound: float) -> None:
    """z = 2 + ln(1 − z/b): the solution lies inside, the first full step does not."""

    def R(z: np.ndarray, _: np.ndarray) -> np.ndarray:
        return 2 + np.log1p(-z / bound)

    system = Given(
        R, lambda z, _: (-1 / (bound - z))[None], inside=lambda z, _: (z < bound).all(axis=0), exact=True
    )
    solution = system.solve(np.zeros((1, 1)))
    z = solution.value[0, 0]
    assert solution.status.tolist() == [Status.CONVERGED]
    assert z < bound
    assert abs(z - 2 - np.log1p(-z / bound)) <= 40 * EPS


def test_into_the_domain_by_the_fewest_halvings_lane_by_lane() -> None:
    limits = np.array([1.0, 8.0, 0.25, 3.0])
    inside = lambda z, lanes: (np.abs(z) <= limits[lanes]).all(axis=0)  # noqa: E731
    z, lanes = np.array([[0.0, 0.0, 0.0, 2.0]]), np.arange(4)
    moved, stays = into_domain(inside, z, np.full((1, 4), 4.0), lanes)
    assert (moved.tolist(), stays.tolist()) == ([[-1.0, -4.0, -0.25, -2.0]], [True] * 4)
    moved, stays = into_domain(inside, np.array([[1.0, 2.5]]), np.array([[-4.0, -4.0]]), lanes[2:])
    assert (moved.tolist(), stays.tolist()) == ([[1 + 4 * 0.5**MAX_HALVINGS, 3.0]], [False, True])


def test_the_first_lane_that_failed_is_the_failure() -> None:
    problem = problems.lotka_volterra()
    status = np.array([Status.CONVERGED, Status.SINGULAR, Status.OVERFLOW])
    y, dW = np.arange(9.0).reshape(3, 3), np.array([[2.0, 4.0, 6.0]])
    solution = Solution(-y, np.array([0.0, 7.0, 8.0]), np.array([4, 5, 6]), status, status, status)
    with pytest.raises(StepFailure, match="singular") as caught:
        require_converged(problem, y, 0.2, dW, solution)  # with c = 0.5
    failure = caught.value
    assert failure.y.tolist() == [1.0, 4.0, 7.0]
    assert (failure.delta, failure.residual, failure.iterations) == (2.2, 7.0, 5)
    fine = Solution(-y, solution.residual, solution.iterations, status, status, 0 * status)
    assert require_converged(problem, y, 0.2, dW, fine) is fine.value


TINY = 1e-310
# By lane: the size of y0, R and its slope (as the scheme says it), for the first unknown; the
# second is `second` of it.
LANES = {
    "contracts": (1.0, lambda z: 0.5 * np.cos(z), lambda z: -0.5 * np.sin(z)),
    "slope left out": (1.0, lambda z: 1 - 0.6 * z, lambda z: 0 * z),
    "large": (1e6, lambda z: 1e6 * np.cos(1e-6 * z), lambda z: -np.sin(1e-6 * z)),
    "back to zero": (1.0, lambda z: -np.cos(1e-3 * z), lambda z: 1e-3 * np.sin(1e-3 * z)),
    "subnormal": (TINY, lambda z: TINY * np.cos(z), lambda z: -TINY * np.sin(z)),
    "grown from little": (1e-20, lambda z: 0 * z + 1, lambda z: 0 * z),
    "grown from nothing": (0.0, lambda z: 0 * z + 1, lambda z: 0 * z),
    "at rest": (1.0, lambda z: 0 * z, lambda z: 0 * z),
    "singular": (1.0, lambda z: z + 1, lambda z: 0 * z + 1),
    "infinite": (1.0, lambda z: z + np.inf, lambda z: 0 * z),
    "infinite slope": (1.0, lambda z: 0 * z + 1, lambda z: z + np.inf),
    "cancels": (1.0, lambda z: (1e4 + 0.5 * np.cos(z)) - 1e4, lambda z: -0.5 * np.sin(z)),
    "rounds of a turn": (1.0, lambda z: 3 * np.sin(7 * z) + 1, lambda z: 21 * np.cos(7 * z)),
    "leaves the domain": (1.0, lambda z: 0 * z + 1e30, lambda z: 0 * z),
    "no quadrature": (1.0, lambda z: 0.5 * np.cos(z), lambda z: -0.5 * np.sin(z)),
}
NAMES = list(LANES)


def second(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """An unknown far below the first one, with a rounding of its own."""
    return 0.5e-35 * np.cos(1e35 * z), -0.5 * np.sin(1e35 * z)


def equations(*, exact: bool) -> Equations:
    def evaluate(z: np.ndarray, lanes: np.ndarray) -> Evaluation:
        columns = [(LANES[NAMES[lane]], z[:, k]) for k, lane in enumerate(lanes)]
        below = second(z[1])
        R = np.stack([np.array([R(x[0]) for (_, R, _), x in columns]), below[0]])
        reliable = np.array([NAMES[lane] != "no quadrature" for lane in lanes])

        def slopes() -> np.ndarray:
            K = np.zeros((2, 2, len(lanes)))
            K[0, 0] = [slope(x[0]) for (_, _, slope), x in columns]
            K[1, 1] = below[1]
            return K

        return Evaluation(R, reliable, slopes)

    size = np.array([[LANES[name][0] for name in NAMES], [0.0] * len(NAMES)])
    magnitude = lambda z, _: np.full(z.shape[1], 1e4)  # noqa: E731
    return Equations(size, evaluate, exact=exact, inside=lambda z, _: z[0] < 1e7, magnitude=magnitude)


def solved(system: Equations, start: np.ndarray, numbers: np.ndarray, differences: bool) -> Root:
    """By one attempt of Newton's method."""
    rounding = system.rounding if system.exact or differences else None
    advance = partial(system.advance, differences)
    return newton(advance, system.size[:, numbers], start, numbers, system.inside, rounding)


@pytest.mark.parametrize("differences", [False, True])
@pytest.mark.parametrize("exact", [False, True])
def test_one_lane_has_the_bits_of_that_lane_in_a_batch(exact: bool, differences: bool) -> None:
    system, numbers = equations(exact=exact), np.arange(len(NAMES))
    batch = solved(system, np.zeros((2, len(NAMES))), numbers, differences)
    for k, name in enumerate(NAMES):
        alone = solved(system, np.zeros((2, 1)), numbers[k : k + 1], differences)
        for field, one, many in zip(batch._fields, alone, batch, strict=True):
            assert one.dtype == many.dtype
            np.testing.assert_array_equal(one[..., 0], many[..., k], err_msg=f"{name}: {field}")


def test_each_lane_ends_in_its_own_way() -> None:
    found = solved(equations(exact=True), np.zeros((2, len(NAMES))), np.arange(len(NAMES)), False)
    endings = {name: Status(int(s)) for name, s in zip(NAMES, found.status, strict=True) if s}
    assert endings == {
        "singular": Status.SINGULAR, "infinite": Status.OVERFLOW, "infinite slope": Status.OVERFLOW,
        "leaves the domain": Status.LEFT_DOMAIN, "no quadrature": Status.QUADRATURE,
        "slope left out": Status.NO_CONVERGENCE,
    }  # fmt: skip
