"""Space-time Lévy areas: their law, how they add up, and orders beyond 1 of steps that ask for them."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.peers.solver import problem_of
from sepv.problem import Array, Problem, Systems
from sepv.problem._fields import matvec
from sepv.problem._hamiltonians import noise_field
from sepv.schemes import Scheme
from sepv.schemes._further_increments import rows_of_any_path
from sepv.schemes._order_claims import Orders
from sepv.simulate import _areas as areas
from sepv.verification import Effort, Verdict, verify
from sepv.verification._orders.gaussian import rule_for

LOCAL = ["local-mean", "local-mean-square", "local-weak"]


def shark(sign: float = 1.0) -> Scheme:
    """ShARK for additive noise: J. Foster, G. dos Reis and C. Strange, arXiv 2210.17543, equation (6.1)."""

    def step(problem: Problem, y: Array, h: float, dW: Array, H: Array) -> Array:
        def f(z: Array) -> Array:
            return matvec(problem.structure(z), problem.gradient(z))

        def noise(w: Array) -> Array:
            return sum(
                (problem.c[j] * w[j] * noise_field(problem, j, y) for j in range(problem.noises)), 0.0 * y
            )

        start = y + sign * noise(H)
        first = f(start)
        second = f(start + 5 / 6 * (h * first + noise(dW)))
        return y + noise(dW) + h * (0.4 * first + 0.6 * second)

    return Scheme(
        "shark", step, mean_square_order=Orders(1.5), weak_order=2.0, systems=Systems.HAMILTONIANS, asks="space-time",
        truncation=None, batched=True, problems=(problem_of("additive"),),
    )  # fmt: skip


def test_they_have_their_law_and_are_independent_of_the_increments() -> None:
    M, h = 20000, 0.25
    path = areas.drawn(3, T=1.0, steps=4, noises=2, paths=M)
    H, dW, A = path.bridges[1], path.dW[1], path.areas[1, 0]
    # Means and products of M normal numbers; 5 standard deviations: a false alarm once in 10⁶.
    for value, mean, deviation in (
        (np.mean(H[0] ** 2), h / 12, h / 12 * np.sqrt(2)),
        (np.mean(H[0] * dW[0]), 0.0, h / np.sqrt(12)),
        (np.mean(H[0] * H[1]), 0.0, h / 12),
        (np.mean(A * H[0] * dW[1]), h * h / 12, h * h),
    ):
        assert abs(value - mean) < 5 * deviation / np.sqrt(M)


def test_over_coarse_steps_they_are_those_of_the_path() -> None:
    path = areas.drawn(5, T=2.0, steps=24, noises=1, paths=3)
    K, h = 6, 6 * path.h
    W = np.concatenate([np.zeros((1, 1, 3)), np.cumsum(path.dW, axis=0)])
    # ∫W ds over each fine step is δ(W_k + ½ΔW_k + H_k).
    areas_below = path.h * (W[:-1] + 0.5 * path.dW + path.bridges)
    for n in range(4):
        part = slice(K * n, K * (n + 1))
        whole = areas_below[part].sum(axis=0) - h * W[K * n]
        expected = whole / h - 0.5 * (W[K * (n + 1)] - W[K * n])
        assert np.allclose(path.coarse(4).bridges[n], expected, atol=1e-14)
    assert np.allclose(path.coarse(8).coarse(2).bridges, path.coarse(2).bridges, atol=1e-14)
    assert path.rows(4, "space-time").shape == (4, 2, 3)


def test_the_rule_has_their_moments_with_and_without_areas() -> None:
    for kind in ("additive", "general"):
        nodes = rule_for(shark(), problem_of(kind), 0.25, 6)
        assert nodes.bridges is not None
        w, H, x = nodes.weights, nodes.bridges, nodes.xi
        assert np.allclose(H @ w, 0)
        assert np.allclose((H * w) @ H.T, np.eye(2) / 12)
        assert np.allclose((H * w) @ x.T, 0)
        assert np.allclose(
            nodes.zeta, np.concatenate([x, H])[:, nodes.index] if nodes.zeta.shape != x.shape else x
        )
    # The areas of the last one are made of the same B_i: E[A_12 H_1 ΔW_2] = h²/12.
    assert nodes.areas is not None
    assert np.isclose(np.sum(w * nodes.areas[0] * H[0] * x[1]), 1 / 12)


def test_some_of_them_reverse_with_the_path_and_move_with_the_noises() -> None:
    dW = np.array([[0.3], [-0.5]])
    H = rows_of_any_path("space-time", 0.25, dW)
    assert np.allclose(rows_of_any_path("space-time", -0.25, -dW), H)
    assert np.allclose(rows_of_any_path("space-time", 0.25, dW[::-1]), H[::-1])


def test_order_three_halves_of_additive_noise_is_seen_and_missed() -> None:
    report = verify(shark(), laws=LOCAL, effort=Effort())
    slopes = {f.law: (f.witness or {})["measured"][0]["slope"] for f in report.findings}
    assert all(f.verdict is Verdict.HOLDS for f in report.findings), [f.message for f in report.findings]
    assert slopes["local-mean-square"] == pytest.approx(2.0, abs=0.15)
    # With −H the means are right, and the order of paths is 1.
    wrong = verify(shark(-1.0), laws=LOCAL, effort=Effort())
    assert wrong.finding("local-mean-square").verdict is Verdict.VIOLATED
    assert wrong.finding("local-weak").verdict is Verdict.HOLDS
