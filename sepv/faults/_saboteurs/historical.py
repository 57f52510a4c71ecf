"""Faults that real programs had, each with the thread in which it was found.

A fault is put into a method that keeps its claims; `RIGHT` has the method without it. What a saboteur does is what the
thread describes, carried over to (1.1), where all noises drive the field f = B∇H: dy = f dt + Σ_j c_j f ∘dW_j.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from sepv.faults._saboteurs.record import Family, Fault, Laws
from sepv.problem import Array, Problem, vector_field
from sepv.problem._fields import derivative_along
from sepv.schemes import RANDOM_STEP, Scheme, euler_heun, milstein
from sepv.schemes._scheme import as_lanes

# (problem, y (d, M), h, dW (m, M)) -> y1 − y (d, M)
Move = Callable[[Problem, Array, float, Array], Array]

SABOTEURS = Family("historical")
# The right method of each.
RIGHT: dict[str, Scheme] = {}
_LOCAL = ("local-mean", "local-weak")
_LIMIT = ("local-mean", "local-mean-square", "right-limit", "mean-square-order", "weak-order")
_SCIML = "https://github.com/SciML"


def _moving(move: Move) -> Any:
    """The step y1 = y + move(problem, y, h, dW) for one state or a batch."""

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        state, noise = as_lanes(problem, y, h, dW)
        return (state + move(problem, state, h, noise)).reshape(np.shape(y))

    return step


def _like(scheme: Scheme, move: Move) -> Scheme:
    """A scheme with another step, which claims the same."""
    return replace(scheme, step=_moving(move), solve=None)


def _in(right: Scheme, laws: Laws, broken: str, thread: str) -> Callable[[Fault], Fault]:
    """Decorates the move of a method with the fault; `thread` is where it was found."""

    def added(move: Fault) -> Fault:
        name = move.__name__.replace("_", "-")
        RIGHT[name] = right
        SABOTEURS.add(name, broken, partial(_like, right, move), laws, thread)
        return move

    return added


def _noise(problem: Problem, dW: Array) -> Array:
    """S = Σ c_jΔW_j, (M,)."""
    return problem.random_step(0.0, dW)


def _by_taylor(problem: Problem, y: Array, h: float, dW: Array, *, wrong: bool = False) -> Array:
    """Δf + ½Δ²f′f; or with f′ applied to what stands where f stood, y + Δf."""
    delta = problem.random_step(h, dW)
    temporary = vector_field(problem, y)
    moved = delta * temporary
    if wrong:
        temporary = y + moved
    return moved + 0.5 * delta**2 * derivative_along(problem, y, temporary)


def _by_difference(
    problem: Problem, y: Array, h: float, dW: Array, *, sides: int = 2, drift: bool = False
) -> Array:
    """Milstein's scheme with f′f from a difference of width √h: (h + S)f + ½S² (f(y + √h f) − …)/√h."""
    S, f, width = _noise(problem, dW), vector_field(problem, y), math.sqrt(abs(h))
    if not width:
        return S * f + 0.5 * S**2 * derivative_along(problem, y, f)
    ahead = vector_field(problem, y + width * f + (h * f if drift else 0.0))
    slope = (
        (ahead - f) / width if sides == 1 else (ahead - vector_field(problem, y - width * f)) / (2 * width)
    )
    return (h + S) * f + 0.5 * S**2 * slope


TAYLOR = replace(_like(milstein, _by_taylor), name="taylor", claims=RANDOM_STEP)
DIFFERENCE = replace(_like(milstein, _by_difference), name="milstein by differences")


