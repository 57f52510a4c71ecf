"""The dense solve: its tables and series by hand, polynomials, which it follows exactly, and where it ends."""

import re
from collections.abc import Callable

import numpy as np
import pytest

from sepv.exact import _dense_flow as dense
from sepv.exact._dense_flow import FlowFailure, solve_dense

EPS = 2.0**-52


def powers(y: np.ndarray) -> np.ndarray:
    """The field of (t, t², t³, t⁴, 1 − t): y_n′ = n y_{n−1}."""
    one = np.ones_like(y[0])
    return np.stack([one, 2 * y[0], 3 * y[1], 4 * y[2], -one])


@pytest.mark.parametrize("end", [3.0, -3.0, 0.1, -(2.0**-40)])
@pytest.mark.parametrize("shrink", [1.0, 0.6])
def test_polynomials_are_followed_exactly_either_way(end: float, shrink: float) -> None:
    y0 = np.array([0.0, 0.0, 0.0, 0.0, 1.0])
    solution = solve_dense(powers, y0, end, 7, shrink)
    edges = solution.edges
    assert np.all(np.diff(edges) > 0)
    assert {edges[0], edges[-1]} == {0.0, end}

    t = np.concatenate([edges, end * np.linspace(0, 1, 23) ** 2])
    exact = np.stack([t, t**2, t**3, t**4, 1 - t])
    # A few roundings of the largest component, a panel.
    assert np.max(np.abs(solution(t) - exact)) <= 4 * edges.size * EPS * np.max(np.abs(exact))
    assert np.array_equal(solution(edges[:-1]), solution.starts)


