"""A scheme as data: its step and its claims. There is no base class,
and a bare function is a scheme too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sepv._arguments import floats, is_number, is_whole
from sepv.core.step import Solution
from sepv.errors import UsageError, require_one_of
from sepv.problem import Array, Problem, Systems
from sepv.problems.shown_to_schemes import NEEDABLE
from sepv.record import EPS
from sepv.schemes._claims import PATHWISE, law_named, require_laws
from sepv.schemes._picture_look import Look
from sepv.schemes._point_distributions import PointLaw, point_law
from sepv.schemes._stateful import PathSolver, StatefulStep

# Kinds of a step's fifth argument: none, Lévy areas, increments over the first half, or space-time
# Lévy areas.
KINDS_OF_ASK = ("", "areas", "halves", "space-time")
DTYPES = ("float64", "float32")
# The rounding error of a step in single precision, in units of one rounding of y: y, the increment
# and their sum are rounded. Laws that compare errors with a floor add this error to it. Laws about
# single steps count each operation.
SINGLE_STEP = 4.0

# A step (problem, y, h, dW) -> y_next, with a fifth argument for a scheme with `Scheme.asks`.
Step = Callable[..., Array]
Solve = Callable[[Problem, Array, float, Array], Solution]


def truncation_for(order: float) -> int:
    """The k with which Remark 2.1 truncates increments, for mean-square order p:
    the paper's 2 for p ≤ 1, else 4p.

    An increment is clipped to |ΔW| ≤ √(2k h |ln h|). Order p needs k ≥ 2p. With k = 2p the error of
    clipping is of order p, and for many stages it exceeds the scheme's own error
    (`sepv.exact.clipping_error`). With k = 4p this error is of order 2p, and the bound of |ΔW| is
    larger by a factor √2 only.
    """
    return 2 if order <= 1 else round(4 * order)


@dataclass(frozen=True)
class Twin:
    """A second program that should make the same steps as a scheme, for the law "agreement".

    Attributes
    ----------
    scheme : Scheme, str or function
        The program, in any form that `sepv.schemes.load_scheme` takes.
    bits : bool
        True if its steps must have the same bits, False if they may differ by roundings and by the
        solvers' tolerances.
    words : str
        The argument of ``--agrees-with`` that names the program; empty if there is none.
    """

    scheme: Any
    bits: bool = False
    words: str = ""

    @property
    def options(self) -> str:
        """The options of ``sepv verify`` that name the program, with a blank before them;
        empty without words.
        """
        return f" --agrees-with {self.words}{' --bits' * self.bits}" if self.words else ""


@dataclass(frozen=True)
class Scheme:
    """A one-step method for (1.1) with its claims: the laws that it should obey,
    and its orders of convergence.

    Attributes
    ----------
    name : str
    step : callable (problem, y, h, dW) -> y_next
        One step, for y of shape (d,) and dW of shape (m,); with `batched` also for (d, M) and
        (m, M). A step returns the same bits for the same arguments, and changes nothing in place.
    claims : iterable of law names
        The laws that the scheme claims to obey; other laws are measured and printed too. The claim
        "reference" includes "refusal".
    source : str
        The source of the formula.
    mean_square_order, weak_order : float or `sepv.schemes.Orders`, optional
        Claimed orders, in general or for each kind of noise. A mean-square order also claims the
        laws "local-mean", "local-mean-square", "mean-square-order" and "right-limit". A weak order
        claims "local-weak" and "weak-order". A scheme with a `StatefulStep` claims no law of the
        local error: its order is that of the error at a fixed time.
    order : float, optional
        Claimed order p without noise: y1 = φ_h(y0) + O(h^(p+1)) for the exact flow φ. Claims
        "deterministic-order" too. With a `StatefulStep`: the error at a fixed time is O(h^p).
    noise : bool, optional
        False if the scheme is for systems without noise, c = (). Laws then call the step with a
        ``dW`` of shape (0,), and laws about noise do not apply. By default True, except if `order`
        is the only order claimed.
    solve : callable (problem, y, h, dW) -> Solution, optional
        For implicit schemes: the step for a batch of paths, with the solver's residual, counts and
        status of each path.
    solver_tolerance : float
        The relative tolerance of the scheme's own solver. The laws' bounds grow with it, and
        reports say so. 0 means that the equation is solved to rounding.
    truncation : int, optional
        The k of Remark 2.1: normal increments are clipped to |ΔW| ≤ √(2k h |ln h|). None for no
        truncation.
    increments : "normal", "two-point", "three-point" or PointLaw, optional
        The distribution of the increments. Increments with few values are bounded and need no
        truncation: `truncation` is then None. With them the scheme may claim a weak order only.
    batched : bool
        True if `step` takes batches of M states, (d, M).
    systems : Systems
        The class of systems from which laws draw the scheme's cases, or the text of the class, such
        as "single".
    problems : sequence of problems or strategies
        The only problems from which laws draw cases, if the scheme is not for every system of
        `systems`: names, ``module:attribute``, `Problem`, names of families, or Hypothesis
        strategies of `PolynomialSystem` or `Problem`.
    asks : str
        The fifth argument of the step: "areas" for the Lévy areas A_ij = ½∫(W_i dW_j − W_j dW_i)
        over the step, (m, m) or (m, m, M), skew; "halves" for the increments over the first half of
        the step, (m,) or (m, M); "space-time" for the space-time Lévy areas H_i = (1/h)∫(W_i(s)
        − (s/h)ΔW_i) ds, (m,) or (m, M), of variance h/12. By default a step has four arguments.
    stages : int
        The number s of stages of a collocation method. Laws then compare the scheme with the
        s-stage method of Cohen and Hairer instead of (2.1), and with the s-stage Gauss method
        instead of the midpoint rule.
    longest_step : float or callable (problem, y, h, dW) -> bool, optional
        The largest |h| + Σ|c_j ΔW_j| of a step that the scheme is made for, or a function that is
        True for such steps. Laws about single steps omit other steps. A law is inconclusive if less
        than a quarter of its cases remain.
    dtype : "float64" or "float32"
        The type of y, dW and y_next of the step. With float32 the laws' bounds are for roundings in
        float32, and defects and bounds are in units of 2⁻²³. The suite's own computations stay in
        float64.
    needs : iterable of str
        The attributes of a problem that the step cannot do without: "hessian",
        "structure_derivative", "mean_gradient". Users' problems may lack them, and so do some cases
        of laws. The scheme then gets them on every case whose problem has them; other cases are
        left out and counted. A step with `needs` is no step for problems given as functions of B
        and ∇H alone.
    look : Look, optional
        Colours, marker and dashes in pictures; by default a look that no other scheme of the
        picture has.
    twin : Twin, optional
        A second program that should make the same steps. ``sepv.verify(scheme, agrees_with=…)``
        sets it.

    Examples
    --------
    Heun's method with the random step:

    >>> import sepv
    >>> def step(problem, y, h, dW):
    ...     f = lambda y: problem.structure(y) @ problem.gradient(y)
    ...     delta = problem.random_step(h, dW)
    ...     return y + 0.5 * delta * (f(y) + f(y + delta * f(y)))
    >>> heun = sepv.Scheme("heun", step, claims=["noise-sum"], mean_square_order=1.0)
    >>> sepv.verify(heun, laws=["noise-sum", "energy"]).counts["violated"]
    1
    """

    name: str
    step: Step
    claims: Iterable[str] = ()
    source: str = ""
    mean_square_order: float | None = None
    weak_order: float | None = None
    order: float | None = None
    noise: bool | None = None
    solve: Solve | None = None
    solver_tolerance: float = 0.0
    truncation: int | None = 2
    increments: str | PointLaw | None = None
    batched: bool = False
    stages: int = 1
    systems: Systems = Systems.SINGLE
    asks: str = ""
    problems: Iterable[Any] = ()
    look: Look | None = None
    longest_step: float | Callable[..., bool] | None = None
    dtype: str = "float64"
    needs: Iterable[str] = ()
    twin: Twin | None = None

    def __post_init__(self) -> None:
        several = isinstance(self.claims, Iterable) and not isinstance(self.claims, str)
        claims: set[Any] = set(self.claims) if several else {self.claims}
        if not all(isinstance(claim, str) for claim in claims):
            raise UsageError(
                expected="claims, names of laws", received=f"{self.claims!r:.80}", remedy="see `sepv list`"
            )
        claims = {law_named(claim) for claim in claims}
        require_laws(claims)
        object.__setattr__(self, "dtype", _name_of_type(self.dtype))
        for attribute, (fits, expected) in _ATTRIBUTES.items():
            value = getattr(self, attribute)
            if not fits(value):
                raise _wrong(attribute, expected, value)
        if self.dtype != "float64" and self.solve is not None:
            raise _wrong("solve", "in float64, or none with dtype='float32'", self.solve)
        if isinstance(self.step, PathSolver) and (given := (self.batched, self.asks, self.dtype)) != (
            False,
            "",
            "float64",
        ):
            raise _wrong(
                "batched, asks, dtype", "none: a PathSolver takes dW of one path at a time in float64", given
            )
        law = point_law(self.increments)
        object.__setattr__(self, "increments", law)
        if law is not None:
            object.__setattr__(self, "truncation", None)
            if self.mean_square_order is not None:
                raise UsageError(
                    expected="a weak order alone, for increments of a few points",
                    received=f"mean_square_order = {self.mean_square_order!r} with {law.name} increments",
                    remedy="sepv.schemes.weakly(scheme, increments) drops what a scheme claims of paths",
                )
        # The first step of a method with memory may have a lower order than its paths.
        carries = isinstance(self.step, StatefulStep)
        if self.mean_square_order is not None:
            of_one_step = ("local-mean", "local-mean-square") if carries else ()
            claims |= PATHWISE - {*of_one_step}
        if self.weak_order is not None:
            claims |= {"weak-order"} if carries else {"weak-order", "local-weak"}
        if self.order is not None:
            claims |= {"deterministic-order"}
        require_one_of("systems", self.systems, tuple(Systems), "leave it out for a scheme for (1.1)")
        object.__setattr__(self, "systems", Systems(self.systems))
        stochastic = [n for n in ("mean_square_order", "weak_order") if getattr(self, n) is not None]
        if self.noise is False and (stochastic or self.systems.several_fields):
            raise UsageError(
                expected="a scheme without noise (noise=False) to be for (1.1) and to claim `order` alone",
                received=f"{stochastic[0]} = {getattr(self, stochastic[0])!r}"
                if stochastic
                else f"systems = {self.systems}",
                remedy="leave noise out, or the other",
            )
        listed = isinstance(self.problems, Iterable) and not isinstance(self.problems, str)
        object.__setattr__(self, "problems", tuple(self.problems) if listed else (self.problems,))
        object.__setattr__(self, "needs", tuple(self.needs))
        # A scheme that solves (2.1) must refuse a step for which (2.1) has no solution.
        object.__setattr__(
            self, "claims", frozenset(claims | ({"refusal"} if "reference" in claims else set()))
        )
        if not callable(self.step):
            raise UsageError(
                expected="Scheme(step=…), a function step(problem, y, h, dW) -> y_next",
                received=f"{type(self.step).__name__}: {self.step!r:.80}",
                remedy="hand over the function itself",
            )

    @property
    def deterministic(self) -> bool:
        """True if the scheme is only for systems without noise, c = ()."""
        if self.noise is not None:
            return not self.noise
        others = self.mean_square_order, self.weak_order
        return self.order is not None and others == (None, None) and not self.systems.several_fields

    @property
    def eps(self) -> float:
        """The distance from 1 to the next number of the scheme's precision: 2⁻⁵² or 2⁻²³."""
        return float(np.finfo(self.dtype).eps)

    @property
    def precision(self) -> float:
        """The relative error allowed for a step: the solver's tolerance,
        and in float32 also the step's rounding.
        """
        return self.solver_tolerance + (SINGLE_STEP * self.eps if self.eps > EPS else 0.0)

    def numbers(self, values: Array) -> Array:
        """A copy of values in the scheme's precision, for the arguments of its step."""
        return np.array(values, dtype=self.dtype)


