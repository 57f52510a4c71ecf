"""Code of the projected schemes (`sepv.schemes.projected`): explicit increments,
projected to keep the invariants.
"""

from __future__ import annotations

from typing import Any

from sepv.simulate._compiled.code_builder import CodeBuilder, Expression, shown
from sepv.simulate._compiled.linear import magnitude
from sepv.simulate._compiled.newton import MORE_ITERATIONS
from sepv.simulate._compiled.writer import Writer

# The number of iterations in registers up to the first test; a step of usual length needs two.
PROJECTED_BLIND = 2


class ProjectedWriter(Writer):
    """Writer of the compiled kernel of an explicit method with projection on the invariants."""

    def more_rows(self) -> dict[str, int]:
        """Rows of the scratch buffer for the directions of the projection."""
        return {"Q": len(self.problem.directions[0])}

    kernel = "iterated"

    def pieces(self) -> dict[str, tuple[list[str], str]]:
        """The kernel's code by name: the explicit step with a projection's first iterations,
        and one more iteration.
        """
        return {
            "first_steps": ([*self.random_step(), *self.first()], "left"),
            "iteration": (self.iteration(), "left"),
        }

    def numbers(self) -> dict[str, Any]:
        """Constants of the kernel: numbers of evaluations, and of iterations of the projection."""
        gradients, structures = self.problem.cost(self.formula.recorded, self.known)
        averages = self.problem.gradient_evaluations
        return {
            "AVERAGES": averages, "FIRST_GRADIENTS": gradients + 1 + PROJECTED_BLIND * averages,
            "FIRST_STRUCTURES": structures + 1, "FIRST_ITERATIONS": PROJECTED_BLIND, "MORE_ITERATIONS": MORE_ITERATIONS,
        }  # fmt: skip

    def first(self) -> list[str]:
        """Code of the explicit increment z*, of the projection's directions at y + z*,
        and of its first iterations.
        """
        code = CodeBuilder(self.parameters)
        y = self.loaded(code, "Y", "y")
        z = [shown(r) for r in self.problem.increment(code, self.formula.recorded, y, [], self.known)]
        end = [code.let(f"{a} + {b}") for a, b in zip(y, z, strict=True)]
        found = self.problem.printed_directions(code, end)
        code.lines += [
            "busy = I[ALIVE + k] != 0",
            self.scale(y),
            "before = INF",
        ]
        for step in range(PROJECTED_BLIND):
            code.lines += ["before = m"] if step else []
            z = self.moved(code, y, z, found)
        code.lines += [f"{self.at('Z', i)} = {v}" for i, v in enumerate(z)]
        code.lines.append(f"{self.at('P')} = m")
        code.lines += [f"{self.at('Q', i)} = {v}" for i, v in enumerate(found) if v is not None]
        end = self.ending(code, y, z, "0")
        return [*code.lines, *end]

    def iteration(self) -> list[str]:
        """Code of one more iteration of the projection, in the busy lanes (paths) of a group."""
        code = CodeBuilder(self.parameters)
        y, z = self.loaded(code, "Y", "y"), self.loaded(code, "Z", "z")
        code.lines += ["busy = I[BUSY + k] == 1", self.scale(y), f"before = {self.at('P')}"]
        # Components of the directions that are always zero are not stored.
        found = self.problem.printed_directions(CodeBuilder(), y)
        moved = self.moved(code, y, z, [v and self.at("Q", i) for i, v in enumerate(found)])
        code.lines += [f"{self.at('P')} = m"]
        code.lines += [
            f"{self.at('Z', i)} = select(busy, {a}, {b})"
            for i, (a, b) in enumerate(zip(moved, z, strict=True))
        ]
        end = self.ending(code, y, moved, "I[BUSY + k]")
        return [*code.lines, *end]

    def moved(self, code: CodeBuilder, y: list[str], z: list[str], found: list[Expression]) -> list[str]:
        """Code of z minus the projection's correction along directions `found`;
        m in it is the correction's size.
        """
        c = [shown(v) for v in self.problem.moved_back(code, y, z, found)]
        code.lines.append(magnitude(c))
        return [code.let(f"{a} - {b}") for a, b in zip(z, c, strict=True)]

    def ending(self, code: CodeBuilder, y: list[str], z: list[str], otherwise: str) -> list[str]:
        """Code that sets BUSY: in busy lanes to 0 if done and in the domain, else to 1;
        in others to `otherwise`.
        """
        inside = self.problem.domain(code, [code.let(f"{a} + {b}") for a, b in zip(y, z, strict=True)])
        return [
            "later = (m * m <= STOP_ERROR * (scale * before)) & (before < INF)",
            "stays = (m >= 0.5 * before) & (m <= ROUNDING * scale)",
            f"done = later | stays | (m <= {self.d} * NEGLIGIBLE_CORRECTION * scale)",
            f"still = busy & not_(done{f' & ({inside})' if inside else ''})",
            "left += select(still, 1, 0)",
            f"I[BUSY + k] = select(busy, select(still, 1, 0), {otherwise})",
        ]