def rotation(rate: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda y: np.stack([-rate * y[1], rate * y[0]])


def panels(rate: float, stages: int, shrink: float = 1.0, end: float = 1.0) -> int:
    return int(solve_dense(rotation(rate), np.array([1.0, 0.0]), end, stages, shrink).edges.size) - 1


def test_panels_shrink_where_the_series_does_not_decay_and_grow_where_it_more_than_decays() -> None:
    """Ten times faster is ten times shorter, to a factor of two for the halving; fewer stages need more panels."""
    few, many = panels(2.0, 20), panels(20.0, 20)
    assert few <= 4
    assert 5 * few <= many <= 20 * few
    assert panels(2.0, 8) > 2 * few
    # Each panel is resolved: accepted below 4 eps of the largest component, with a weight half of this.
    solution = solve_dense(rotation(20.0), np.array([1.0, 0.0]), 0.5, 20)
    last = np.abs(solution.coefficients[:, -1]).max(axis=0) / 40 * np.diff(solution.edges)
    assert last.max() < 8 * EPS
    # A first panel that is far too short grows by a fifth each: some 20 panels to 2⁻⁸, without growth 32.
    assert 10 < panels(1.0, 20, 2.0**-12, 2.0**-8) < 24


def test_hundreds_of_panels_cost_no_more_rounding_than_one() -> None:
    """y₁′ = cos 40y₂ from 10⁶: each panel moves y₁ by less than 1, and half an ulp of 10⁶ a panel would be a walk.

    Sums that forget what was rounded off are 10 ulp off.
    """
    f = lambda y: np.stack([np.cos(40 * y[1]), np.ones_like(y[1])])  # noqa: E731
    solution = solve_dense(f, np.array([1e6, 0.0]), 200.0, 20)
    assert solution.edges.size > 500
    exact = 1e6 + np.sin(40 * solution.starts[1]) / 40
    assert np.abs(solution.starts[0] - exact).max() <= np.spacing(1e6)


def test_panels_depend_neither_on_the_unit_of_the_state_nor_on_its_sign() -> None:
    """Where the first is as long, ½: with |f| = |y|. Eight nodes are too few for it."""
    y0 = np.array([1.0, 0.25])
    edges = solve_dense(rotation(1.0), y0, 3.0, 8).edges
    assert edges[-2] < 3 - 1e-3
    assert np.diff(edges).max() < 0.5
    for unit in (-1.0, 2.0**-30, -(2.0**30)):
        assert np.array_equal(solve_dense(rotation(1.0), unit * y0, 3.0, 8).edges, edges)


def test_the_last_panel_ends_at_the_end_and_is_no_splinter() -> None:
    for end in 10 * np.random.default_rng(0).uniform(-1, 1, 40):
        for shrink in (0.6, 0.8):
            edges = solve_dense(np.ones_like, np.zeros(1), float(end), 4, shrink).edges
            assert {edges[0], edges[-1]} == {0.0, end}
            # What 40 numbers that know nothing of panels leave over; a splinter is eps.
            assert np.diff(edges).min() > 1e-9


def reached(error: pytest.ExceptionInfo[FlowFailure]) -> float:
    found = re.search(r"θ = (\S+) of", str(error.value))
    assert found is not None
    return float(found.group(1))


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("start", [1.0, 1e-3])
def test_a_solution_that_blows_up_is_followed_to_there(sign: int, start: float) -> None:
    """y′ = y²: y = 1/(1/y0 − t). Nothing is warned about on the way."""
    f, y0 = lambda y: y * y, np.array([sign * start])
    t = sign * np.array([0.5, 0.99]) / start
    # A relative error at t is multiplied by (1/y0)/(1/y0 − t), 100 in the end; the roundings of up to 231 panels, an
    # eps each, are a walk: √231, and twice that.
    ends = sign * start / np.array([0.5, 0.01])
    assert solve_dense(f, y0, t[-1], 20)(t)[0] == pytest.approx(ends, rel=100 * 30 * EPS, abs=0)
    with pytest.raises(FlowFailure, match=r"^The exact flow was followed to") as error:
        solve_dense(f, y0, 1.5 * sign / start, 20)
    # A rounding of y moves the end by no more than eps. Panels take a quarter of the way to it and more (20 terms then
    # decay to 4 eps), until that is 10⁻¹³(1 + θ) ≤ 2·10⁻¹³ of the way from 0: what is left is four times as much.
    assert reached(error) * sign * start == pytest.approx(1.0, rel=8e-13, abs=0)


def test_a_field_that_overflows_is_no_warning() -> None:
    """y′ = exp y from 0: y = −log(1 − t)."""
    end = solve_dense(np.exp, np.zeros(1), 0.5, 20)(np.array([0.5]))[0]
    # Three panels of some roundings, times the condition exp y = 2.
    assert end == pytest.approx(np.log(2), rel=16 * EPS, abs=0)
    with pytest.raises(FlowFailure) as error:
        solve_dense(np.exp, np.zeros(1), 3.0, 20)
    assert reached(error) == pytest.approx(1.0, rel=8e-13, abs=0)  # as above


@pytest.mark.parametrize("sign", [1, -1])
def test_a_field_that_ends_or_that_points_against_itself_is_followed_to_there(sign: int) -> None:
    wall = lambda y: np.where(sign * y < 2, sign + 0 * y, np.nan)  # noqa: E731
    jump = lambda y: np.where(y < 2, 1.0, -1.0)  # noqa: E731 - no solution beyond y = 2
    for f, end in ((wall, 3.0), (jump, 3.0)):
        with pytest.raises(FlowFailure, match=r"^The exact flow was followed to") as error:
            solve_dense(f, np.zeros(1), end, 12)
        assert reached(error) == pytest.approx(2.0, rel=0, abs=3e-13)  # the narrowest panel, 10⁻¹³(1 + θ)


def test_flows_that_take_too_many_panels_are_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    f, y0 = rotation(1.0), np.array([1.0, 0.0])
    needed = solve_dense(f, y0, 4.0, 12).edges.size - 1
    monkeypatch.setattr(dense, "_MAX_PANELS", needed)
    assert solve_dense(f, y0, 4.0, 12).edges.size - 1 == needed
    monkeypatch.setattr(dense, "_MAX_PANELS", needed - 1)
    with pytest.raises(FlowFailure, match=f"^{needed} panels led to θ = 4.0 of 4.0"):
        solve_dense(f, y0, 4.0, 12)
