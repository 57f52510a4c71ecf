"""One step of a scheme to any number of digits (`reference_step`),
with the condition of the step's equation.

The equations are in `sepv.reference.equations`, the solver in `sepv.reference.solve`. A value is
proved by `sepv.reference.certify`, not here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite
from typing import Any, NamedTuple

from sepv.reference.arithmetic import Matrix, Vector, total
from sepv.reference.branch import BranchEnd, follow
from sepv.reference.equations import EQUATIONS, FEWEST_NODES, Equation, Step, collocation, make_step
from sepv.reference.problem import Description, ExactProblem, binary64_problem, exact_problem
from sepv.reference.solve import FLOAT_ERRORS, CertifiedRoot, Failure, largest, newton, refine

from sepv.errors import StepFailure, UsageError
from sepv.problem import GivenProblem

# Guard digits: three for the conversion and the sums, the rest for the condition of the equation.
GUARD_DIGITS = 15
MOST_DIGITS = 2000
# Numbers of quadrature nodes for methods with stages if H is not a polynomial, tried until two
# results agree.
_TRIED_NODES = (FEWEST_NODES, 36, 54, 81, 122, 183, 275)


class ReferenceStep(NamedTuple):
    """A reference step and the condition of its equation.

    Attributes
    ----------
    y1 : d numbers of mpmath
    condition : (d, d) floats
        The entries |∂y1/∂residual|, the factors from residuals to errors of y1: |(I − ∂R/∂y1)⁻¹|
        for a method without stages, a sum over the stages for a method with stages, the identity
        for an explicit method.
    x : numbers of mpmath
        The unknowns of the equation: y1 itself, the stages' increments, or none for an explicit
        method.
    equation : Equation
    """

    y1: Vector
    condition: list[list[float]]
    x: Vector
    equation: Equation


def find_equation(scheme: str) -> Equation:
    """The equation of a scheme by its name. An unknown name raises UsageError."""
    equation = EQUATIONS.get(scheme.replace("_", "-"))
    if equation is None:
        raise UsageError(
            expected=f"a scheme that the references know: {', '.join(EQUATIONS)}",
            received=repr(scheme),
            remedy="correct the name",
        )
    return equation


def require_digits(digits: int) -> None:
    """Raise UsageError for a number of digits out of range."""
    if not isinstance(digits, int) or isinstance(digits, bool) or not 1 <= digits <= MOST_DIGITS:
        raise UsageError(
            expected=f"digits, an integer between 1 and {MOST_DIGITS}",
            received=repr(digits),
            remedy="50 are the digits of the vectors; each further digit only costs time",
        )


def step_condition(
    scheme: str | Equation, data: Any, y: Sequence[float], h: float, dW: Sequence[float], contraction: float
) -> list[list[float]]:
    """The matrix |(I − ∂R/∂y1)⁻¹| at a step's solution,
    by which residuals r of y1 = y0 + R become errors of y1.

    A problem made of Python functions has no reference solution: all entries are 1/(1 − κ). Steps
    are drawn such that R contracts by the factor κ = `contraction` in the maximum norm, so errors
    are at most Σ_i r_i/(1 − κ).
    """
    if isinstance(data, GivenProblem):
        return [[1 / (1 - contraction)] * len(y)] * len(y)
    equation = find_equation(scheme) if isinstance(scheme, str) else scheme
    problem = binary64_problem(data)
    scale = max(map(abs, y), default=0.0)
    if equation.residual is not None and not equation.nodes and scale and all(map(isfinite, (*y, h, *dW))):
        # The inverse matrix is taken from the root in binary64, even if the root itself needs more
        # digits.
        root = _guess(equation, data, y, h, dW, scale, None)
        y0, step = problem.state(y), make_step(problem, h, dW)
        if isinstance(root, CertifiedRoot) and problem.inside(equation.result(problem, y0, step, root.x)):
            return _condition(equation, problem, root.inverse)
    return reference_step(equation, data, y, h, dW, 20).condition


def reference_step(
    scheme: str | Equation,
    data: Description,
    y: Sequence[float],
    h: float,
    dW: Sequence[float],
    digits: int = 50,
    start: Vector | None = None,
) -> ReferenceStep:
    """Solve one step from y to `digits` digits of the largest component.

    If the equation has several solutions, the result is the one that Newton's method finds from y,
    or from `start`. If Newton's method finds none, the result is the solution that is reached from
    y as the step grows from 0.

    Parameters
    ----------
    scheme : str or Equation
        A name of `EQUATIONS`, or any equation.
    y, h, dW : binary64 numbers
        Each is used without rounding.
    start : floats, optional
        The start of Newton's iteration for the unknowns of the equation.

    Raises
    ------
    UsageError
        If the scheme or problem is unknown, digits is out of range, or y, h, dW are not finite or
        have a wrong length.
    StepFailure
        If no solution was found; the message has the smallest residual.
    """
    if digits != 50:
        require_digits(digits)
    equation = find_equation(scheme) if isinstance(scheme, str) else scheme
    exact = exact_problem(data, digits + GUARD_DIGITS)
    if not all(map(isfinite, (*y, h, *dW))) or len(y) != exact.dimension or len(dW) != len(exact.noise):
        raise UsageError(
            expected=f"finite y ({exact.dimension},), h and dW ({len(exact.noise)},)",
            received=f"y = {list(y)}, h = {h!r}, dW = {list(dW)}",
            remedy="one number for each component, and one for each noise",
        )
    y0, step = exact.state(y), make_step(exact, h, dW)
    if not exact.inside(y0):
        raise UsageError(
            expected="a state in the domain of the problem",
            received=f"y = {list(y)}",
            remedy="start inside it",
        )
    if equation.blocks > 1 and exact.degree is None and not equation.nodes:
        equation = _with_nodes(equation, _TRIED_NODES[0])
    if equation.residual is None:
        return ReferenceStep(equation.result(exact, y0, step, []), _identity(len(y0)), [], equation)
    scale = largest(y0) or largest(exact.field(y0)) * abs(step.delta) or exact.number(1.0)
    root = _guess(equation, data, y, h, dW, float(scale), start)
    if isinstance(root, CertifiedRoot):
        root = refine(_bound(equation, exact, y0, step), root, scale, exact.ctx, digits + 5)
    if isinstance(root, Failure):
        root = _in_digits(equation, exact, y0, step, scale, digits, start)
    if isinstance(root, CertifiedRoot) and equation.nodes:
        equation, root = _enough_nodes(equation, exact, y0, step, scale, digits, root)
    if isinstance(root, CertifiedRoot) and not exact.inside(equation.result(exact, y0, step, root.x)):
        root = Failure(0.0, root.iterations, "only a solution outside the domain was found")
    if isinstance(root, Failure):
        # Newton's iteration from y failed or left the domain. The branch of solutions from y may
        # still have a solution.
        branch = None if start else _branch(equation, data, y, h, dW)
        if branch is not None and branch.whole:
            return reference_step(equation, data, y, h, dW, digits, branch.x)
        end = "" if branch is None else _where_it_ends(branch, float(step.delta))
        raise StepFailure(
            problem=getattr(data, "name", "given as polynomial data"),
            y=[float(v) for v in y],  # type: ignore[arg-type]  # printed only
            delta=float(step.delta),
            residual=root.residual,
            status=f"{root.reason} in extended precision{end}",
            iterations=root.iterations,
        )
    y1 = equation.result(exact, y0, step, root.x)
    return ReferenceStep(y1, _condition(equation, exact, root.inverse), root.x, equation)


def _branch(
    equation: Equation, data: Description, y: Sequence[float], h: float, dW: Sequence[float]
) -> BranchEnd | None:
    try:
        return follow(equation, data, y, h, dW)
    except FLOAT_ERRORS:
        return None


def _where_it_ends(branch: BranchEnd, delta: float) -> str:
    end = f"{branch.reached * delta:.10g}"
    return f" (the solutions that start at y end at Δ = {end}, at a fold or at the edge of the domain)"


def _bound(equation: Equation, problem: ExactProblem, y0: Vector, step: Step) -> Callable[[Vector], Vector]:
    residual = equation.residual
    assert residual is not None
    return lambda x: residual(problem, y0, step, x)


def _start(equation: Equation, problem: ExactProblem, y0: Vector, step: Step) -> Vector:
    """The first guess for Newton's method: K = 0 for stages;
    else the explicit midpoint rule if near y0, else y0.
    """
    if equation.of_increments:
        return [0 * v for v in y0] * equation.blocks
    half = [a + step.delta * b / 2 for a, b in zip(y0, problem.field(y0), strict=True)]
    try:
        predicted = [a + step.delta * b for a, b in zip(y0, problem.field(half), strict=True)]
    except FLOAT_ERRORS:
        return y0
    moved = largest([a - b for a, b in zip(predicted, y0, strict=True)])
    return predicted if moved < largest(y0) / 4 else y0


def _guess(
    equation: Equation,
    data: Description,
    y: Sequence[float],
    h: float,
    dW: Sequence[float],
    scale: float,
    start: Vector | None,
) -> CertifiedRoot | Failure:
    """The root in binary64, from which the search in mpmath starts;
    a Failure if binary64 cannot hold the root.
    """
    problem = binary64_problem(data)
    try:
        y0, step = problem.state(y), make_step(problem, h, dW)
        start = start or _start(equation, problem, y0, step)
        return newton(_bound(equation, problem, y0, step), start, scale, problem.arithmetic, 1e-13)
    except FLOAT_ERRORS as error:
        return Failure(float("inf"), 0, str(error))


def _in_digits(
    equation: Equation,
    exact: ExactProblem,
    y0: Vector,
    step: Step,
    scale: Any,
    digits: int,
    start: Vector | None,
) -> CertifiedRoot | Failure:
    """The root of the equation by mpmath alone, for a root beyond the exponents of binary64."""
    residual = _bound(equation, exact, y0, step)
    try:
        first = [exact.ctx.mpf(v) for v in start] if start else _start(equation, exact, y0, step)
        root = newton(residual, first, scale, exact.arithmetic, 1e-14)
        return (
            refine(residual, root, scale, exact.ctx, digits + 5) if isinstance(root, CertifiedRoot) else root
        )
    except FLOAT_ERRORS as error:
        return Failure(float("inf"), 0, str(error))


def _with_nodes(equation: Equation, nodes: int) -> Equation:
    """The equation with this number of quadrature nodes, or unchanged if it has no quadrature."""
    return collocation(equation.blocks, nodes) if equation.name.startswith("collocation") else equation


def _enough_nodes(
    equation: Equation,
    exact: ExactProblem,
    y0: Vector,
    step: Step,
    scale: Any,
    digits: int,
    root: CertifiedRoot,
) -> tuple[Equation, CertifiedRoot | Failure]:
    """Add quadrature nodes until two rules give the same root;
    return the equation with the last rule, and its root.
    """
    goal = scale * exact.ctx.mpf(10) ** (-digits - 3)
    for nodes in _TRIED_NODES[1:]:
        finer = _with_nodes(equation, nodes)
        better = refine(_bound(finer, exact, y0, step), root, scale, exact.ctx, digits + 5)
        if isinstance(better, Failure):
            return finer, better
        if largest([a - b for a, b in zip(better.x, root.x, strict=True)]) <= goal:
            return finer, better
        root = better
    return equation, Failure(float("nan"), len(_TRIED_NODES), "the quadrature of ∇H does not settle")


def _identity(d: int) -> list[list[float]]:
    return [[float(i == j) for j in range(d)] for i in range(d)]


def _condition(equation: Equation, problem: ExactProblem, inverse: Matrix) -> list[list[float]]:
    if equation.blocks == 1:
        return [[abs(float(v)) for v in row] for row in inverse]
    d, s = problem.dimension, equation.blocks
    zero = [problem.number(0.0)] * d
    # y1 is linear in the stages: its result for y0 = 0 is Σ b_i K_i.
    step = Step(zero[0], zero[0], zero[0])
    columns = [equation.result(problem, zero, step, list(column)) for column in zip(*inverse, strict=True)]
    return [[total(abs(float(columns[j * d + l][k])) for j in range(s)) for l in range(d)] for k in range(d)]
