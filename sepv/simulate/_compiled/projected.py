"""Code for explicit increments that are projected on the invariants: see `sepv.schemes.projected`.

The increment is computed once for each lane; the iterations that follow are those of the invariants alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from sepv.schemes._projected import DEPENDENT
from sepv.simulate._compiled.code_builder import CodeBuilder, Expression, shown
from sepv.simulate._compiled.linear import magnitude
from sepv.simulate._compiled.newton import FAST
from sepv.simulate._compiled.writer import Writer

# Iterations in registers, before and with the first test: a step of a good length needs two.
BLIND = 2


@dataclass(frozen=True)
class Directions:
    """Gram and Schmidt's q_k of the gradients N_k at y*, 1/|q_k|², and the products q_jᵀN_k, j < k.

    See `sepv.schemes._projected.Directions`.
    """

    q: list[list[Expression]]
    inverses: list[Expression]
    products: list[list[Expression]]

    def named(self) -> dict[tuple[str, int], str]:
        """What is kept for the iterations after the first, by row of the scratch buffer."""
        d, K = len(self.q[0]), len(self.q)
        found = {("Q", k * d + i): v for k, q in enumerate(self.q) for i, v in enumerate(q)}
        found |= {("N", k): v for k, v in enumerate(self.inverses)}
        found |= {("R", k * K + j): v for k, row in enumerate(self.products) for j, v in enumerate(row)}
        return {row: v for row, v in found.items() if v is not None}


class ProjectedWriter(Writer):
    """The kernel of a projected method."""

    def more_rows(self) -> dict[str, int]:
        """The directions."""
        K = 1 + len(self.problem.casimirs(CodeBuilder(), [f"y{i}" for i in range(self.d)]))
        return {"Q": K * self.d, "N": K, "R": K * K}

    kernel = "iterated"

    def pieces(self) -> dict[str, tuple[list[str], str]]:
        """The increment with the first iterations, and the next for groups."""
        return {
            "first_steps": ([*self.random_step(), *self.first()], "left"),
            "iteration": (self.iteration(), "left"),
        }

    def numbers(self) -> dict[str, Any]:
        """What the pieces cost."""
        gradients, structures = self.problem.cost(self.formula.recorded, self.known)
        averages = self.problem.gradient_evaluations
        return {
            "AVERAGES": averages, "FIRST_GRADIENTS": gradients + 1 + BLIND * averages,
            "FIRST_STRUCTURES": structures, "STEPS": BLIND, "FAST": FAST,
        }  # fmt: skip

    def first(self) -> list[str]:
        """The explicit increment z*, the directions at its end, and the first iterations."""
        code = CodeBuilder(self.parameters)
        y = self.loaded(code, "Y", "y")
        z = [shown(r) for r in self.problem.increment(code, self.formula.recorded, y, [], self.known)]
        found = self.directions(code, [code.let(f"{a} + {b}") for a, b in zip(y, z, strict=True)])
        code.lines += [
            "busy = I[ALIVE + k] != 0",
            f"scale = {' + '.join(f'abs({v})' for v in y)}",
            "before = INF",
        ]
        for step in range(BLIND):
            code.lines += ["before = m"] if step else []
            z = self.moved(code, y, z, found)
        code.lines += [f"{self.at('Z', i)} = {v}" for i, v in enumerate(z)]
        code.lines += [f"{self.at('P')} = m", f"{self.at('X')} = scale"]
        code.lines += [f"{self.at(*row)} = {v}" for row, v in found.named().items()]
        end = self.ending(code, y, z, "0")
        return [*code.lines, *end]

    def iteration(self) -> list[str]:
        """An iteration of a group."""
        code = CodeBuilder(self.parameters)
        y, z = self.loaded(code, "Y", "y"), self.loaded(code, "Z", "z")
        code.lines += ["busy = I[BUSY + k] == 1", f"scale = {self.at('X')}", f"before = {self.at('P')}"]
        moved = self.moved(code, y, z, self.kept())
        code.lines += [f"{self.at('P')} = m"]
        code.lines += [
            f"{self.at('Z', i)} = select(busy, {a}, {b})"
            for i, (a, b) in enumerate(zip(moved, z, strict=True))
        ]
        end = self.ending(code, y, moved, "I[BUSY + k]")
        return [*code.lines, *end]

    def moved(self, code: CodeBuilder, y: list[str], z: list[str], found: Directions) -> list[str]:
        """z less what the invariants have moved, m the size of that."""
        ends = [code.let(f"2.0 * {a} + {b}") for a, b in zip(y, z, strict=True)]
        gradients = [self.problem.mean_gradient(code, y, z), *self.problem.casimir_gradients(code, ends)]
        weights: list[Expression] = []
        for g, products, inverse in zip(gradients, found.products, found.inverses, strict=True):
            value = code.dot(g, z)
            for product, weight in zip(products, weights, strict=True):
                value = code.minus(value, product, weight)
            weights.append(code.product(value, inverse))
        c = [shown(code.dot(weights, [q[i] for q in found.q])) for i in range(self.d)]
        code.lines.append(magnitude(c))
        return [code.let(f"{a} - {b}") for a, b in zip(z, c, strict=True)]

    def ending(self, code: CodeBuilder, y: list[str], z: list[str], otherwise: str) -> list[str]:
        """Whether the lane is done, and in the domain; BUSY is `otherwise` where it was not busy."""
        inside = self.problem.domain(code, [code.let(f"{a} + {b}") for a, b in zip(y, z, strict=True)])
        return [
            "later = (m * m <= LEFT * (scale * before)) & (before < INF)",
            "stays = (m >= 0.5 * before) & (m <= ROUNDING * scale)",
            f"done = later | stays | (m <= {self.d} * TINY * scale)",
            f"still = busy & not_(done{f' & ({inside})' if inside else ''})",
            "left += select(still, 1, 0)",
            f"I[BUSY + k] = select(busy, select(still, 1, 0), {otherwise})",
        ]

    def directions(self, code: CodeBuilder, end: list[str]) -> Directions:
        """Of the gradients at y*."""
        doubled = [code.let(f"2.0 * {v}") for v in end]
        gradients = [self.problem.gradient(code, end), *self.problem.casimir_gradients(code, doubled)]
        found = Directions([], [], [])
        for N in gradients:
            q = list(N)
            for _ in range(2):
                for b, inverse in zip(found.q, found.inverses, strict=True):
                    along = code.product(code.dot(b, q), inverse)
                    q = [code.minus(x, along, w) for x, w in zip(q, b, strict=True)]
            found.products.append([code.dot(b, N) for b in found.q])
            left, length = shown(code.dot(q, q)), shown(code.dot(N, N))
            new = code.let(f"{left} > {DEPENDENT**2!r} * {length}")
            found.inverses.append(code.let(f"select({new}, 1.0 / select({new}, {left}, 1.0), 0.0)"))
            found.q.append(q)
        return found

    def kept(self) -> Directions:
        """The directions in the scratch buffer; what is zero is not kept."""
        found = self.directions(CodeBuilder(), [f"y{i}" for i in range(self.d)])
        K = len(found.q)
        return Directions(
            [[v and self.at("Q", k * self.d + i) for i, v in enumerate(q)] for k, q in enumerate(found.q)],
            [v and self.at("N", k) for k, v in enumerate(found.inverses)],
            [
                [v and self.at("R", k * K + j) for j, v in enumerate(row)]
                for k, row in enumerate(found.products)
            ],
        )
