"""One lane by itself is solved to the bits of that lane in a batch, however it ends."""

from dataclasses import fields

import numpy as np
import pytest

from sepv.solve import Increment, Status
from sepv.solve._newton import newton
from sepv.solve._solution import Equations, Evaluation

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
