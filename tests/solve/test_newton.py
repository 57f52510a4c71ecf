"""Newton's iteration: what it reports, each of its safeguards on its own, and one lane to the bits of a batch."""

from collections.abc import Callable
from dataclasses import fields

import numpy as np
import pytest

from sepv import StepFailure, problems
from sepv.record import EPS
from sepv.solve import Equations, Evaluation, Increment, Solution, Status, require_converged
from sepv.solve import _damped as damped
from sepv.solve._from_record import Record
from sepv.solve._newton import MAX_HALVINGS, into_domain, iterate, newton


class Counted:
    """R and its slope as Equations; what was evaluated is counted lane by lane."""

    def __init__(self, R: Callable, slope: Callable | None = None, *, lanes: int = 1, **options) -> None:
        self.R, self.slope, self.calls = R, slope, np.zeros(lanes, dtype=np.int64)
        n = options.pop("unknowns", 1)
        self.equations = Equations(options.pop("size", np.ones((n, lanes))), self.evaluate, **options)

    def evaluate(self, z: np.ndarray, lanes: np.ndarray) -> Evaluation:
        np.add.at(self.calls, lanes, 1)
        count = np.full(z.shape[1], 3)
        value = self.R(z, lanes)
        right = Increment(value, count, 2 * count, np.isfinite(value).all(axis=0))

        def slopes() -> tuple[np.ndarray, int]:
            assert self.slope is not None
            return self.slope(z, lanes), 0

        return Evaluation(right, slopes)

    def solve(self, start: np.ndarray) -> Solution:
        solution = iterate(self.equations, start)
        # Every evaluation of R is 3 of ∇H and 6 of B; none is forgotten, none counted twice.
        assert np.all(solution.gradient_evaluations == 3 * self.calls)
        assert np.all(solution.structure_evaluations == 6 * self.calls)
        return solution


