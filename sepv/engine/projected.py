"""Code for explicit increments that are projected on the invariants: see `sepv.schemes.projected`.

The increment is computed once for each lane; the iterations that follow are those of the invariants alone.
"""

from __future__ import annotations

from sepv.engine.kernel import Writer, indent
from sepv.engine.text import Expression, Text, shown
from sepv.schemes.projected import DEPENDENT, MOST


class ProjectedWriter(Writer):
    """The kernel of a projected method."""

    def more_rows(self) -> dict[str, int]:
        """The explicit increment."""
        return {"V": self.d}

    def implicit(self) -> list[str]:
        """The increment, iterations for the groups that go on, and what is wrong with the lanes that are left.

        BUSY is 1 in a lane that goes on, 0 in one that is done, and 2 in one that ends outside the domain.
        """
        averages = self.problem.gradient_evaluations
        lines = ["for k in range(L):", *indent(1, [*self.random_step(), *self.first()])]
        lines += [f"I[EVALUATIONS] += {self.formula.gradients + 1} * I[LIVING]"]
        lines += [f"I[STRUCTURES] += {self.formula.structures} * I[LIVING]"]
        lines += ["left = I[LIVING]", f"for sweep in range({MOST}):", "    if left == 0:", "        break"]
        lines += ["    I[WORK] += left", f"    I[EVALUATIONS] += {averages} * left", "    left = 0"]
        lines += indent(1, self.groups(1, self.lanes_do(self.iteration())))
        return [
            *lines,
            "trouble = 0", "for k in range(L):", "    trouble += pick(I[BUSY + k] != 0, 1, 0)",
            "if trouble > 0:", "    for k in range(L):", "        if I[BUSY + k] != 0:",
            "            I[STATUS + k] = _carefully(S, I, k, P)",
        ]  # fmt: skip

    def first(self) -> list[str]:
        """z = z*, the explicit increment."""
        e = Text(self.parameters)
        y = [f"y{i}" for i in range(self.d)]
        e.lines += [f"{v} = {self.at('Y', i)}" for i, v in enumerate(y)]
        assert self.formula.increment is not None
        v = [shown(r) for r in self.formula.increment(e, self.problem, y, y, "delta")]
        e.lines += [f"{self.at('V', i)} = {r}" for i, r in enumerate(v)]
        e.lines += [f"{self.at('Z', i)} = {r}" for i, r in enumerate(v)]
        e.lines += [
            f"{self.at('P')} = INF",
            f"{self.at('X')} = {' + '.join(f'abs({a})' for a in y)}",
            f"{self.at('D')} = delta",
            "I[BUSY + k] = I[ALIVE + k]",
        ]
        return e.lines

    def iteration(self) -> list[str]:
        """An iteration: z less what the invariants have moved, and a test."""
        e, d = Text(self.parameters), self.d
        y, z = [f"y{i}" for i in range(d)], [f"z{i}" for i in range(d)]
        v = [f"v{i}" for i in range(d)]
        e.lines += [f"y{i} = {self.at('Y', i)}" for i in range(d)]
        e.lines += [f"z{i} = {self.at('Z', i)}" for i in range(d)]
        e.lines += [f"v{i} = {self.at('V', i)}" for i in range(d)]
        ends = [e.let(f"2.0 * {a} + {b}") for a, b in zip(y, z, strict=True)]
        gradients = [self.problem.mean_gradient(e, y, z), *self.problem.casimir_gradients(e, ends)]
        r = [e.dot(g, z) for g in gradients]
        c = self.correction(e, [e.let(f"{a} + {b}") for a, b in zip(y, v, strict=True)], r)
        moved = [e.let(f"{a} - {shown(b)}") for a, b in zip(z, c, strict=True)]
        e.lines += [
            f"m = {' + '.join(f'abs({shown(a)})' for a in c)}",
            "busy = I[BUSY + k] == 1",
            f"scale = {self.at('X')}",
            f"before = {self.at('P')}",
            f"{self.at('P')} = m",
            "later = (m * m <= LEFT * (scale * before)) & (before < INF)",
            "stays = (m >= 0.5 * before) & (m <= ROUNDING * scale)",
            f"done = later | stays | (m <= {d} * TINY * scale)",
            *(
                f"{self.at('Z', i)} = pick(busy, {a}, {b})"
                for i, (a, b) in enumerate(zip(moved, z, strict=True))
            ),
            "left += pick(busy & no(done), 1, 0)",
        ]
        inside = self.problem.domain(e, [e.let(f"{a} + {b}") for a, b in zip(y, moved, strict=True)])
        outcome = f"pick({inside}, 0, 2)" if inside else "0"
        e.lines.append(f"I[BUSY + k] = pick(busy, pick(done, {outcome}, 1), I[BUSY + k])")
        return e.lines

    def correction(self, e: Text, end: list[str], r: list[Expression]) -> list[Expression]:
        """u in the span of the gradients N_k at y* with N_kᵀu = r_k: see `sepv.schemes.projected.Directions`."""
        doubled = [e.let(f"2.0 * {v}") for v in end]
        gradients = [self.problem.gradient(e, end), *self.problem.casimir_gradients(e, doubled)]
        vectors: list[list[Expression]] = []
        inverses: list[str] = []
        weights: list[Expression] = []
        for N, moved in zip(gradients, r, strict=True):
            value = moved
            q = list(N)
            for _ in range(2):
                for b, inverse in zip(vectors, inverses, strict=True):
                    along = e.product(e.dot(b, q), inverse)
                    q = [e.minus(x, along, w) for x, w in zip(q, b, strict=True)]
            for b, w in zip(vectors, weights, strict=True):
                value = e.minus(value, e.dot(b, N), w)
            left, length = shown(e.dot(q, q)), shown(e.dot(N, N))
            new = e.let(f"{left} > {DEPENDENT**2!r} * {length}")
            inverses.append(e.let(f"pick({new}, 1.0 / pick({new}, {left}, 1.0), 0.0)"))
            vectors.append(q)
            weights.append(e.product(value, inverses[-1]))
        return [e.dot(weights, [q[i] for q in vectors]) for i in range(self.d)]

    def carefully(self) -> list[str]:
        """What is wrong with a lane."""
        size = " + ".join(f"abs({self.at('Z', i)})" for i in range(self.d))
        return [
            "if I[BUSY + k] == 2:",
            "    return LEFT_DOMAIN",
            f"return NO_CONVERGENCE if {size} < INF else BROKEN",
        ]