def _name_of_type(dtype: Any) -> Any:
    """The name of a type of NumPy, such as "float32" of np.float32; for any other value
    str(value).
    """
    return dtype.__name__ if isinstance(dtype, type) and issubclass(dtype, np.generic) else str(dtype)


def _is_positive(value: Any) -> bool:
    return value is None or (is_number(value) and value > 0)


# A test of each attribute that can be tested alone, and a description of the values that pass the
# test.
_ATTRIBUTES: dict[str, tuple[Callable[[Any], Any], str]] = {
    "name": (lambda v: isinstance(v, str) and v.strip(), "a text"),
    "source": (lambda v: isinstance(v, str), "a text"),
    "mean_square_order": (_is_positive, "a number > 0"),
    "weak_order": (_is_positive, "a number > 0"),
    "order": (_is_positive, "a number > 0"),
    "noise": (lambda v: v in (None, True, False), "True or False"),
    "solver_tolerance": (lambda v: is_number(v) and 0 <= v < 1, "relative: from 0 to below 1"),
    "truncation": (lambda v: v is None or (is_whole(v) and v >= 1), "the integer k ≥ 1 of Remark 2.1"),
    "dtype": (lambda v: v in DTYPES, '"float64" or "float32"'),
    "stages": (lambda v: is_whole(v) and v >= 1, "an integer ≥ 1"),
    "needs": (
        lambda v: isinstance(v, Iterable) and not isinstance(v, str) and all(n in NEEDABLE for n in v),
        f"names of {', '.join(NEEDABLE)}",
    ),
    "twin": (lambda v: v is None or isinstance(v, Twin), "a sepv.schemes.Twin"),
    "asks": (lambda v: v in KINDS_OF_ASK, '"areas", "halves" or "space-time"'),
    "longest_step": (
        lambda v: callable(v) or _is_positive(v), "a number > 0 or a function (problem, y, h, dW) -> bool",
    ),
}  # fmt: skip


