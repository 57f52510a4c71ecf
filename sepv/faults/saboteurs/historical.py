"""Faults that real programs had, each with the public report (thread) in which it was found.

Each fault is put into a right method (in `RIGHT_METHODS`), whose claims are kept. The reported
fault is repeated for the equation (1.1), where all noises drive the field f = B∇H: dy = f dt + Σ_j
c_j f ∘dW_j.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from sepv.problem import Array, Problem, derivative_along, vector_field
from sepv.schemes import RANDOM_STEP, Scheme, as_lanes, euler_heun, milstein

from .record import Family, Row

# The move of a step: (problem, y (d, M), h, dW (m, M)) -> y1 − y (d, M).
Move = Callable[[Problem, Array, float, Array], Array]

FAMILY = Family("historical")
# The right method of each saboteur.
RIGHT_METHODS: dict[str, Scheme] = {}
_LOCAL_MEANS = ("local-mean", "local-weak")
_ALL_LIMITS = ("local-mean", "local-mean-square", "right-limit", "mean-square-order", "weak-order")
_SCIML = "https://github.com/SciML"


def _moving(move: Move) -> Any:
    """Make the step y1 = y + move(problem, y, h, dW), which takes one state (d,) or a batch
    (d, M).
    """

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        state, noise = as_lanes(problem, y, h, dW)
        return (state + move(problem, state, h, noise)).reshape(np.shape(y))

    return step


def _like(scheme: Scheme, move: Move) -> Scheme:
    """A copy of `scheme` with unchanged claims and the step y1 = y + move(problem, y, h, dW)."""
    return replace(scheme, step=_moving(move), solve=None)


def _in(right: Scheme, *rows: Row) -> None:
    """Add saboteurs: each row has the method `right` with a fault in y1 − y,
    and the public report of this fault.
    """
    RIGHT_METHODS.update((name, right) for name, *_ in rows)
    FAMILY.rows(*rows, by=lambda move: partial(_like, right, move))


def _noise(problem: Problem, dW: Array) -> Array:
    """The noise S = Σ c_jΔW_j of a step, (M,)."""
    return problem.random_step(0.0, dW)


def _by_taylor(problem: Problem, y: Array, h: float, dW: Array, *, wrong: bool = False) -> Array:
    """The move y1 − y = Δf + ½Δ²f′f of a Taylor method; if `wrong`,
    f′ is applied to y + Δf and not to f.
    """
    delta = problem.random_step(h, dW)
    temporary = vector_field(problem, y)
    moved = delta * temporary
    if wrong:
        temporary = y + moved
    return moved + 0.5 * delta**2 * derivative_along(problem, y, temporary)


def _by_difference(
    problem: Problem, y: Array, h: float, dW: Array, *, sides: int = 2, drift: bool = False
) -> Array:
    """Milstein's move (h + S)f + ½S²f′f, S = Σ c_jΔW_j; f′f is a difference of width √h,
    with one or two `sides`.
    """
    S, f, width = _noise(problem, dW), vector_field(problem, y), math.sqrt(abs(h))
    if not width:
        return S * f + 0.5 * S**2 * derivative_along(problem, y, f)
    ahead = vector_field(problem, y + width * f + (h * f if drift else 0.0))
    slope = (
        (ahead - f) / width if sides == 1 else (ahead - vector_field(problem, y - width * f)) / (2 * width)
    )
    return (h + S) * f + 0.5 * S**2 * slope


TAYLOR = replace(_like(milstein, _by_taylor), name="taylor", claims=RANDOM_STEP)
MILSTEIN_BY_DIFFERENCES = replace(_like(milstein, _by_difference), name="milstein by differences")


def _heun(problem: Problem, y: Array, h: float, noise: Array) -> Array:
    """Heun's move y1 − y = hf + ½(f(ŷ) + f)·noise, ŷ = y + hf + f·noise; `noise` is (M,), or (d, M)
    by component.
    """
    f = vector_field(problem, y)
    return h * f + 0.5 * (vector_field(problem, y + h * f + f * noise) + f) * noise


def _milstein(problem: Problem, y: Array, h: float, S: Array, square: Array) -> Array:
    """Milstein's move y1 − y = (h + S)f + ½ `square` f′f;
    the right method has S = Σ c_jΔW_j and `square` = S².
    """
    f = vector_field(problem, y)
    return (h + S) * f + 0.5 * square * derivative_along(problem, y, f)


def _matrix_as_diagonal(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Let noise i drive component i only, as if the (d, m) matrix with columns c_j f were
    diagonal.
    """
    diagonal = np.zeros_like(y)
    shared = min(len(y), len(dW))
    diagonal[:shared] = (problem.c[:, None] * dW)[:shared]
    return _heun(problem, y, h, diagonal)


