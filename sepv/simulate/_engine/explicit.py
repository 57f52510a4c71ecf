"""Explicit steps: the increment itself, and whether it leads anywhere."""

from __future__ import annotations

from sepv.simulate._engine.text import Text, shown
from sepv.simulate._engine.writer import Writer


class ExplicitWriter(Writer):
    """The kernel of an explicit scheme."""

    kernel = "common.explicit"

    def pieces(self) -> dict[str, tuple[list[str], str]]:
        """The increment itself, and whether it leads anywhere."""
        e = Text(self.parameters)
        y = self.loaded(e, "Y", "y")
        z = [shown(v) for v in self.problem.increment(e, self.formula.recorded, y, [], self.known)]
        e.lines += [f"{self.at('Z', i)} = {v}" for i, v in enumerate(z)]
        there = [e.let(f"{a} + {b}") for a, b in zip(y, z, strict=True)]
        e.lines.append(f"finite = ({' + '.join(f'abs({v})' for v in there)}) < INF")
        inside = self.problem.domain(e, there)
        e.lines += [
            f"code = pick(finite, {f'pick({inside}, 0, LEFT_DOMAIN)' if inside else 0}, BROKEN)",
            "failed = (I[ALIVE + k] != 0) & (code != 0)",
            "I[STATUS + k] = pick(failed, code, I[STATUS + k])",
            "trouble += pick(failed, 1, 0)",
        ]
        return {"first_steps": ([*self.random_step(), *e.lines], "trouble")}
