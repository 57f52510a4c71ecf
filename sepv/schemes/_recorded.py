"""B, H and a scheme's formula recorded as operations on symbols,
and all derivatives derived from these operations.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from math import prod
from typing import Any, NamedTuple

from sepv.core.formula import Fields, Formula
from sepv.problem import Nambu, PolynomialSystem, Problem, combined, matvec
from sepv.record import (
    CannotRecord,
    Mean,
    NoClosedForm,
    Polynomial,
    Tape,
    degree,
    expand,
    gradient,
    jacobian,
    mean,
    poly,
    reachable,
    substitute,
)
from sepv.record import symbol_array as array


class RecordedEquation(NamedTuple):
    """The equation z = R of a step in symbols: R (d,), K = ∂R/∂z (d, d),
    and the numbers of the step (k,).

    `gradients` and `structures` count the evaluations of ∇H and of B in R.
    """

    R: Any
    K: Any
    step: Any
    gradients: int
    structures: int


class Recorded:
    """The functions of a problem in symbols of a state y (d,) and of z = y1 − y (d,).

    Raises CannotRecord if B, H or the domain cannot be recorded.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.dimension = d = problem.dimension
        self.tape = Tape()
        self.y, self.z = self.tape.vector(d), self.tape.vector(d)
        self.H = self._call("hamiltonian", self.y)
        self.slope = gradient(self.H, self.y)
        self.B = self.skew(self._call("structure", self.y))
        if self.B.shape != (d, d):
            raise CannotRecord(f"structure(y) has the shape {self.B.shape} for a single state")
        self.inside = None if problem.domain is None else self._call("domain", self.y)
        power = degree(self.H, self.y)
        self.degree = 0 if power is None else max(power, 1)
        self._equations: dict[tuple[Formula, bool], RecordedEquation] = {}

    def skew(self, B: Any) -> Any:
        """The matrix B (d, d) in symbols. For polynomial data the lower entries are the negatives
        of the upper ones.
        """
        if not isinstance(self.problem.data, PolynomialSystem):
            return self.tape.symbols(B)
        d, zero = self.dimension, self.tape.constant(0.0)
        upper = {(i, j): self.tape.symbol(B[i, j]) for i in range(d) for j in range(i + 1, d)}
        entries = (upper[i, j] if i < j else -upper.get((j, i), zero) for i in range(d) for j in range(d))
        return array(entries, (d, d))

    def _call(self, key: str, *arguments: Any) -> Any:
        """Call the problem's function `key` with symbols;
        any error becomes a CannotRecord that names the function.
        """
        try:
            return self.tape.symbols(getattr(self.problem, key)(*arguments))
        except CannotRecord as error:
            raise CannotRecord(f"{key}: {error}") from error
        except Exception as error:
            raise CannotRecord(f"{key}: {type(error).__name__} with symbols: {error}") from error

    @cached_property
    def mean(self) -> Mean:
        """The average ∫₀¹∇H(y + τz)dτ by the rules of `sepv.record`;
        by `Problem.mean_gradient` if no rule applies.
        """
        try:
            return mean(self.H, self.y, self.z)
        except NoClosedForm:
            if self.problem.mean_gradient is None:
                raise
            return Mean(self._call("mean_gradient", self.y, self.y + self.z), 1)

    @cached_property
    def noise_slopes(self) -> list[Any]:
        """The gradients ∇H_1, …, ∇H_m of the noise Hamiltonians in symbols;
        each is ∇H if there is only one H.
        """
        drift, *noises = self.problem.channels
        return [
            self.slope if F is drift else gradient(self.tape.symbol(F.hamiltonian(self.y)), self.y)
            for F in noises
        ]

    @cached_property
    def field(self) -> Sequence[Polynomial] | None:
        """The field B∇H multiplied out into polynomials; None if it is then longer,
        or no polynomial, or deg H > 2.
        """
        f = [
            sum((b * g for b, g in zip(row, self.slope, strict=True)), self.tape.constant(0.0))
            for row in self.B
        ]
        sums = expand(f, self.y, len(reachable(f))) if self.degree <= 2 else None
        return None if sums is None else [poly.polynomial(self.dimension, terms) for terms in sums]

    def equation_of(self, formula: Formula, count: int, apart: bool = True) -> RecordedEquation:
        """The equation z = R of a scheme's formula that uses `count` numbers of a step.

        If `apart` is False, as for explicit steps, B∇H is multiplied out wherever the product is
        shorter.

        Raises CannotRecord or NoClosedForm if the formula cannot be recorded.
        """
        if (formula, apart) not in self._equations:
            step, fields = self.tape.vector(count), _RecordedFields(self, apart)
            try:
                R = self.tape.symbols(formula(fields, self.y, self.z, step))
            except (CannotRecord, NoClosedForm):
                raise
            except Exception as error:
                raise CannotRecord(f"{type(error).__name__} with symbols: {error}") from error
            K = jacobian(R, self.z)
            self._equations[formula, apart] = RecordedEquation(
                R, K, step, fields.gradients, fields.structures
            )
        return self._equations[formula, apart]

    def system(self, formula: Formula, count: int) -> tuple[Any, Any]:
        """The residual F = z − R (d,) of a formula's equation,
        and the derivative A = 1 − ∂R/∂z of F, (d, d).
        """
        R, K, *_ = self.equation_of(formula, count)
        entries = [self.tape.symbol(float(i == j) - v) for i, row in enumerate(K) for j, v in enumerate(row)]
        return self.tape.symbols(self.z - R), array(entries, K.shape)

    @property
    def middle(self) -> Any:
        """The midpoint ȳ = y + z/2, (d,)."""
        return self.y + 0.5 * self.z

    def of_middle(self, formula: Formula) -> list[Polynomial] | None:
        """The polynomials P with R = Δ P(ȳ) for the midpoint ȳ,
        for a formula that uses the random step Δ alone.

        The result is None if there are no such polynomials, or if they are longer than R.
        """
        (R, _, step, *_), middle = self.equation_of(formula, 1), self.middle
        sums = expand(R, [*step, *middle], len(reachable(R, {x.index for x in middle})))
        if sums is None or any(exponents[0] != 1 for terms in sums for exponents in terms):
            return None
        return [poly.polynomial(self.dimension, {e[1:]: c for e, c in terms.items()}) for terms in sums]