def _friction_inverted(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    c = problem.c[:, None]
    return _heun(problem, y, h, np.sum(np.where(c > 0, dW / np.where(c > 0, c, 1.0), 0.0), axis=0))


def _noises_crossed(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    S = np.sum(problem.c) * np.sum(dW, axis=0)
    return _milstein(problem, y, h, S, S**2)


def _index_repeated(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Use ΔW_i² − h in place of ΔW_iΔW_j − δ_ij h in the double sum Σ_ij c_i c_j of Milstein's Itô
    form.
    """
    c = problem.c[:, None]
    square = np.sum(c * (dW**2 - h), axis=0) * np.sum(c) + np.sum(c**2) * h
    return _milstein(problem, y, h, _noise(problem, dW), square)


def _as_many_as_components(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    S = np.sum((problem.c[:, None] * dW)[: len(y)], axis=0)
    return _milstein(problem, y, h, S, S**2)


def _standard_normals(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return _heun(problem, y, h, _noise(problem, dW) / math.sqrt(abs(h)) if h else 0 * _noise(problem, dW))


def _transposed_derivative(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Milstein's move with (f′)ᵀf in place of f′f: (h + S)f + ½S² (f′)ᵀf."""
    S, f, columns = _noise(problem, dW), vector_field(problem, y), []
    for i in range(len(y)):
        e = np.zeros_like(y)
        e[i] = 1.0
        columns.append(np.sum(derivative_along(problem, y, e) * f, axis=0))
    return (h + S) * f + 0.5 * S**2 * np.stack(columns)


def _fixed_numbers(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Draw increments from a new generator with the same seed in each call,
    and ignore the given increments dW.
    """
    numbers = np.random.default_rng(42).standard_normal((dW.shape[0], 1)) * math.sqrt(abs(h))
    return _heun(problem, y, h, _noise(problem, np.broadcast_to(numbers, dW.shape)))


_in(
    TAYLOR,
    ("overwritten-temporary",
     "y + Δf overwrites the temporary for f(y), to which f′ is then applied",
     ("expansion", *_ALL_LIMITS, *_LOCAL_MEANS), partial(_by_taylor, wrong=True),
     f"{_SCIML}/StochasticDiffEq.jl/issues/636, mended in pull 651: ImplicitRKMil without noise went elsewhere"),
)  # fmt: skip
_in(
    MILSTEIN_BY_DIFFERENCES,
    ("one-sided-difference",
     "Milstein's term of the Stratonovich form is a one-sided difference of width √h, whose error has a nonzero mean",
     ("local-mean", "local-weak"), partial(_by_difference, sides=1),
     f"{_SCIML}/StochasticDiffEq.jl/issues/19: order ½ where Itô's form has 1; torchsde: docs/peers"),
    ("drift-in-the-difference", "Milstein's term is a one-sided difference, taken along noise and drift",
     ("local-mean", "local-weak", "mean-square-order"), partial(_by_difference, sides=1, drift=True),
     f"{_SCIML}/StochasticDiffEq.jl/pull/650, its first fault"),
)  # fmt: skip
_in(
    euler_heun,
    ("matrix-noise-as-diagonal",
     "the matrix of noise fields is read as diagonal. Component i gets only noise i",
     ("noise-sum", "equivariance", "local-mean-square", "right-limit", "mean-square-order"), _matrix_as_diagonal,
     f"{_SCIML}/DiffEqGPU.jl/issues/331, an error since pull 350"),
    ("friction-inverted", "the noise is scaled by 1/c_j and not by c_j",
     ("noise-sum", *_ALL_LIMITS, *_LOCAL_MEANS), _friction_inverted,
     "https://github.com/lammps/lammps/issues/2970 and 2948, mended in pull 2991: fix brownian had √γ for 1/√γ"),
    ("variance-for-deviation", "the noise is scaled by c_j² and not by c_j",
     ("noise-sum", *_ALL_LIMITS, *_LOCAL_MEANS),
     lambda problem, y, h, dW: _heun(problem, y, h, np.sum(problem.c[:, None] ** 2 * dW, axis=0)),
     "https://github.com/lammps/lammps/issues/5097: 1/μ of the variance of spin noise stood for the amplitude 1/√μ"),
)  # fmt: skip
_in(
    milstein,
    ("noises-crossed", "the noise is Σ_jΔW_j · Σ_jc_j and not Σ_jc_jΔW_j",
     ("noise-sum", "local-mean-square", "right-limit", "mean-square-order", *_LOCAL_MEANS), _noises_crossed,
     "https://github.com/brian-team/brian2/issues/330, mended in pull 347: milstein with several noises"),
)  # fmt: skip
_in(
    TAYLOR,
    ("state-forgotten-without-drift", "if h = 0, the step gives y1 − y instead of y1", ("identity",),
     lambda problem, y, h, dW: _by_taylor(problem, y, h, dW) - (0.0 if h else y),
     "https://github.com/brian-team/brian2/issues/686: x = noise and not x + noise in equations without drift"),
)  # fmt: skip
_in(
    milstein,
    ("cross-terms-dropped", "Milstein's term has the squares ΔW_j² and no products of different noises",
     ("noise-sum", "local-mean-square", "mean-square-order"),
     lambda problem, y, h, dW: _milstein(
         problem, y, h, _noise(problem, dW), np.sum((problem.c[:, None] * dW) ** 2, axis=0)),
     "https://github.com/horchler/SDETools/issues/2: the formula of diagonal noise for every noise"),
    ("index-repeated",
     "ΔW_i² replaces ΔW_iΔW_j in Milstein's term of the Itô form. The limit is right, but the order is ½",
     ("noise-sum", "local-mean-square", "mean-square-order"), _index_repeated,
     "https://github.com/qutip/qutip/pull/1283: an index in smesolve's milstein with two noises"),
    ("as-many-noises-as-components", "the loop over noises ends at the number of components",
     ("noise-sum", "local-mean-square"), _as_many_as_components,
     f"{_SCIML}/StochasticDiffEq.jl/pull/164: RKMilCommute; every test had as many noises as equations"),
)  # fmt: skip
_in(
    euler_heun,
    ("standard-normals", "the noise has variance 1 in each step, whatever h is",
     ("local-mean-square", *_LOCAL_MEANS), _standard_normals,
     "https://github.com/uclales/uclales/issues/7; StochasticDiffEq.jl/issues/558: the factor √h is missing"),
)  # fmt: skip
_in(
    milstein,
    ("transposed-derivative",
     "Milstein's term has (f′)ᵀf (a vector-Jacobian product) and not f′f",
     ("local-mean-square", *_LOCAL_MEANS), _transposed_derivative,
     "docs/peers/torchsde_milstein.py, torchsde 0.2.6 with scalar noise and several components"),
)  # fmt: skip
_in(
    euler_heun,
    ("fixed-numbers", "the step draws its own noise from the same seed in each call",
     ("noise-sum", *_ALL_LIMITS, *_LOCAL_MEANS), _fixed_numbers,
     "https://github.com/brucefan1983/GPUMD/pull/191; espressomd/espresso/issues/3585: seeds that give one noise"),
)  # fmt: skip
