"""Code of Newton's iteration for a block of lanes (paths) in lockstep.

A lane is done if its correction leaves an error below rounding. Newton's corrections shrink
quadratically: after two of sizes m_before and m the next is about m³/m_before², or m times the
relative error of Newton's matrix if this is larger. If a lane is not done after a few steps,
overflows or leaves the domain, `sepv.core` solves its step again from the start, makes all tests
and sets the status (`sepv.simulate._compiled.block_run`).

If H is quadratic and B linear, the equation of (2.1) and of the midpoint rule is z = Δ P(ȳ) with
ȳ = y + z/2 and short polynomials P. At first the unknown is then ȳ. Products of ½Δ and
coefficients are computed once, so a sweep ȳ ← y + ½Δ P(ȳ) costs a product and a sum for each term
of P, as Newton's matrix 1 − ½Δ P′(ȳ) does for each term of P′. The result is rounded at the size
of y. Later steps compute R as in the formula, with roundings of B∇H, not of P.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from sepv.core.newton import STOP_ERROR
from sepv.record import Polynomial
from sepv.record import polynomial_gradient as slopes_of
from sepv.simulate._compiled.code_builder import CodeBuilder, Expression, Table, shown
from sepv.simulate._compiled.layout import GROUP
from sepv.simulate._compiled.linear import contraction, correct
from sepv.simulate._compiled.recorded import RecordedProblem
from sepv.simulate._compiled.schemes import Formula, middle, scaled_field
from sepv.simulate._compiled.writer import Writer

# Numbers of sweeps z ← Δ f(ȳ) before Newton's iteration. For H at most quadratic they solve the
# equation itself: four have an error O(Δ⁵) and the cost of a Newton step, whose error is O(Δ³). For
# other H two have error O(Δ³). Sweeps of ȳ cost less: in the rigid body the fifth saves 1/10 of the
# time at h = 0.03 (in groups), and costs 1/50 at h = 0.002.
QUADRATIC_SWEEPS, MIDDLE_SWEEPS, ROUGH_SWEEPS = 4, 5, 2
# Newton steps in registers, for up to LARGE_UNKNOWNS unknowns; only the last is tested. With
# compensated summation there are one or two more, because a correction below half a rounding of z
# is lost when it is applied. The error that remains has a mean of 1e-4 roundings in a step of the
# path, and a tenth of this after each further Newton step.
FIRST_STEPS = 2
LARGE_UNKNOWNS = 6
# The most Newton steps of a group of lanes; `sepv.core` solves the lanes that are not done after
# them.
MORE_ITERATIONS = 8


class NewtonWriter(Writer):
    """Writer of the kernel of an implicit scheme, with the equation z = R(z) for the increment
    z.
    """

    def __init__(
        self, problem: RecordedProblem, formula: Formula, noises: int, lanes: int, compensated: bool
    ) -> None:
        super().__init__(problem, formula, noises, lanes, compensated)
        small = self.unknowns <= LARGE_UNKNOWNS
        exact = 0 < problem.degree <= 2
        self.sweeps = (QUADRATIC_SWEEPS if exact else ROUGH_SWEEPS) if small else 0
        self.steps = FIRST_STEPS + (compensated and (1 if exact else 2)) if small else 0
        multiplied_out = small and self.known == ["delta"] and not self.has_domain()
        self.P = problem.of_middle(formula.recorded) if multiplied_out else None
        self.sweeps = self.sweeps if self.P is None else MIDDLE_SWEEPS

    kernel = "iterated"

    def pieces(self) -> dict[str, tuple[list[str], str]]:
        """The kernel's code by name: the first Newton steps, for all lanes, and one more,
        for a group of lanes.
        """
        first = self.side_by_side([*self.random_step(), *self.first_steps()])
        return {"first_steps": (first, "left"), "iteration": (self.iteration(), "left")}

    def numbers(self) -> dict[str, Any]:
        """Constants of the kernel: how many lanes run together, and numbers of sweeps and steps."""
        together = self.lanes // 2 if self.lanes >= 2 * GROUP else self.lanes
        return {
            "FIRST_PASSES": together,
            "FIRST_ITERATIONS": self.sweeps + self.steps,
            "MORE_ITERATIONS": MORE_ITERATIONS,
        }

    def side_by_side(self, lines: list[str]) -> list[str]:
        """Interleave the code of two lanes (paths), one from each half of the block.

        A step is a chain of operations that wait for each other, so two chains take little longer
        than one.
        """
        if self.lanes < 2 * GROUP:
            return lines
        own = {"k", *(line.split(" = ")[0] for line in lines)}
        other = [
            re.sub(r"\b[A-Za-z_]\w*", lambda name: f"{name[0]}_" if name[0] in own else name[0], line)
            for line in lines
        ]
        both = [line for pair in zip(lines, other, strict=True) for line in pair]
        return [f"k_ = k + {self.lanes // 2}", *both]

    def first_steps(self) -> list[str]:
        """Code of the first sweeps and Newton steps; only the last step is tested:
        a test costs a third of a step.

        If a lane's sweeps do not contract, its last correction gets the size ∞, and the lane
        restarts from z = 0.
        """
        code = CodeBuilder(self.parameters)
        y = self.loaded(code, "Y", "y")
        code.lines += ["busy = I[ALIVE + k] != 0", self.scale(y)]
        z = self.in_increments(code, y) if self.P is None else self.in_middles(code, y)
        code.lines += self.test(compared=True) if self.steps else ["m = INF", "still = busy"]
        if self.sweeps:
            code.lines += ["still = still | busy & not_(contracts)", "m = select(contracts, m, INF)"]
        code.lines += [f"{self.at('Z', i)} = {v}" for i, v in enumerate(z)]
        code.lines += [
            f"{self.at('P')} = m",
            "left += select(still, 1, 0)",
            "I[BUSY + k] = select(still, 1, 0)",
        ]
        return code.lines

    def in_increments(self, code: CodeBuilder, y: list[str]) -> list[str]:
        """Code of z by sweeps, then Newton steps; its variables `before` and m are the last two
        corrections' sizes.
        """
        z = ["0.0"] * self.unknowns
        for _ in range(self.sweeps):
            z = [shown(v) for v in self.swept(code, y, z)]
        if self.sweeps:
            z = self.kept_inside(code, y, z)
            code.lines.append(contraction(code, self.system(code, y, z)[1]))
        inverse = None
        for step in range(self.steps):
            code.lines += ["before = m"] if step else []
            z, inverse = correct(code, *self.system(code, y, z), z, inverse)
            z = self.kept_inside(code, y, z)
        return z

    def in_middles(self, code: CodeBuilder, y: list[str]) -> list[str]:
        """Code of z: sweeps and a Newton step for ȳ = y + z/2 (`_approach`),
        then Newton steps for z = 2(ȳ − y).
        """
        assert self.P is not None
        states, inverse = _approach(code, self.P, y, self.sweeps)
        z = [code.let(f"2.0 * {v}") for v in (code.let(f"{a} - {b}") for a, b in zip(states, y, strict=True))]
        for _ in range(self.steps - 1):
            code.lines.append("before = m")
            z, inverse = correct(code, *self.system(code, y, z, states), z, inverse)
            states = []
        return z

    def swept(self, code: CodeBuilder, y: list[str], z: list[str]) -> list[Expression]:
        """Code of a sweep's new z: Δ f(ȳ) with f = B∇H if the scheme uses only the random step Δ,
        else R(z).
        """
        if self.known == ["delta"]:
            return scaled_field(code, self.problem, middle(code, y, z), "delta")
        return self.problem.increment(code, self.formula.recorded, y, z, self.known)

    def kept_inside(self, code: CodeBuilder, y: list[str], z: list[str]) -> list[str]:
        """Code of the increment z, or NaN if its end state is outside the domain,
        so that the lane is never done.
        """
        if not self.has_domain():
            return z
        code.lines.append(f"inside = {self.inside(code, y, z)}")
        return [code.let(f"select({self.inside(code, y, z)}, {v}, NAN)") for v in z]

    def test(self, compared: bool) -> list[str]:
        """Test that the correction of size m, once applied, leaves an error below rounding.

        If the size of the correction before is below FIRST_CORRECTION, FIRST_CORRECTION is used
        instead, because m may be mere rounding. If a Newton step makes a relative error e to C e²,
        the error left is then C³·2⁻¹²⁴, below STOP_ERROR for every C up to 2²⁰. `compared` is True
        if there surely was a correction before; if that had infinite size, m would be NaN.
        """
        later = [] if compared else ["later = (before < INF) | (m <= FIRST_CORRECTION * scale)"]
        others = ["next", "near", *["later"] * (not compared), *["inside"] * self.has_domain()]
        return [
            *later,
            "far = select(before > FIRST_CORRECTION * scale, before, FIRST_CORRECTION * scale)",
            "next = m * m * m <= STOP_ERROR * scale * (far * far)",
            f"near = m <= {STOP_ERROR / self.problem.convergence_rate!r} * scale",
            f"still = busy & not_({' & '.join(others)})",
        ]

    def system(
        self, code: CodeBuilder, y: list[str], z: list[str], states: Sequence[str] = ()
    ) -> tuple[list[Expression], Table]:
        """Code of the residual F = z − R and Newton's matrix 1 − K, K = ∂R/∂z;
        `states` is ȳ if already known.
        """
        formula = self.formula.recorded
        if self.P is None:
            return self.problem.equation(code, formula, y, z, self.known)
        states = states or middle(code, y, z)
        return self.problem.residual(code, formula, y, z, self.known, states), _matrix(code, self.P, states)

    def iteration(self) -> list[str]:
        """Code of a Newton step and its test; a lane (path) that fails stays busy,
        until `sepv.core` takes it over.
        """
        n = self.unknowns
        code = CodeBuilder(self.parameters)
        code.lines += self.random_step()
        y, z = self.loaded(code, "Y", "y"), [f"z{i}" for i in range(n)]
        code.lines.append(f"before = {self.at('P')}")
        code.lines += [f"{v} = select(before < INF, {self.at('Z', i)}, 0.0)" for i, v in enumerate(z)]
        moved = self.kept_inside(code, y, correct(code, *self.system(code, y, z), z)[0])
        code.lines += [
            "busy = I[BUSY + k] != 0",
            self.scale(y),
            f"{self.at('P')} = m",
            *self.test(compared=False),
        ]
        code.lines += [f"{self.at('Z', i)} = select(busy, {moved[i]}, {self.at('Z', i)})" for i in range(n)]
        code.lines += ["left += select(still, 1, 0)", "I[BUSY + k] = select(still, 1, 0)"]
        return code.lines

    def inside(self, code: CodeBuilder, y: list[str], z: list[str]) -> str:
        """Code of the test that all states of a step with the unknowns z are in the domain."""
        found = [self.problem.domain(code, state) for state in self.formula.states(code, y, z)]
        return " & ".join(f"({f})" for f in found)


def _approach(
    code: CodeBuilder, P: Sequence[Polynomial], y: Sequence[str], sweeps: int
) -> tuple[list[str], str | None]:
    """Write code for ȳ = y + ½Δ P(ȳ): sweeps, a Newton step (m: its size in z); return ȳ,
    1/det(1 − ½ΔP′) or None.
    """
    middle = list(y)
    for _ in range(sweeps):
        middle = _swept(code, P, y, middle)
    A = _matrix(code, P, middle)
    code.lines.append(contraction(code, A))
    F = [code.let(f"{a} - {b}") for a, b in zip(middle, _swept(code, P, y, middle), strict=True)]
    middle, inverse = correct(code, F, A, middle)
    code.lines.append("m = m + m")
    return middle, inverse


def _matrix(code: CodeBuilder, P: Sequence[Polynomial], middle: Sequence[str]) -> Table:
    """Code of Newton's matrix 1 − ½Δ P′(ȳ), where the polynomials P are B∇H."""
    half = code.let("0.5 * delta")
    return [
        [
            code.polynomial(slope, middle, "(-1.0)", half, value="(1.0)" if i == j else None)
            for j, slope in enumerate(slopes_of(p))
        ]
        for i, p in enumerate(P)
    ]


def _swept(code: CodeBuilder, P: Sequence[Polynomial], y: Sequence[str], middle: Sequence[str]) -> list[str]:
    """Code of the sweep ȳ ← y + ½Δ P(ȳ), where the polynomials P are B∇H."""
    half = code.let("0.5 * delta")
    return [shown(code.polynomial(p, middle, half, value=start)) for p, start in zip(P, y, strict=True)]