def _wrong(attribute: str, expected: str, value: Any) -> UsageError:
    return UsageError(
        expected=f"Scheme with {attribute}, {expected}",
        received=f"{value!r:.80}",
        remedy="correct it, or leave it out",
    )


def takes(scheme: Scheme, problem: Problem, y: Array, h: float, dW: Array) -> bool:
    """True if the scheme is made for this step, according to its `Scheme.longest_step`."""
    limit = scheme.longest_step
    if limit is None:
        return True
    if callable(limit):
        return bool(limit(problem, y, h, dW))
    return abs(h) + float(np.abs(problem.c * dW).sum()) <= limit


def weakly(scheme: Scheme, increments: str | PointLaw | None) -> Scheme:
    """A copy of a scheme with other `Scheme.increments`;
    with those of few values it claims no mean-square order.
    """
    law = point_law(increments)
    if law is None:
        return scheme if scheme.increments is None else replace(scheme, increments=None)
    claims = frozenset(scheme.claims) - PATHWISE - {"truncation"}
    return replace(scheme, increments=law, mean_square_order=None, claims=claims)


def as_lanes(problem: Problem, y: ArrayLike, h: float, dW: ArrayLike) -> tuple[Array, Array]:
    """The arguments y and dW of a step as arrays (d, M) and (m, M) of a batch;
    a single state is a batch of one path.

    Raises UsageError for a state, step or increment that does not fit the problem or is not finite.
    """
    if not hasattr(problem, "dimension"):
        raise UsageError(
            expected="a step(problem, y, h, dW) of a sepv.Problem",
            received=f"{type(problem).__name__}: {problem!r:.80}",
            remedy='problem = sepv.problems.by_name("rigid-body"), for example',
        )
    state, increment = floats("y", y), floats("dW", dW)
    d, m = problem.dimension, problem.noises
    if state.ndim not in (1, 2) or state.shape[0] != d or not np.all(np.isfinite(state)):
        raise UsageError(
            expected=f"y finite, of shape ({d},) or ({d}, M)",
            received=f"shape {state.shape}, {_finite(state)}",
            remedy="component first: a batch has its paths along the last axis"
            if np.all(np.isfinite(state))
            else "look where the first number came from that is not finite",
        )
    if not is_number(h):
        raise UsageError(
            expected="h, one finite number",
            received=f"{h!r:.80}",
            remedy="one step size for all paths of a batch" if np.ndim(h) else "give a number such as h=0.01",
        )
    if increment.shape != (m, *state.shape[1:]) or not np.all(np.isfinite(increment)):
        raise UsageError(
            expected=f"dW finite, of shape {(m, *state.shape[1:])}: one Wiener increment for each c_j and path",
            received=f"shape {increment.shape}, {_finite(increment)}",
            remedy=f"the problem has noise c = {problem.c.tolist()}; give as many increments"
            if np.all(np.isfinite(increment))
            else "look where the first number came from that is not finite",
        )
    lanes = state.reshape(d, -1)
    return lanes, increment.reshape(m, lanes.shape[1])


def _finite(values: Array) -> str:
    """The words "all finite" or "not all finite" about an array, for messages."""
    return "all finite" if np.all(np.isfinite(values)) else "not all finite"
