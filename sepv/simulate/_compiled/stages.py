"""Code for the s-stage methods: fixed-point sweeps z ← R(z) for a block of lanes (paths)
in lockstep.

A sweep z_i ← Δ B(Y_i) g_i, with averages g_i of ∇H, costs evaluations and s² d products; a step of
Newton's iteration eliminates s·d unknowns. Each sweep reduces the error by a factor of about
Δ|f′|/4. With sensible steps Δ, all sweeps cost less than one elimination. A lane is done if its
next correction, about m²/m_before after two of sizes m_before and m, is below rounding. If
corrections do not shrink, `sepv.schemes.collocation` solves the step by Newton's iteration.

If H is no polynomial, a last sweep with 1½ times as many nodes must change z only by roundings. If
even the finest rule fails this test, or if a point is outside the domain,
`sepv.schemes.collocation` solves the step of the lane, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sepv.problem import Array
from sepv.schemes import FIRST_NODES, MAX_NODES, exact_nodes, moments
from sepv.simulate._compiled.code_builder import CodeBuilder, shown
from sepv.simulate._compiled.schemes import Collocation, at
from sepv.simulate._compiled.writer import Writer

# The sweeps before the first test (which costs half a sweep), and the most tested sweeps. A sweep
# of one lane costs as much as a sweep of forty lanes of a block; Newton's iteration for one lane
# costs a hundred times as much.
BLIND_SWEEPS, TESTED_MAX_SWEEPS = 8, 40
FUSED_SWEEPS = 2
# The sizes of corrections must shrink by this factor in each sweep.
SHRINKS = 0.9


class StagesWriter(Writer):
    """Writer of the compiled kernel of an s-stage method (collocation or Gauss)."""

    formula: Collocation
    imports = "from sepv.simulate._compiled.stages import rules\n"

    @property
    def nodes(self) -> int:
        """The number of nodes of the first quadrature rule, which is exact if H is a polynomial."""
        s, degree = self.formula.stages, self.problem.degree
        if not self.formula.averaged:
            return s
        return exact_nodes(s, degree) if degree else s + FIRST_NODES

    @property
    def exact(self) -> bool:
        """True if the first quadrature rule is exact, so that no other rule is needed."""
        return bool(self.problem.degree) or not self.formula.averaged

    @property
    def straight(self) -> bool:
        """True if the nodes of the quadrature are the stages,
        so that a sweep is one piece of code without sums.
        """
        return self.nodes == self.formula.stages

    def more_rows(self) -> dict[str, int]:
        """Rows of the scratch buffer for averages g_i of ∇H,
        unless the quadrature nodes are the stages.
        """
        return {} if self.straight else {"G": self.unknowns}

    kernel = "staged"

    def pieces(self) -> dict[str, tuple[list[str], str]]:
        """The kernel's code by name: sweeps, their tests, and the averages of ∇H by quadrature."""
        clear, node = self.sums()
        return {
            "first_steps": ([*self.random_step(), *self.first()], "none"),
            "blind": ([*self.random_step(), *self.blind()], "none"),
            "iteration": ([*self.random_step(), *self.iteration()], "left"),
            "check": ([*self.random_step(), *self.check()] if self.checked else [], "left"),
            "clear": (clear, "none"),
            "add_node": (node, "none"),
        }

    @property
    def checked(self) -> bool:
        """True if converged lanes are tested once more,
        for the quadrature's error or points outside the domain.
        """
        return not self.exact or self.has_domain()

    def sums(self) -> tuple[list[str], list[str]]:
        """Code that zeroes the averages G_i = Σ_n W_in ∇H(u_n), and code that adds one node;
        empty if `straight`.
        """
        if self.straight:
            return [], []
        code, s, d = CodeBuilder(self.parameters), self.formula.stages, self.d
        y, z = self.lane(code)
        u = list(y)
        for j in range(s):
            u = [code.let(f"fma(b{j}, {z[j * d + i]}, {v})") for i, v in enumerate(u)]
        g = [shown(v) for v in self.problem.gradient(code, u)]
        for i in range(s):
            for r in range(d):
                total = self.at("G", i * d + r)
                code.lines.append(f"{total} = {total} + a{i} * {g[r]}")
        return [f"{self.at('G', i)} = 0.0" for i in range(self.unknowns)], code.lines

    def sweep(self, code: CodeBuilder, y: list[str], z: list[str]) -> list[str]:
        """Code of the new stages R(z) of a sweep z ← R(z)."""
        d, s = self.d, self.formula.stages
        g = None if self.straight else [[self.at("G", i * d + r) for r in range(d)] for i in range(s)]
        return [shown(v) for v in self.formula.sweep(code, self.problem, y, z, "delta", g)]

    def lane(self, code: CodeBuilder) -> tuple[list[str], list[str]]:
        """Load the state y and the unknowns z of lane k."""
        return self.loaded(code, "Y", "y"), self.loaded(code, "Z", "z")

    def first(self) -> list[str]:
        """Code of the first sweep from z = 0, in which all stages are y,
        so that B∇H is evaluated once.
        """
        code = CodeBuilder(self.parameters)
        y = self.loaded(code, "Y", "y")
        g = self.problem.gradient(code, y)
        R = [shown(code.product("delta", code.dot(row, g))) for row in self.problem.structure(code, y)]
        code.lines += [f"{self.at('Z', i)} = {R[i % self.d]}" for i in range(self.unknowns)]
        code.lines += [
            f"{self.at('P')} = INF",
            "I[BUSY + k] = I[ALIVE + k]",
        ]
        return code.lines

    def blind(self) -> list[str]:
        """Code of the sweeps before the first test, which need no quadrature:
        ∇H at the stages is good enough.
        """
        code = CodeBuilder(self.parameters)
        y, R = self.lane(code)
        for _ in range(FUSED_SWEEPS if self.straight else 1):
            R = [shown(v) for v in self.formula.sweep(code, self.problem, y, R, "delta", None)]
        return [*code.lines, *(f"{self.at('Z', i)} = {v}" for i, v in enumerate(R))]

    def iteration(self) -> list[str]:
        """Code of the end of a sweep, z ← R(z) with the averages G_i of ∇H, and of its test."""
        code = CodeBuilder(self.parameters)
        y, z = self.lane(code)
        R = self.sweep(code, y, z)
        code.lines += [
            f"m = {' + '.join(f'abs({a} - {b})' for a, b in zip(R, z, strict=True))}",
            "busy = I[BUSY + k] == 1",
            self.scale(y),
            f"before = {self.at('P')}",
            f"{self.at('P')} = m",
            f"done = (m * m <= STOP_ERROR * (scale * before)) & (before < INF)"
            f" | (m <= {self.unknowns} * NEGLIGIBLE_CORRECTION * scale)",
            f"stays = not_(m <= {SHRINKS} * before)",
            "done = done | (stays & (m <= ROUNDING * scale))",
            "slow = stays & not_(done)",
            *(
                f"{self.at('Z', i)} = select(busy, {a}, {b})"
                for i, (a, b) in enumerate(zip(R, z, strict=True))
            ),
            "left += select(busy & not_(done) & not_(slow), 1, 0)",
            f"I[BUSY + k] = select(busy, select(done, {4 if self.checked else 0}, select(slow, 2, 1)), I[BUSY + k])",
        ]
        return code.lines

    def check(self) -> list[str]:
        """Code of a last sweep by a finer rule, and of a test that y1,
        the stages and the nodes are in the domain.
        """
        code = CodeBuilder(self.parameters)
        y, z = self.lane(code)
        R = self.sweep(code, y, z)
        size = " + ".join(f"abs({v})" for v in z)
        code.lines += [
            f"m = {' + '.join(f'abs({a} - {b})' for a, b in zip(R, z, strict=True))}",
            self.scale(y),
            f"fine = (m <= {2.0**-48!r} * ({size})) | (m <= {self.unknowns} * NEGLIGIBLE_CORRECTION * scale)",
            "asked = I[BUSY + k] == 4",
            f"{self.at('P')} = INF",
        ]
        inside = "asked"
        if self.has_domain():
            P = moments(self.formula.stages, self.nodes)[1]
            points = [*self.formula.states(code, y, z), *(at(code, y, z, row) for row in P)]
            inside = " & ".join(["asked", *(f"({self.problem.domain(code, point)})" for point in points)])
        code.lines += [
            f"inside = {inside}",
            *(
                f"{self.at('Z', i)} = select(asked, {a}, {b})"
                for i, (a, b) in enumerate(zip(R, z, strict=True))
            ),
            "left += select(asked & inside & not_(fine), 1, 0)",
            "I[BUSY + k] = select(asked, select(inside, select(fine, 0, 1), 2), I[BUSY + k])",
        ]
        return code.lines

    def ladder(self) -> list[int]:
        """The numbers of nodes of the quadrature rules;
        each is tried if the rule before was not accurate enough.
        """
        found = [self.nodes]
        while not self.exact and 2 * found[-1] <= MAX_NODES:
            found.append(2 * found[-1])
        return found

    def numbers(self) -> dict[str, Any]:
        """Constants of the kernel, about its sweeps and its quadrature rules."""
        blind, fused = (BLIND_SWEEPS, FUSED_SWEEPS) if self.straight else (4, 1)
        return {
            "RULES": len(self.ladder()), "EXACT": self.exact,
            "CHECKED": self.checked, "STRAIGHT": self.straight, "BLIND": blind, "FUSED": fused,
            "TESTED": TESTED_MAX_SWEEPS,
        }  # fmt: skip

    def tables(self) -> list[str]:
        """Lines that define the tables of the quadrature rules."""
        s = self.formula.stages
        return [
            f"COUNTS, FIRSTS, NODES = rules({s}, {tuple(self.ladder())})",
            f"loaded_node = _loaded({2 * s})",
            "sums = compiled(kernels.sums, globals(), inline=True)",
        ]


def rules(stages: int, ladder: Sequence[int]) -> tuple[np.ndarray, np.ndarray, Array]:
    """Quadrature rules of a generated module: for each N in `ladder` a rule of N nodes,
    and a finer one to compare.

    counts, firsts : (2 R,), the number of nodes of each rule, and the number of its first node
    nodes : (N, 2s), for each node its weights in the averages g_i, then the weights of the z_j in
        the state at the node (`sepv.schemes._tableaux.moments`); a rule of s nodes has identity
        weights, so that g_i = ∇H at stage i
    """
    counts = [n for nodes in ladder for n in (nodes, nodes + nodes // 2)]
    found = [moments(stages, n) for n in counts]
    parts = [np.eye(stages) if n == stages else W for n, (W, _) in zip(counts, found, strict=True)]
    firsts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    W, P = np.concatenate(parts, axis=1), np.concatenate([P for _, P in found])
    return np.array(counts), firsts, np.ascontiguousarray(np.concatenate([W.T, P], axis=1))
