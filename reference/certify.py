"""Certificates: a proof, by ball arithmetic, that the equation of a step has exactly one solution
near a reference.

Krawczyk's operator of F on the box X = x̃ + [−r, r]ⁿ is

    K(X) = x̃ − Y F(x̃) + (I − Y F′(X))(X − x̃),   Y ≈ F′(x̃)⁻¹.

If K(X) lies in the interior of X, then F has exactly one zero in X, and it lies in K(X) (Neumaier,
*Interval Methods for Systems of Equations*, Theorem 5.1.8). K(X) is evaluated in balls, so that the
proof covers rounding. The function F is the residual of `sepv.reference.equations`, unchanged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sepv.reference.arithmetic import Vector
from sepv.reference.balls import ball, from_mpf, precision, real_balls, require_flint
from sepv.reference.equations import Equation, Step, make_step
from sepv.reference.problem import Description, ExactProblem, in_arithmetic
from sepv.reference.quadrature import quadrature_error, with_more_nodes
from sepv.reference.steps import ReferenceStep

from sepv.errors import SepvError

BITS = 500
# The radius of the box X relative to the largest component; the files of reference vectors promise
# this radius.
BOX_RADIUS = 1e-46


class NotCertified(SepvError, ArithmeticError):
    """The proof of a reference step failed; the message names the unknown and its enclosures."""


@dataclass(frozen=True)
class Certificate:
    """The proved facts of one reference step. Numbers are balls of python-flint.

    Attributes
    ----------
    radius : ball
        The radius r: the equation has exactly one solution with every unknown within r of the
        reference.
    y1 : d balls
        Balls that contain the components of the solution.
    energy : ball
        H(y1) − H(y0).
    casimirs : balls
        C(y1) − C(y0) for each Casimir C, the quadratic ones first.
    contraction : ball
        The norm ‖I − Y F′(X)‖_∞ on the box X, which is below 1.
    """

    equation: Equation
    radius: Any
    y1: Vector
    energy: Any
    casimirs: Vector
    contraction: Any
    method: str

    def describe(self) -> str:
        """Describe the proof in words, with the enclosures of y1, H and the Casimirs."""
        lines = []
        if self.equation.residual is None:
            lines.append(f"{self.equation.name} is explicit: evaluated in balls, rounding and all,")
        else:
            lines += [
                f"F(x) = 0 is the equation of {self.equation.name}, {self.equation.source}. {self.method}:",
                f"  on the box X of all x within {self.radius.str(3, radius=False)} of the reference,",
                f"  ‖I − Y F′(X)‖ ≤ {self.contraction.str(3, radius=False)} with Y ≈ F′(x)⁻¹,",
                "  and x − Y F(x) + (I − Y F′(X))(X − x) lies in the interior of X.",
                "So F has exactly one zero in X. There",
            ]
        lines += [f"  y{k + 1} is in {v.str(60)}" for k, v in enumerate(self.y1)]
        lines.append(f"  H(y1) − H(y0) is in {self.energy.str(3)}")
        lines += [f"  C{k + 1}(y1) − C{k + 1}(y0) is in {v.str(3)}" for k, v in enumerate(self.casimirs)]
        return "\n".join(lines)

    @property
    def width(self) -> float:
        """The width of the proof: the largest radius of the balls y1."""
        return max(float(b.rad()) for b in self.y1)


def certify(
    data: Description,
    y: Sequence[float],
    h: float,
    dW: Sequence[float],
    step: ReferenceStep,
    bits: int = BITS,
    radius: float = BOX_RADIUS,
) -> Certificate:
    """Prove that the equation of a step has exactly one solution near a reference step.

    Raises
    ------
    UsageError
        If python-flint is not installed.
    NotCertified
        If Krawczyk's operator does not map the box into its interior, or the centre x̃ is outside
        of the box.
    """
    with precision(bits):
        problem = in_arithmetic(data, real_balls(bits))
        y0, parts = problem.state(y), make_step(problem, h, tuple(dW))
        if step.equation.residual is None:
            y1, size, contraction = (
                step.equation.result(problem, y0, parts, []),
                from_mpf(step.y1[0]) * 0,
                y0[0] * 0,
            )
            method = "explicit: evaluated in balls"
        else:
            x, size, contraction = _krawczyk(problem, y0, parts, step, radius)
            y1, method = step.equation.result(problem, y0, parts, x), "Krawczyk's test"
            method += " with a bound of the quadrature's error" if step.equation.nodes else ""
        return Certificate(
            equation=step.equation,
            radius=size,
            y1=y1,
            energy=problem.hamiltonian(y1) - problem.hamiltonian(y0),
            casimirs=[
                b - a for a, b in zip(problem.casimir_values(y0), problem.casimir_values(y1), strict=True)
            ],
            contraction=contraction,
            method=method,
        )


def _krawczyk(
    problem: ExactProblem, y0: Vector, parts: Step, step: ReferenceStep, radius: float
) -> tuple[Vector, Any, Any]:
    """The enclosure K(K(…X)) of the solution, the radius r of uniqueness and the contraction ‖I
    − YF′(X)‖.

    Raises NotCertified if Krawczyk's test fails.
    """
    flint = require_flint()
    arb, matrix = flint.arb, flint.arb_mat
    reference = [from_mpf(v) for v in step.x]
    largest = max(abs(v).upper() for v in (*y0, *reference))
    n, size = len(reference), radius * (largest if largest > 0 else arb(1))
    equation = with_more_nodes(step.equation)
    error, error_slope = quadrature_error(problem, y0, parts, equation, reference)

    def residual(x: Vector) -> Vector:
        assert equation.residual is not None
        return equation.residual(problem, y0, parts, x)

    box = [v + ball(size) for v in reference]
    slopes = _jacobian(problem, residual, box) + matrix(n, n, [ball(error_slope)] * (n * n))
    try:
        Y = slopes.mid().inv().mid()
    except ZeroDivisionError as broken:
        raise NotCertified("The Jacobian at the reference is singular.") from broken
    defect = matrix(n, n, [int(i == j) for i in range(n) for j in range(n)]) - Y * slopes
    contraction = max((sum(map(abs, row), arb(0)).upper() for row in defect.tolist()), key=float)
    # One Newton step improves the centre of the box from the precision of the reference to that of
    # the balls.
    start = matrix([[v] for v in residual(reference)])
    centre = [(v - c).mid() for v, c in zip(reference, (Y * start).entries(), strict=True)]
    moved = (Y * matrix([[v + ball(error)] for v in residual(centre)])).entries()
    inner = krawczyk_image(defect, moved, centre, box)
    # The zero lies in K(X), so in K(K(X)), and so on. The images shrink by the contraction factor,
    # down to rounding.
    widest, least = max(v.rad() for v in inner), size * arb(2) ** -flint.ctx.prec
    while widest > least:
        inner = _image(defect, moved, centre, inner)
        width = max(v.rad() for v in inner)
        if not 2 * width < widest:
            break
        widest = width
    return inner, size, contraction


def krawczyk_image(defect: Any, moved: Vector, centre: Vector, box: Vector) -> Vector:
    """Return Krawczyk's image K(X) of a box X, after a check that x̃ lies in X and K(X)
    in the interior of X.

    The proof expands F about the centre x̃ by the mean value theorem; F′(X) encloses the slope
    between x̃ and any x in X. If x̃ is outside X, F′(X) need not contain that slope, and K(X) may
    lie in X though F has no zero in X.

    Parameters
    ----------
    defect : matrix of balls, I − Y F′(X)
    moved : balls, Y F(x̃)
    centre, box : balls, x̃ and X

    Raises
    ------
    NotCertified
        If x̃ is not in X, or K(X) not in the interior of X.
    """
    for k, (point, large) in enumerate(zip(centre, box, strict=True)):
        if not large.contains(point):
            raise NotCertified(
                f"Krawczyk's test fails in unknown {k + 1}: its centre {point.str(20)} is not in {large.str(20)}."
            )
    inner = _image(defect, moved, centre, box)
    for k, (small, large) in enumerate(zip(inner, box, strict=True)):
        if not (small.is_finite() and large.contains_interior(small)):
            raise NotCertified(
                f"Krawczyk's test fails in unknown {k + 1}: {large.str(20)} is mapped to {small.str(20)}."
            )
    return inner


def _image(defect: Any, moved: Vector, centre: Vector, X: Vector) -> Vector:
    """Krawczyk's operator K(X) = x̃ − Y F(x̃) + (I − Y F′(X))(X − x̃)."""
    tail = defect * type(defect)([[v - c] for v, c in zip(X, centre, strict=True)])
    return [c - a + b for c, a, b in zip(centre, moved, tail.entries(), strict=True)]


def _jacobian(problem: ExactProblem, residual: Any, x: Vector) -> Any:
    """The derivative F′(X) over the box X as a matrix of balls, computed column by column."""
    flint, arithmetic = require_flint(), problem.arithmetic
    columns = []
    for k in range(len(x)):
        nudged = [*x[:k], arithmetic.nudged(x[k], flint.arb(1)), *x[k + 1 :]]
        columns.append([arithmetic.slope(v) for v in residual(nudged)])
    return flint.arb_mat([list(row) for row in zip(*columns, strict=True)])