@pytest.mark.parametrize("lanes", [1, 3])
class TestLastCorrection:
    """z = c − rz with a slope r(1 + off), for y = 1: each correction is off·r/(1 + r) of the one before."""

    r = 0.25

    def solved(self, c: float, off: float, lanes: int, **options) -> Solution:
        slope = -self.r * (1 + off)
        system = Counted(
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

    def test_it_is_left_out_where_a_record_says_so(self, lanes: int) -> None:
        """Corrections of −1/8 and of 2⁻⁵⁴; the second leaves the domain."""

        class Two:
            record = Record(None, 3, 3)

            def of_lanes(self, z: np.ndarray, lanes: np.ndarray) -> tuple[np.ndarray, ...]:
                second = z[0] != 0
                correction = np.where(second, 2.0**-54, -0.125)[None]
                return correction, correction, ~second

            def of_one(self, lane: np.ndarray) -> Callable:
                return lambda z: (
                    [part.ravel().tolist() for part in self.of_lanes(np.array([z]), lane)[:2]] + [z == [0.0]]
                )

        nothing = lambda z, _: pytest.fail("the record does not suffice")  # noqa: E731
        equations = Equations(np.ones((1, lanes)), nothing, lambda z, _: z[0] >= 0.125, corrections=Two())
        found = iterate(equations, np.zeros((1, lanes)))
        assert found.status.tolist() == [Status.CONVERGED] * lanes
        assert found.value.tolist() == [[0.125] * lanes]


def test_a_slow_jacobian_ends_with_one_of_differences() -> None:
    """R′ = −r said to be 0: after 40 iterations an error of r⁴⁰, small beside its own lane's size or not.

    From there two iterations with the Jacobian of R itself solve a linear equation and see that it is solved; where
    the error is not small one damped step from 0 is between.
    """
    c, r = np.array([1.0, -1e6, 1e-6, 1.0]), np.array([0.6, 0.6, 0.6, 0.8])
    system = Counted(
        lambda z, lanes: np.stack([c[lanes] - r[lanes] * z[0], 1e-12 * c[lanes] - r[lanes] * z[1]]),
        lambda z, _: np.zeros((2, *z.shape)), lanes=4, unknowns=2, size=np.stack([0.1 * np.abs(c), 0 * c]),
    )  # fmt: skip
    solution = system.solve(np.zeros((2, 4)))
    assert solution.status.tolist() == [Status.CONVERGED] * 4
    assert np.all(np.abs(solution.value[0] - c / (1 + r)) <= EPS * np.abs(c))
    assert np.all(solution.residual <= EPS * np.abs(c))
    assert solution.iterations.tolist() == [42, 42, 42, 43]


def test_components_far_below_a_grown_state_still_converge_by_their_own_size() -> None:
    """z = (1, 10⁻³⁵ · ½ cos(10³⁵ z₂)): beside eps·|z| all that z₂ does is nothing.

    Where y0 says that 1 is vast, 10⁻²⁰, z₂ goes on to its own √eps, five evaluations; where |y0| is 1, or 0 and says
    nothing, it does not, and neither does it wait for another lane.
    """
    before, bend = np.array([1e-20, 1.0, 0.0, 1e-20]), np.array([1.0, 1.0, 1.0, 0.0])

    def R(z: np.ndarray, lanes: np.ndarray) -> np.ndarray:
        # The last lane is nearly linear, so that one step takes it to its √eps.
        nearly = 0.5e-35 - 1e-9 * z[1]
        return np.stack([0 * z[0] + 1, np.where(bend[lanes], 0.5e-35 * np.cos(1e35 * z[1]), nearly)])

    def slope(z: np.ndarray, lanes: np.ndarray) -> np.ndarray:
        last = -0.5 * bend[lanes] * np.sin(1e35 * bend[lanes] * z[1])
        return np.array([[0 * last, 0 * last], [0 * last, last]])

    system = Counted(R, slope, lanes=4, unknowns=2, size=np.stack([before, 0 * before]), exact=True)
    solution = system.solve(np.zeros((2, 4)))
    assert solution.status.tolist() == [Status.CONVERGED] * 4
    assert solution.iterations.tolist() == [5, 2, 2, 2]
    assert solution.value[1, 0] * 1e35 == pytest.approx(0.45018361129487355, rel=1e-15, abs=0)


def test_a_component_at_rounding_beside_the_others_converges_to_its_own() -> None:
    """z = (1, 10⁻¹⁷ · ½ cos(10¹⁷ z₂)): a share of eps|z| that is no rounding of it, 0.45 of 10⁻¹⁷."""
    system = Counted(
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
        """z = −L((1 + z) − ½) loses eps/2 in 1 + z, L times as much in R; L differs from lane to lane."""
        L = np.array([1e6, 1e8, 2.0])
        R, slope = lambda z, lanes: -L[lanes] * ((1 + z) - 0.5), lambda z, lanes: (-L[lanes] + 0 * z)[None]
        system = Counted(R, slope, lanes=3, exact=True)
        solution = iterate(system.equations, np.full((1, 3), 0.3))
        assert solution.status.tolist() == [Status.CONVERGED] * 3
        assert np.all(np.abs(solution.value[0] + L / 2 / (1 + L)) <= 4 * EPS)
        assert np.all(solution.iterations <= 6)
        # A Jacobian that is not said to be that of R excuses nothing: its first solve goes on to the end.
        vague = Counted(system.R, system.slope, lanes=3)
        assert np.all(iterate(vague.equations, np.full((1, 3), 0.3)).iterations[:2] > 40)

    def test_a_residual_of_the_smallest_numbers_is_none(self) -> None:
        """Four of them, whatever the Jacobian: nothing is known of their digits."""
        tiny = 4 * 5e-324
        system = Counted(lambda z, _: 0 * z + tiny, lambda z, _: 1 + 0 * z[None], size=np.zeros((1, 1)))
        solution = iterate(system.equations, np.zeros((1, 1)))
        assert solution.status.tolist() == [Status.CONVERGED]
        assert solution.iterations.tolist() == [1]


def test_damping_finds_what_full_steps_jump_over_and_leaves_the_other_lanes_alone() -> None:
    """arctan(z − a) = 0: full steps diverge from 0 for |a| > 1.39."""

    def solved(a: np.ndarray) -> Solution:
        R = lambda z, lanes: z - np.arctan(z - a[lanes])  # noqa: E731
        slope = lambda z, lanes: (1 - 1 / (1 + (z - a[lanes]) ** 2))[None]  # noqa: E731
        return Counted(R, slope, lanes=a.size, exact=True).solve(np.zeros((1, a.size)))

    a = np.array([1.0, 8.0, -5.0, 0.5])
    solution, alone = solved(a), solved(a[1:2])
    assert solution.status.tolist() == [Status.CONVERGED] * 4
    assert np.all(np.abs(solution.value[0] - a) <= 2 * EPS * np.abs(a))
    assert np.all(solution.iterations[[0, 3]] <= 8)
    assert np.all(solution.iterations[[1, 2]] > 8)
    assert alone.value[0, 0] == solution.value[0, 1]
    assert alone.iterations[0] == solution.iterations[1]


def test_what_blocks_a_share_is_said() -> None:
    """Out of the domain at every share; not finite at every share; inside, finite and never smaller."""
    system = Counted(
        lambda z, lanes: np.where(lanes == 1, np.inf, z - 9.0), lanes=3, inside=lambda z, lanes: lanes != 0
    )
    none = np.zeros(3, dtype=np.int64)
    state = Solution(np.zeros((1, 3)), np.ones(3), none, none.copy(), none.copy(), none.copy())
    moved = damped._take_share(
        system.equations, np.arange(3), state, np.ones(3), np.arange(3), np.ones((1, 1, 3)), np.ones((1, 3))
    )
    assert not moved.any()
    assert state.status.tolist() == [Status.LEFT_DOMAIN, Status.OVERFLOW, Status.NO_CONVERGENCE]
    assert not state.value.any()


@pytest.mark.parametrize("bound", [0.75, 0.3])
def test_steps_are_cut_at_the_boundary_of_the_domain(bound: float) -> None:
    """z = 2 + ln(1 − z/b): the solution lies inside, the first full step does not."""

    def R(z: np.ndarray, _: np.ndarray) -> np.ndarray:
        return 2 + np.log1p(-z / bound)

    system = Counted(
        R, lambda z, _: (-1 / (bound - z))[None], inside=lambda z, _: (z < bound).all(axis=0), exact=True
    )
    solution = system.solve(np.zeros((1, 1)))
    z = solution.value[0, 0]
    assert solution.status.tolist() == [Status.CONVERGED]
    assert z < bound
    assert abs(z - 2 - np.log1p(-z / bound)) <= 40 * EPS


def test_into_the_domain_by_the_fewest_halvings_lane_by_lane() -> None:
    limits = np.array([1.0, 8.0, 0.25, 3.0])
    equations = Equations(
        np.ones((1, 4)), lambda z, lanes: pytest.fail("nothing to evaluate"),
        inside=lambda z, lanes: (np.abs(z) <= limits[lanes]).all(axis=0),
    )  # fmt: skip
    z, lanes = np.array([[0.0, 0.0, 0.0, 2.0]]), np.arange(4)
    moved, inside = into_domain(equations, z, np.full((1, 4), 4.0), lanes)
    assert (moved.tolist(), inside.tolist()) == ([[-1.0, -4.0, -0.25, -2.0]], [True] * 4)
    moved, inside = into_domain(equations, np.array([[1.0, 2.5]]), np.array([[-4.0, -4.0]]), lanes[2:])
    assert (moved.tolist(), inside.tolist()) == ([[1 + 4 * 0.5**MAX_HALVINGS, 3.0]], [False, True])


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
# By lane: the size of y0, R and its slope (as the scheme says it), for the first unknown; the second is `second` of it.
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
        count = np.ones(len(lanes), dtype=np.int64)

        def slopes() -> tuple[np.ndarray, int]:
            K = np.zeros((2, 2, len(lanes)))
            K[0, 0] = [slope(x[0]) for (_, _, slope), x in columns]
            K[1, 1] = below[1]
            return K, 0

        return Evaluation(Increment(R, count, 2 * count, reliable), slopes)

    size = np.array([[LANES[name][0] for name in NAMES], [0.0] * len(NAMES)])
    magnitude = lambda z, _: np.full(z.shape[1], 1e4)  # noqa: E731
    return Equations(size, evaluate, exact=exact, inside=lambda z, _: z[0] < 1e7, magnitude=magnitude)


@pytest.mark.parametrize("differences", [False, True])
@pytest.mark.parametrize("exact", [False, True])
def test_one_lane_has_the_bits_of_that_lane_in_a_batch(exact: bool, differences: bool) -> None:
    system, numbers = equations(exact=exact), np.arange(len(NAMES))
    batch = newton(system, np.zeros((2, len(NAMES))), numbers, differences=differences)
    for k, name in enumerate(NAMES):
        alone = newton(system, np.zeros((2, 1)), numbers[k : k + 1], differences=differences)
        for field in fields(batch):
            one, many = getattr(alone, field.name), getattr(batch, field.name)
            assert (one is None) == (many is None)
            if one is not None:
                assert one.dtype == many.dtype
                np.testing.assert_array_equal(one[..., 0], many[..., k], err_msg=f"{name}: {field.name}")


def test_each_lane_ends_in_its_own_way() -> None:
    found = newton(equations(exact=True), np.zeros((2, len(NAMES))), np.arange(len(NAMES)), differences=False)
    endings = {name: Status(int(s)) for name, s in zip(NAMES, found.status, strict=True) if s}
    assert endings == {
        "singular": Status.SINGULAR, "infinite": Status.OVERFLOW, "infinite slope": Status.OVERFLOW,
        "leaves the domain": Status.LEFT_DOMAIN, "no quadrature": Status.QUADRATURE,
        "slope left out": Status.NO_CONVERGENCE,
    }  # fmt: skip
