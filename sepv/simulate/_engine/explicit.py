"""Explicit steps: the increment itself, and whether it leads anywhere."""

from __future__ import annotations

from sepv.simulate._engine.code_builder import CodeBuilder, shown
from sepv.simulate._engine.writer import Writer


class ExplicitWriter(Writer):
    """The kernel of an explicit scheme."""

    kernel = "common.explicit"

    def pieces(self) -> dict[str, tuple[list[str], str]]:
        """The increment itself, and whether it leads anywhere."""
        code = CodeBuilder(self.parameters)
        y = self.loaded(code, "Y", "y")
        z = [shown(v) for v in self.problem.increment(code, self.formula.recorded, y, [], self.known)]
        code.lines += [f"{self.at('Z', i)} = {v}" for i, v in enumerate(z)]
        there = [code.let(f"{a} + {b}") for a, b in zip(y, z, strict=True)]
        code.lines.append(f"finite = ({' + '.join(f'abs({v})' for v in there)}) < INF")
        inside = self.problem.domain(code, there)
        code.lines += [
            f"status = select(finite, {f'select({inside}, 0, LEFT_DOMAIN)' if inside else 0}, BROKEN)",
            "failed = (I[ALIVE + k] != 0) & (status != 0)",
            "I[STATUS + k] = select(failed, status, I[STATUS + k])",
            "trouble += select(failed, 1, 0)",
        ]
        return {"first_steps": ([*self.random_step(), *code.lines], "trouble")}
