"""The problem record: dy = B(y)∇H(y)(dt + Σ_j c_j ∘dW_j), equation (1.1) with m noises (§1).

The first axis of every array is that of components: a state is an array `(d,)`, a batch of M states
`(d, M)`, and B(y) is `(d, d)` or `(d, d, M)`. A function of indexing and NumPy's elementwise
functions accepts a state and a batch alike.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import InitVar, dataclass, field
from inspect import signature
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sepv._arguments import floats, is_number, is_whole
from sepv.console import facts, html
from sepv.core.arrays import Array
from sepv.core.problem import Function
from sepv.errors import ProblemError, UsageError
from sepv.problem._batches import ConstantStructure, taking_batches
from sepv.problem._data import NamedProblem, PolynomialSystem
from sepv.problem._derived import derive, to_be_derived
from sepv.problem._directional import derivative_along
from sepv.problem._facts import require_one_field, require_one_hamiltonian, require_one_structure
from sepv.problem._nambu import Nambu
from sepv.problem._stated import Stated

Flow = Callable[[Array, Array], Array]
# The functions that make up a problem. The first three are always set: `to_be_derived` marks a
# `gradient` not given.
_FUNCTIONS = (
    "structure", "hamiltonian", "gradient", "hessian", "structure_derivative", "mean_gradient", "domain",
)  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class Problem(Stated):
    """A stochastic Poisson system dy = B(y)∇H(y)(dt + Σ_j c_j∘dW_j), (1.1),
    with the functions that a scheme needs.

    Parameters
    ----------
    dimension : int
        The dimension d ≥ 1 of states.
    structure : callable, (d, ...) -> (d, d, ...), or matrix (d, d)
        The structure matrix B(y), skew-symmetric, or B itself if it is constant.
    hamiltonian : callable, (d, ...) -> (...)
        H. If H and B consist of arithmetic, indexing and NumPy's elementwise functions, nothing
        else is needed: both are called once with symbols, and ∇H and other parts not given below
        are derived. A function of one state alone, such as ``lambda y: y @ y``, is turned into one
        of batches in the same way.
    gradient : callable, (d, ...) -> (d, ...), optional
        ∇H. If it is given, it is compared with H, and no other part is derived.
    noise : array_like, shape (m,)
        The coefficients c_j ≥ 0 of the m noises; m = 0 is the deterministic problem.
    casimirs : sequence of (d, d) symmetric matrices A
        Quadratic Casimirs C(y) = yᵀAy: ∇Cᵀ B = 0 for all y.
    linear_casimirs : sequence of (d,) vectors b
        Linear Casimirs C(y) = bᵀy.
    invariants : mapping of names to callables, (d, ...) -> (...)
        Other functions I that the exact flow keeps, or whose mean grows or decays at a constant
        rate: LI = σ − λI with the generator L, such as momenta. They are recorded, as H is. The law
        *invariant* is about them.
    hessian, structure_derivative : callable, optional
        H″ and B′: (d, ...) -> (d, d, ...) and (d, ...) -> (d, d, d, ...), with ∂B_ij/∂y_k at [i, j,
        k]. With both, Newton's Jacobian is analytic. Otherwise it is formed from differences.
    mean_gradient : callable, optional
        (y0, y1) -> ∫₀¹∇H(y0 + τ(y1 − y0))dτ in closed form, exact to rounding also as y1 → y0.
    degree : int, optional
        The degree of a polynomial H: Gauss-Legendre quadrature with ⌈degree/2⌉ nodes is then exact.
        If neither `mean_gradient` nor `degree` is given or derived, the average of ∇H is found by
        adaptive quadrature.
    domain : callable, optional
        (d, ...) -> (...) of bool: True for the states at which H and B are defined.
    initial : array_like, shape (d,), optional
        A typical initial state.
    name : str
        The name in tables and messages.
    data : PolynomialSystem or NamedProblem, optional
        The same problem as numbers instead of functions. `sepv.problems` sets it; do not set it by
        hand.
    nambu : Nambu, optional
        For d = 3: the Casimir C and the factor g with B(y)v = g(y)(v × ∇C(y)).
    longest_step : float, optional
        The largest |h| + Σ|c_jΔW_j| for which every scheme is known to have a solution, from states
        near the initial one. If it is given, studies choose their steps by this bound, and the
        steps of laws do not exceed it.
    flows : sequence of callables (y, t) -> (d, ...), optional
        Exact flows of B∇H_k at times t (...), for parts H_k with H = ΣH_k: splitting methods need
        them.
    check : bool
        True (default) compares the parts with each other at a few states. Generated and built-in
        problems leave this check to tests.

    Raises
    ------
    ProblemError
        If B is not skew, `gradient` is not that of H, a yᵀAy or bᵀy is not a Casimir, LI is not σ
        − λI for one of the `invariants`, or a shape is wrong. The message names the component and
        both values.

    Examples
    --------
    A quartic oscillator, y = (p, q), H = p²/2 + q⁴/4:

    >>> import numpy as np
    >>> import sepv
    >>> problem = sepv.Problem(
    ...     dimension=2,
    ...     structure=lambda y: np.array([[0 * y[0], -1 + 0 * y[0]], [1 + 0 * y[0], 0 * y[0]]]),
    ...     hamiltonian=lambda y: y[0] ** 2 / 2 + y[1] ** 4 / 4,
    ...     gradient=lambda y: np.stack([y[0], y[1] ** 3]),
    ...     noise=(0.5,),
    ...     degree=4,
    ...     initial=(0.0, 1.0),
    ... )
    >>> path = sepv.integrate("energy-preserving", problem, h=0.125, T=1.0)
    >>> bool(np.ptp(problem.hamiltonian(path.y)) < 1e-14)
    True
    >>> report = sepv.verify("energy-preserving", laws="energy", problems=problem)
    >>> report.finding("energy").verdict.text
    'holds'
    """

    gradient: Function = to_be_derived
    nambu: Nambu | None = None
    initial: ArrayLike | None = None
    flows: tuple[Flow, ...] = ()
    longest_step: float | None = None
    name: str = "problem"
    data: PolynomialSystem | NamedProblem | None = None
    invariants: Mapping[str, Function] = field(default_factory=dict)
    check: InitVar[bool] = True
    # The rate γ of a further term −γy in the drift, or the matrix Γ of −Γy as a tuple of rows.
    damping = 0.0

    def __post_init__(self, check: bool) -> None:
        d = self.dimension
        if not is_whole(d) or d < 1:
            raise ProblemError(
                expected="dimension: an integer d ≥ 1",
                received=f"{d!r:.80}",
                remedy="give the number of components of y",
            )
        if not callable(self.structure) and isinstance(self.structure, (np.ndarray, list, tuple)):
            object.__setattr__(
                self, "structure", ConstantStructure(constant("structure", self.structure, (d, d)))
            )
        if check:
            _check_kinds(self)
            object.__setattr__(self, "dimension", int(d))
        c = coefficients(self.noise)
        # The array is made from bytes, so that no scheme can make it writable again.
        object.__setattr__(self, "c", np.frombuffer(c.tobytes(), dtype=np.float64))
        for key, shape in (("casimirs", (d, d)), ("linear_casimirs", (d,))):
            arrays = tuple(constant(key, value, shape) for value in getattr(self, key))
            object.__setattr__(self, key, arrays)
        if self.initial is not None:
            object.__setattr__(self, "initial", constant("initial", self.initial, (d,)))
        if check:
            y = np.ones(d) if self.initial is None else np.asarray(self.initial)
            shapes: dict[str, tuple[int, ...]] = {"structure": (d, d), "hamiltonian": ()}
            for key, of_value in shapes.items():
                object.__setattr__(self, key, taking_batches(key, getattr(self, key), y, of_value))
            stated = {key: taking_batches(key, I, y, ()) for key, I in self.invariants.items()}
            object.__setattr__(self, "invariants", stated)
        if self.gradient is to_be_derived:
            derived = derive(d, self.structure, self.hamiltonian)
            object.__setattr__(self, "gradient", derived.gradient)
            for key in ("hessian", "structure_derivative", "mean_gradient"):
                if getattr(self, key) is None:
                    object.__setattr__(self, key, getattr(derived, key))
            if self.degree is None:
                object.__setattr__(self, "degree", derived.degree)
        if check:
            from sepv.problem._checks import check_problem

            check_problem(self)
        # Other systems first prepare their noises.
        self._checked_invariants(check and type(self).__post_init__ is Problem.__post_init__)

    def _checked_invariants(self, check: bool) -> None:
        """Raise a ProblemError for a function in `invariants` that has no LI = σ − λI,
        if `check` is True.
        """
        from sepv.problem._invariants import require_invariants

        if check:
            require_invariants(self)

    @property
    def structures(self) -> Sequence[Any]:
        require_one_hamiltonian(self)
        return super().structures

    @property
    def gradients(self) -> Sequence[Any]:
        require_one_structure(self)
        return super().gradients

    def random_step(self, h: float, dW: Array) -> Array:
        """The random step Δ = h + Σ_j c_j ΔW_j, of shape () or (M,), summed in the order of j.

        Raises UsageError for a system with damping or with other fields than B∇H, which has none.
        """
        require_one_field(self)
        return super().random_step(h, dW)

    def derivative_along(self, y: Array, v: Array) -> Array:
        """The derivative f′(y)v of the field f = B∇H, (d, ...): analytic,
        else by differences of high order.
        """
        return derivative_along(self, y, v)

    def _repr_html_(self) -> str:
        """A table for a notebook: the name, the dimension, the noise, the initial state,
        the known parts.
        """
        rows = [
            ("dimension", str(self.dimension)),
            ("noise c_j", few(self.c)),
            ("initial state", "none" if self.initial is None else few(np.asarray(self.initial))),
            ("Casimirs", f"{len(self.casimirs)} quadratic, {len(self.linear_casimirs)} linear"),
            ("known", ", ".join(k.replace("_", " ") for k in self._known_parts()) or "B, H and ∇H alone"),
        ]
        return html(facts(f"{type(self).__name__} {self.name[:80]}", rows))

    def _known_parts(self) -> list[str]:
        names = ("hessian", "structure_derivative", "mean_gradient", "domain")
        return [name for name in names if getattr(self, name)]

    def __repr__(self) -> str:
        """One line: the name, the dimension, the noise, the initial state,
        and which parts are known.
        """
        start = "" if self.initial is None else f", initial {few(np.asarray(self.initial))}"
        casimirs = len(self.casimirs) + len(self.linear_casimirs)
        known = self._known_parts()
        return (
            f"<{type(self).__name__} {self.name[:80]}: d = {self.dimension}, c = {few(self.c)}{start}"
            + (f", {casimirs} Casimir{'s' * (casimirs > 1)}" if casimirs else "")
            + (f", {', '.join(known)}" if known else "")
            + ">"
        )


def few(values: Array) -> str:
    """The first six numbers of a vector in parentheses."""
    return f"({', '.join(f'{v:.6g}' for v in values[:6])}{', …' if values.size > 6 else ''})"


def require_one_for_each_noise(problem: Problem, key: str, each: str) -> None:
    """Raise a ProblemError unless the attribute `key` has an entry for each c_j;
    the message calls an entry `each`.
    """
    count = len(getattr(problem, key))
    if count != problem.noises:
        raise ProblemError(
            expected=f"{problem.noises} {key}, one for each coefficient in noise",
            received=f"{count}",
            remedy=f"give noise=(1.0, …) with one entry for each {each}",
        )


def _check_kinds(problem: Problem) -> None:
    """Check the types of a problem's attributes, and that its functions accept the arguments of
    their calls.
    """
    for key in _FUNCTIONS:
        function, arguments = getattr(problem, key), "y0, y1" if key == "mean_gradient" else "y"
        if function is None and key not in _FUNCTIONS[:3]:
            continue
        received = "" if callable(function) else f"{type(function).__name__}: {function!r:.80}"
        if not received:
            try:
                signature(function).bind(*arguments.split(", "))
            except TypeError as error:
                received = f"one that does not: {error}"
            except ValueError:
                pass  # a compiled function has no signature to check
        if received:
            raise ProblemError(
                expected=f"{key}: a function that takes ({arguments}), each of shape (d,) or (d, M)",
                received=received,
                remedy=f"{key}=lambda {arguments}: …",
            )
    for key, each in (("casimirs", "matrix"), ("linear_casimirs", "vector"), ("flows", "function")):
        if not isinstance(getattr(problem, key), (list, tuple)):
            raise ProblemError(
                expected=f"{key}: a tuple, with an entry for each {each}",
                received=f"{type(getattr(problem, key)).__name__}: {getattr(problem, key)!r:.80}",
                remedy=f"{key}=(first, second), and {key}=(only,) for one",
            )
    stated = problem.invariants
    degree, longest = problem.degree, problem.longest_step
    for right, expected, value in (
        (
            degree is None or (is_whole(degree) and degree >= 1),
            "degree: that of a polynomial H, an integer ≥ 1",
            degree,
        ),
        (longest is None or (is_number(longest) and longest > 0), "longest_step: a number > 0", longest),
        (isinstance(problem.name, str), "name: a text", problem.name),
        (
            isinstance(stated, Mapping)
            and all(isinstance(k, str) and callable(I) for k, I in stated.items()),
            "invariants: names with functions of y, {'momentum': lambda y: y[0] + y[1]}",
            stated,
        ),
    ):
        if not right:
            raise ProblemError(
                expected=expected, received=f"{value!r:.80}", remedy="correct it, or leave it out"
            )


def coefficients(noise: ArrayLike) -> Array:
    """Convert `noise` to an array (m,). Raises ProblemError unless all its entries are finite
    numbers c_j ≥ 0.
    """
    c = _numbers("noise", noise)
    for right, expected, remedy in (
        (np.all(np.isfinite(c)), "finite coefficients c_j", "give a number for each noise, or () for none"),
        (
            c.ndim <= 1,
            "the coefficients c_j in one row, or () for none",
            "noise=(0.5, 1.0) for two noises; noises with structures or Hamiltonians of their own are "
            "sepv.problem.StructuresProblem and HamiltoniansProblem",
        ),
        (
            np.all(c >= 0),
            "coefficients c_j ≥ 0",
            "a sign belongs into the Wiener increment: c∘dW and −c∘dW have the same law",
        ),
    ):
        if not right:
            shape = f"shape {c.shape}: " if c.ndim > 1 else ""
            raise ProblemError(
                expected=f"noise: {expected}", received=f"{shape}{noise!r:.120}", remedy=remedy
            )
    return c.reshape(-1)


def _numbers(key: str, value: ArrayLike) -> Array:
    """Copy a value to an array of numbers. Raises ProblemError, which names the attribute `key`,
    for other entries.
    """
    try:
        return floats(key, value).copy()
    except UsageError as error:
        raise ProblemError(expected=error.expected, received=error.received, remedy=error.remedy) from error


def constant(key: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    """The value of the attribute `key` as a read-only array;
    ProblemError unless it is finite and has this `shape`.
    """
    array = _numbers(key, value)
    if array.shape == shape and not np.all(np.isfinite(array)):
        raise ProblemError(
            expected=f"{key}: finite numbers", received=f"{value!r:.120}", remedy="correct those that are not"
        )
    if array.shape != shape:
        raise ProblemError(
            expected=f"{key}: arrays of shape {shape}",
            received=f"shape {array.shape}: {value!r:.120}",
            remedy="component first: one entry for each component of y",
        )
    if key == "casimirs" and not np.array_equal(array, array.T):
        raise ProblemError(
            expected="casimirs: symmetric matrices A with C(y) = yᵀAy",
            received=f"{array.tolist()}",
            remedy="use (A + Aᵀ)/2, which gives the same C",
        )
    array.setflags(write=False)
    return array


@dataclass(frozen=True)
class GivenProblem:
    """A user's problem, given by Python functions; `target` is the text that names it on the
    command line, if any.
    """

    problem: Problem
    target: str = ""


Description = PolynomialSystem | NamedProblem | GivenProblem