class _RecordedFields(Fields):
    """The functions of a problem that a formula uses, computed on symbols,
    with counts of evaluations.
    """

    def __init__(self, recorded: Recorded, apart: bool) -> None:
        self._recorded, self.problem, self._apart = recorded, recorded.problem, apart
        self.gradients = self.structures = 0

    def structure(self, y: Any) -> Any:
        self.structures += 1
        return self._recorded.skew(self.problem.structure(y))

    def combined(self, y: Any, step: Any) -> Any:
        self.structures += 1
        return combined(self.problem, y, step)

    def gradient(self, y: Any) -> Any:
        self.gradients += 1
        return self._at(self._recorded.slope, y)

    def combined_gradient(self, y: Any, step: Any) -> Any:
        self.gradients += 1
        total = step[0] * self._at(self._recorded.slope, y)
        for part, slope in zip(step[1:], self._recorded.noise_slopes, strict=True):
            total = total + part * self._at(slope, y)
        return total

    def field(self, y: Any) -> Any:
        sums = None if self._apart else self._recorded.field
        if sums is None:
            return super().field(y)
        self.structures, self.gradients = self.structures + 1, self.gradients + 1
        terms = [[c * prod(v**k for v, k in zip(y, e, strict=True)) for e, c in p.terms] for p in sums]
        return array(self._recorded.tape.symbol(sum(t)) for t in terms)

    def derivative_along(self, y: Any, v: Any) -> Any:
        recorded = self._recorded
        return matvec(self._at(jacobian(matvec(recorded.B, recorded.slope), recorded.y), y), v)

    def hessian(self, y: Any) -> Any:
        """The second derivatives H″(y), (d, d)."""
        return self._at(jacobian(self._recorded.slope, self._recorded.y), y)

    def structure_along(self, y: Any, v: Any, times: int) -> Any:
        """The derivative number `times` of B at y in the direction v, (d, d)."""
        recorded, d = self._recorded, len(y)
        B = recorded.B.ravel()
        for _ in range(times):
            B = matvec(jacobian(B, recorded.y), recorded.z)
        return self._at(recorded.tape.symbols(B.reshape(d, d)), y, v)

    def mean_gradient(self, y: Any, z: Any) -> Any:
        """The recorded averaged gradient; if z is not the record's own z,
        the given y and z are substituted in it.
        """
        means, nodes = self._recorded.mean
        self.gradients += nodes
        return means if z is self._recorded.z else self._at(means, y, z)

    def edge_means(self, starts: Any, z: Any) -> Any:
        means, nodes = self._recorded.mean
        self.gradients += nodes * len(z)
        moves = [[z[i] if i == k else 0.0 for k in range(len(z))] for i in range(len(z))]
        return array(self._at(means[i : i + 1], starts[:, i], moves[i])[0] for i in range(len(z)))

    def factor(self, y: Any) -> Any:
        return self._nambu.factor(y)

    def mean_casimir_gradient(self, y: Any, z: Any) -> Any:
        try:
            means, nodes = mean(self._recorded.tape.symbol(self._nambu.casimir(y)), y, z)
        except NoClosedForm:
            if self._nambu.mean_gradient is None:
                raise
            means, nodes = self._nambu.mean_gradient(y, y + z), 1
        self.structures += nodes
        return means

    def _at(self, values: Any, y: Any, z: Any = ()) -> Any:
        """The symbols `values` with y and z in place of the record's own y and z."""
        recorded = self._recorded
        return substitute(values, [*recorded.y, *recorded.z[: len(z)]], [*y, *z])

    @property
    def _nambu(self) -> Nambu:
        assert self.problem.nambu is not None
        return self.problem.nambu
