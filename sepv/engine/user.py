"""The code of a problem whose author gave scalar functions: their sources go into the generated module.

What a function uses besides its arguments is written beside it: numbers as their values, functions of `math`
and numpy as imports, the author's own functions as sources. So the module's text, whose hash is its name, holds all
that its result depends on. Derivatives, which serve Newton's Jacobian only, are differences.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import math
import textwrap
from collections.abc import Callable, Sequence
from types import FunctionType, ModuleType
from typing import Any

import numpy as np

from sepv.checks import check_mean_gradient
from sepv.engine.code import Table, casimir_gradients, quadratic_form, skew
from sepv.engine.text import Expression, Text
from sepv.errors import ProblemError
from sepv.problem import Problem, ScalarFunctions
from sepv.quadrature import gauss_legendre

_SHIFT = 2.0**-26  # √eps: the error of a forward difference is of that size


class CannotTranslate(Exception):
    """Why a function's source cannot go into a generated module."""


class UserCode:
    """Code that calls the author's functions."""

    nambu = None
    field = None
    rate = 2.0**-16  # derivatives are differences, with some cancellation

    def __init__(self, problem: Problem, scalar: ScalarFunctions) -> None:
        _compare(problem, scalar)
        self.problem = problem
        self.dimension = problem.dimension
        self.degree = problem.degree or 0
        self.nodes = max(1, -(-self.degree // 2))
        closed = scalar.mean_gradient is not None
        self.closed = closed
        self.gradient_evaluations = 1 if closed else self.nodes
        self.bounded = problem.domain is not None
        translator = _Translator()
        functions = [("hamiltonian", scalar.hamiltonian), ("gradient", scalar.gradient)]
        functions += [("structure", scalar.structure)]
        functions += [("mean_gradient", scalar.mean_gradient)] if scalar.mean_gradient else []
        functions += [("domain", scalar.domain)] if scalar.domain else []
        for name, function in functions:
            translator.add(function, f"user_{name}")
        self.preamble = translator.text()

    def hamiltonian(self, e: Text, y: Sequence[str]) -> Expression:
        """H(y)."""
        return e.call("user_hamiltonian", y, 1)[0]

    def gradient(self, e: Text, y: Sequence[str]) -> list[Expression]:
        """∇H(y)."""
        return list(self._gradient(e, y))

    def hessian(self, e: Text, y: Sequence[str]) -> Table:
        """H″(y) by differences."""
        return self._transposed(self._differences(e, y, lambda x: self._gradient(e, x)))

    def structure(self, e: Text, y: Sequence[str]) -> Table:
        """B(y)."""
        return self._skew(e, self._structure(e, y))

    def structure_derivative(self, e: Text, y: Sequence[str]) -> list[Table]:
        """∂B_ij/∂y_k at [k][i][j] by differences."""
        return [self._skew(e, column) for column in self._differences(e, y, lambda x: self._structure(e, x))]

    def mean_gradient(self, e: Text, y: Sequence[str], z: Sequence[str]) -> list[Expression]:
        """The author's, or Gauss quadrature of ∇H."""
        return list(self._mean(e, y, z))

    def mean_hessian(self, e: Text, y: Sequence[str], z: Sequence[str]) -> Table:
        """Its derivative by z by differences."""
        return self._transposed(self._differences(e, z, lambda x: self._mean(e, y, x), beside=y))

    def domain(self, e: Text, y: Sequence[str]) -> str | None:
        """The author's."""
        return e.let(f"user_domain({', '.join(y)})") if self.bounded else None

    def casimirs(self, e: Text, y: Sequence[str]) -> list[Expression]:
        """yᵀAy and bᵀy."""
        quadratic = [quadratic_form(e, A, y) for A in self.problem.casimirs]
        return quadratic + [e.dot([e.number(float(v)) for v in b], y) for b in self.problem.linear_casimirs]

    def casimir_gradients(self, e: Text, ends: Sequence[str]) -> Table:
        """A(y0 + y1), and b."""
        return casimir_gradients(e, self.problem.casimirs, self.problem.linear_casimirs, ends)

    def _gradient(self, e: Text, y: Sequence[str]) -> list[str]:
        call = e.let(f"user_gradient({', '.join(y)})")
        return [e.let(f"{call}[{i}]") for i in range(self.dimension)]

    def _structure(self, e: Text, y: Sequence[str]) -> list[str]:
        call = e.let(f"user_structure({', '.join(y)})")
        return [e.let(f"{call}[{i}]") for i in range(self.dimension * (self.dimension - 1) // 2)]

    def _mean(self, e: Text, y: Sequence[str], z: Sequence[str]) -> list[str]:
        if self.closed:
            end = [e.let(f"{a} + {b}") for a, b in zip(y, z, strict=True)]
            call = e.let(f"user_mean_gradient({', '.join([*y, *end])})")
            return [e.let(f"{call}[{i}]") for i in range(self.dimension)]
        total: list[Expression] = [None] * self.dimension
        points, weights = gauss_legendre(self.nodes)
        for tau, weight in zip(points, weights, strict=True):
            state = [str(e.plus(e.number(float(tau)), b, a)) for a, b in zip(y, z, strict=True)]
            g = self._gradient(e, state)
            total = [e.plus(e.number(float(weight)), v, s) for v, s in zip(g, total, strict=True)]
        return [str(s) for s in total]

    def _differences(
        self,
        e: Text,
        x: Sequence[str],
        function: Callable[[list[str]], list[str]],
        beside: Sequence[str] = (),
    ) -> list[list[str]]:
        """(function(x + w e_k) − function(x))/w for each k."""
        base, columns = function(list(x)), []
        for k, v in enumerate(x):
            size = f"abs({beside[k]}) + abs({v})" if beside else f"abs({v})"
            width = e.let(f"{_SHIFT!r} * (1.0 + {size})")
            shifted = [*x[:k], e.let(f"{v} + {width}"), *x[k + 1 :]]
            columns.append(
                [e.let(f"({a} - {b}) / {width}") for a, b in zip(function(shifted), base, strict=True)]
            )
        return columns

    def _skew(self, e: Text, upper: list[str]) -> Table:
        d = self.dimension
        places = [(i, j) for i in range(d) for j in range(i + 1, d)]
        return skew(d, dict(zip(places, upper, strict=True)), e)

    def _transposed(self, columns: list[list[str]]) -> Table:
        return [[column[i] for column in columns] for i in range(self.dimension)]


class _Translator:
    """Sources of functions and of what they use."""

    def __init__(self) -> None:
        self.head: dict[str, str] = {}
        self.bodies: list[str] = []
        self.known: dict[Any, str] = {}

    def text(self) -> str:
        """The preamble of a module."""
        inline = 'njit(error_model="numpy", forceinline=True)'
        return "\n".join([*self.head.values(), *(f"\n\n@{inline}\n{body}" for body in self.bodies)]) + "\n"

    def add(self, function: Any, name: str) -> None:
        """The function under this name, after everything it uses."""
        tree = _definition(function)
        code = function.__code__
        outside = inspect.getclosurevars(function)
        used = {**outside.globals, **outside.nonlocals}
        renamed = {key: self._place(value, key, name) for key, value in used.items()}
        unknown = outside.unbound - set(code.co_names)
        if unknown or function.__defaults__ or function.__kwdefaults__:
            raise CannotTranslate(f"{function.__qualname__} has unbound names or default arguments")
        tree.name, tree.decorator_list, tree.returns = name, [], None
        for argument in tree.args.args:
            argument.annotation = None
        for node in ast.walk(tree):
            if isinstance(node, ast.Name) and node.id in renamed:
                node.id = renamed[node.id]
        self.known[function] = name
        self.bodies.append(ast.unparse(tree))

    def _place(self, value: Any, key: str, owner: str) -> str:
        called = getattr(value, "__name__", "")
        name = f"{owner}_{key}"
        if isinstance(value, (bool, int, float, np.floating, np.integer)) and math.isfinite(value):
            self.head[name] = f"{name} = {value.item() if isinstance(value, np.generic) else value!r}"
        elif isinstance(value, ModuleType) and called in ("math", "numpy"):
            self.head[name] = f"import {called} as {name}"
        elif getattr(math, called, None) is value:
            self.head[name] = f"from math import {called} as {name}"
        elif isinstance(value, np.ufunc) and getattr(np, called, None) is value:
            self.head[name] = f"from numpy import {called} as {name}"
        elif isinstance(value, FunctionType):
            if value not in self.known:
                self.add(value, name)
            return self.known[value]
        elif getattr(builtins, key, None) is value:
            return key
        else:
            raise CannotTranslate(
                f"{owner} uses {key}, a {type(value).__name__}: use numbers and functions only"
            )
        return name


def _definition(function: Any) -> ast.FunctionDef:
    name = getattr(function, "__qualname__", repr(function))
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    except (OSError, TypeError, SyntaxError) as error:
        raise CannotTranslate(f"{name}: its source cannot be read; write it as a def in a file") from error
    if len(tree.body) != 1 or not isinstance(tree.body[0], ast.FunctionDef):
        raise CannotTranslate(f"{name} is not a plain def; write it as a def in a file")
    return tree.body[0]


def _compare(problem: Problem, scalar: ScalarFunctions) -> None:
    """The scalar functions against those of arrays, at states near the initial one."""
    d = problem.dimension
    if problem.initial is None:
        raise CannotTranslate(
            f"{problem.name} has no initial state at which its scalar functions can be checked"
        )
    if problem.domain is not None and scalar.domain is None:
        raise CannotTranslate(f"{problem.name} has a domain, and no scalar function for it")
    upper = np.triu_indices(d, 1)
    y0 = np.asarray(problem.initial, dtype=np.float64)
    for n in range(4):
        y = y0 * (1 + 2.0**-6 * n) + (2.0**-7 * n if problem.domain is None else 0.0)
        pairs = [
            ("hamiltonian", scalar.hamiltonian(*y), problem.hamiltonian(y)),
            ("gradient", scalar.gradient(*y), problem.gradient(y)),
            ("structure", scalar.structure(*y), problem.structure(y)[upper]),
        ]
        if scalar.mean_gradient is not None:
            end = y * (1 + 2.0**-4) + (2.0**-6 if problem.domain is None else 0.0)
            mean = scalar.mean_gradient(*y, *end)
            check_mean_gradient("scalar.mean_gradient", problem, y, end, mean)
            if problem.mean_gradient is not None:
                pairs.append(("mean_gradient", mean, problem.mean_gradient(y, end)))
        for name, mine, theirs in pairs:
            a, b = np.asarray(mine, dtype=np.float64), np.asarray(theirs, dtype=np.float64)
            # Both are the same formula, written twice: they differ by a few roundings of its terms.
            if a.shape != b.shape or not np.allclose(
                a, b, rtol=1e-10, atol=1e-10 * (1 + np.abs(b).max(initial=0))
            ):
                raise ProblemError(
                    expected=f"scalar.{name} to be the problem's {name}: {b.tolist()} at y = {y.tolist()}",
                    received=f"{a.tolist()}",
                    remedy="correct one of them; B above the diagonal is written row by row",
                )
