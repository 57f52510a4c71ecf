"""Code for explicit increments that are projected on the invariants: see `sepv.schemes.projected`.

The increment is computed once for each lane; the iterations that follow are those of the invariants alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from sepv.schemes._projected import DEPENDENT, MOST
from sepv.simulate._engine.text import Expression, Text, shown
from sepv.simulate._engine.writer import Writer

# Iterations in registers, before and with the first test: a step of a good length needs two.
BLIND = 2


@dataclass(frozen=True)
class Directions:
    """Gram and Schmidt's q_k of the gradients N_k at y*, 1/|q_k|², and the products q_jᵀN_k, j < k.

    See `sepv.schemes.projected.Directions`.
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
        K = 1 + len(self.problem.casimirs(Text(), [f"y{i}" for i in range(self.d)]))
        return {"Q": K * self.d, "N": K, "R": K * K}

    kernel = "projected.advance"

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
            "FIRST_STRUCTURES": structures, "STEPS": BLIND, "FAST": MOST - BLIND,
        }  # fmt: skip

    def tables(self) -> list[str]:
        """And what says what is wrong with a lane."""
        return [*super().tables(), "refused = compiled(projected.refused, globals())"]

    def first(self) -> list[str]:
        """The explicit increment z*, the directions at its end, and the first iterations."""
        e = Text(self.parameters)
        y = self.loaded(e, "Y", "y")
        z = [shown(r) for r in self.problem.increment(e, self.formula.recorded, y, [], self.known)]
        found = self.directions(e, [e.let(f"{a} + {b}") for a, b in zip(y, z, strict=True)])
        e.lines += [
            "busy = I[ALIVE + k] != 0",
            f"scale = {' + '.join(f'abs({v})' for v in y)}",
            "before = INF",
        ]
        for step in range(BLIND):
            e.lines += ["before = m"] if step else []
            z = self.moved(e, y, z, found)
        e.lines += [f"{self.at('Z', i)} = {v}" for i, v in enumerate(z)]
        e.lines += [f"{self.at('P')} = m", f"{self.at('X')} = scale"]
        e.lines += [f"{self.at(*row)} = {v}" for row, v in found.named().items()]
        end = self.ending(e, y, z, "0")
        return [*e.lines, *end]

    def iteration(self) -> list[str]:
        """An iteration of a group."""
        e = Text(self.parameters)
        y, z = self.loaded(e, "Y", "y"), self.loaded(e, "Z", "z")
        e.lines += [
            "busy = I[BUSY + k] == 1",
            f"scale = {self.at('X')}",
            f"before = {self.at('P')}",
        ]
        moved = self.moved(e, y, z, self.kept())
        e.lines += [f"{self.at('P')} = m"]
        e.lines += [
            f"{self.at('Z', i)} = pick(busy, {a}, {b})" for i, (a, b) in enumerate(zip(moved, z, strict=True))
        ]
        end = self.ending(e, y, moved, "I[BUSY + k]")
        return [*e.lines, *end]

    def moved(self, e: Text, y: list[str], z: list[str], found: Directions) -> list[str]:
        """z less what the invariants have moved, m the size of that."""
        ends = [e.let(f"2.0 * {a} + {b}") for a, b in zip(y, z, strict=True)]
        gradients = [self.problem.mean_gradient(e, y, z), *self.problem.casimir_gradients(e, ends)]
        weights: list[Expression] = []
        for g, products, inverse in zip(gradients, found.products, found.inverses, strict=True):
            value = e.dot(g, z)
            for product, weight in zip(products, weights, strict=True):
                value = e.minus(value, product, weight)
            weights.append(e.product(value, inverse))
        c = [shown(e.dot(weights, [q[i] for q in found.q])) for i in range(self.d)]
        e.lines += self.magnitude(c)
        return [e.let(f"{a} - {b}") for a, b in zip(z, c, strict=True)]

    def ending(self, e: Text, y: list[str], z: list[str], otherwise: str) -> list[str]:
        """Whether the lane is done, and in the domain; BUSY is `otherwise` where it was not busy."""
        inside = self.problem.domain(e, [e.let(f"{a} + {b}") for a, b in zip(y, z, strict=True)])
        outcome = f"pick({inside}, 0, 2)" if inside else "0"
        return [
            "later = (m * m <= LEFT * (scale * before)) & (before < INF)",
            "stays = (m >= 0.5 * before) & (m <= ROUNDING * scale)",
            f"done = later | stays | (m <= {self.d} * TINY * scale)",
            "left += pick(busy & no(done), 1, 0)",
            f"I[BUSY + k] = pick(busy, pick(done, {outcome}, 1), {otherwise})",
        ]

    def directions(self, e: Text, end: list[str]) -> Directions:
        """Of the gradients at y*."""
        doubled = [e.let(f"2.0 * {v}") for v in end]
        gradients = [self.problem.gradient(e, end), *self.problem.casimir_gradients(e, doubled)]
        found = Directions([], [], [])
        for N in gradients:
            q = list(N)
            for _ in range(2):
                for b, inverse in zip(found.q, found.inverses, strict=True):
                    along = e.product(e.dot(b, q), inverse)
                    q = [e.minus(x, along, w) for x, w in zip(q, b, strict=True)]
            found.products.append([e.dot(b, N) for b in found.q])
            left, length = shown(e.dot(q, q)), shown(e.dot(N, N))
            new = e.let(f"{left} > {DEPENDENT**2!r} * {length}")
            found.inverses.append(e.let(f"pick({new}, 1.0 / pick({new}, {left}, 1.0), 0.0)"))
            found.q.append(q)
        return found

    def kept(self) -> Directions:
        """The directions in the scratch buffer; what is zero is not kept."""
        found = self.directions(Text(), [f"y{i}" for i in range(self.d)])
        K = len(found.q)
        return Directions(
            [[v and self.at("Q", k * self.d + i) for i, v in enumerate(q)] for k, q in enumerate(found.q)],
            [v and self.at("N", k) for k, v in enumerate(found.inverses)],
            [
                [v and self.at("R", k * K + j) for j, v in enumerate(row)]
                for k, row in enumerate(found.products)
            ],
        )