@_in(
    TAYLOR, ("expansion", *_LIMIT, *_LOCAL),
    "a temporary that held f(y) is overwritten by y + Δf, and f′ is applied to it as if it were f still",
    f"{_SCIML}/StochasticDiffEq.jl/issues/636, mended in pull 651: ImplicitRKMil without noise went elsewhere",
)  # fmt: skip
def overwritten_temporary(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return _by_taylor(problem, y, h, dW, wrong=True)


@_in(
    DIFFERENCE, ("local-mean", "local-weak"),
    "Milstein's term of the Stratonovich form by a one-sided difference of width √h, which has a mean of its own",
    f"{_SCIML}/StochasticDiffEq.jl/issues/19: order ½ where Itô's form has 1; torchsde: docs/peers",
)  # fmt: skip
def one_sided_difference(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return _by_difference(problem, y, h, dW, sides=1)


@_in(
    DIFFERENCE, ("local-mean", "local-weak", "mean-square-order"),
    "the same difference, taken along the drift as well",
    f"{_SCIML}/StochasticDiffEq.jl/pull/650, its first fault",
)  # fmt: skip
def drift_in_the_difference(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return _by_difference(problem, y, h, dW, sides=1, drift=True)


def _heun(problem: Problem, y: Array, h: float, noise: Array) -> Array:
    """hf + ½(f(ŷ) + f)·noise, with the noise of each component, (d, M) or (M,)."""
    f = vector_field(problem, y)
    return h * f + 0.5 * (vector_field(problem, y + h * f + f * noise) + f) * noise


@_in(
    euler_heun, ("noise-sum", "equivariance", "local-mean-square", "right-limit", "mean-square-order"),
    "the matrix of noise fields is read as diagonal: component i sees noise i and no other",
    f"{_SCIML}/DiffEqGPU.jl/issues/331, an error since pull 350",
)  # fmt: skip
def matrix_noise_as_diagonal(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Component i sees noise i alone: the diagonal of the (d, m) matrix with columns c_j f."""
    own = np.zeros_like(y)
    shared = min(len(y), len(dW))
    own[:shared] = (problem.c[:, None] * dW)[:shared]
    return _heun(problem, y, h, own)


@_in(
    euler_heun, ("noise-sum", *_LIMIT, *_LOCAL),
    "the noise is scaled by 1/c_j and not by c_j",
    "https://github.com/lammps/lammps/issues/2970 and 2948, mended in pull 2991: fix brownian had √γ for 1/√γ",
)  # fmt: skip
def friction_inverted(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    c = problem.c[:, None]
    return _heun(problem, y, h, np.sum(np.where(c > 0, dW / np.where(c > 0, c, 1.0), 0.0), axis=0))


@_in(
    euler_heun, ("noise-sum", *_LIMIT, *_LOCAL),
    "the noise is scaled by c_j² and not by c_j",
    "https://github.com/lammps/lammps/issues/5097: 1/μ of the variance of spin noise stood for the amplitude 1/√μ",
)  # fmt: skip
def variance_for_deviation(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return _heun(problem, y, h, np.sum(problem.c[:, None] ** 2 * dW, axis=0))


def _milstein(problem: Problem, y: Array, h: float, S: Array, square: Array) -> Array:
    """(h + S)f + ½ square f′f."""
    f = vector_field(problem, y)
    return (h + S) * f + 0.5 * square * derivative_along(problem, y, f)


@_in(
    milstein, ("noise-sum", "local-mean-square", "right-limit", "mean-square-order", *_LOCAL),
    "each noise drives the sum of all fields: Σ_jΔW_j · Σ_jc_j",
    "https://github.com/brian-team/brian2/issues/330, mended in pull 347: milstein with several noises",
)  # fmt: skip
def noises_crossed(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    S = np.sum(problem.c) * np.sum(dW, axis=0)
    return _milstein(problem, y, h, S, S**2)


@_in(
    TAYLOR, ("identity",),
    "where h = 0, y is left out of the sum",
    "https://github.com/brian-team/brian2/issues/686: x = noise and not x + noise in equations without drift",
)  # fmt: skip
def state_forgotten_without_drift(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Where h = 0, y1 is the move alone."""
    return _by_taylor(problem, y, h, dW) - (0.0 if h else y)


@_in(
    milstein, ("noise-sum", "local-mean-square", "mean-square-order"),
    "Milstein's term has the squares ΔW_j² and no products of different noises",
    "https://github.com/horchler/SDETools/issues/2: the formula of diagonal noise for every noise",
)  # fmt: skip
def cross_terms_dropped(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return _milstein(problem, y, h, _noise(problem, dW), np.sum((problem.c[:, None] * dW) ** 2, axis=0))


@_in(
    milstein, ("noise-sum", "local-mean-square", "mean-square-order"),
    "ΔW_i² stands for ΔW_iΔW_j in Milstein's term of the Itô form: the limit is right, the order ½",
    "https://github.com/qutip/qutip/pull/1283: an index in smesolve's milstein with two noises",
)  # fmt: skip
def index_repeated(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Σ_ij c_i c_j (ΔW_i² − h) where Σ_ij c_i c_j (ΔW_iΔW_j − δ_ij h) belongs, on the Itô form."""
    c = problem.c[:, None]
    square = np.sum(c * (dW**2 - h), axis=0) * np.sum(c) + np.sum(c**2) * h
    return _milstein(problem, y, h, _noise(problem, dW), square)


@_in(
    milstein, ("noise-sum", "local-mean-square"),
    "the loop over noises ends at the number of components",
    f"{_SCIML}/StochasticDiffEq.jl/pull/164: RKMilCommute; every test had as many noises as equations",
)  # fmt: skip
def as_many_noises_as_components(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    S = np.sum((problem.c[:, None] * dW)[: len(y)], axis=0)
    return _milstein(problem, y, h, S, S**2)


@_in(
    euler_heun, ("local-mean-square", *_LOCAL),
    "the noise has variance 1 in each step, whatever h is",
    "https://github.com/uclales/uclales/issues/7; StochasticDiffEq.jl/issues/558: the factor √h is missing",
)  # fmt: skip
def standard_normals(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return _heun(problem, y, h, _noise(problem, dW) / math.sqrt(abs(h)) if h else 0 * _noise(problem, dW))


@_in(
    milstein, ("local-mean-square", *_LOCAL),
    "(f′)ᵀf stands for f′f in Milstein's term: a vector-Jacobian product for a Jacobian-vector product",
    "docs/peers/torchsde_milstein.py, torchsde 0.2.6 with scalar noise and several components",
)  # fmt: skip
def transposed_derivative(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """(h + S)f + ½S² (f′)ᵀf."""
    S, f, columns = _noise(problem, dW), vector_field(problem, y), []
    for i in range(len(y)):
        e = np.zeros_like(y)
        e[i] = 1.0
        columns.append(np.sum(derivative_along(problem, y, e) * f, axis=0))
    return (h + S) * f + 0.5 * S**2 * np.stack(columns)


@_in(
    euler_heun, ("noise-sum", *_LIMIT, *_LOCAL),
    "the step draws its own noise from the same seed in each call",
    "https://github.com/brucefan1983/GPUMD/pull/191; espressomd/espresso/issues/3585: seeds that give one noise",
)  # fmt: skip
def fixed_numbers(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """A generator of its own with the same seed for each call, and the caller's increments are not looked at."""
    own = np.random.default_rng(42).standard_normal((dW.shape[0], 1)) * math.sqrt(abs(h))
    return _heun(problem, y, h, _noise(problem, np.broadcast_to(own, dW.shape)))
