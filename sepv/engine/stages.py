"""Code for the s-stage methods: sweeps z ← R(z) for a block of lanes in lockstep, Newton for the lanes left.

A sweep z_i ← Δ B(Y_i) g_i costs evaluations and s² d products, where a step of Newton's iteration eliminates s·d
unknowns. Each sweep gains a factor of about Δ|f′|/4; at steps that make sense all of them cost less than one
elimination. A lane is done where the correction to come, m²/m_before, is below rounding; one whose corrections do
not shrink is solved by itself, by Newton's iteration with every test of `sepv.implicit`.

Where H is no polynomial, a last sweep by half as many nodes again must change nothing but roundings. A lane where it
does, or with a point outside the domain, is left to Newton's iteration as well, whose nodes are doubled until two
rules agree (`sepv.schemes.collocation`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sepv.engine.schemes import Collocation, at
from sepv.engine.stages_newton import NEWTON
from sepv.engine.text import Expression, Table, Text, shown
from sepv.engine.writer import Writer, indent
from sepv.problem import Array
from sepv.quadrature import gauss_legendre
from sepv.schemes.collocation import FIRST_NODES, MAX_NODES
from sepv.solution import Status
from sepv.tableaux import exact_nodes, gauss_tableau, moments

# Sweeps before the first test, which costs half a sweep, and sweeps after it: while one lane of a block goes on, each
# costs what forty lanes take, and Newton's iteration for one lane a hundred times as much.
BLIND, TESTED = 8, 40
FUSED = 2
# Corrections must shrink by this factor.
SHRINKS = 0.9


class StagesWriter(Writer):
    """The kernel of an s-stage method."""

    formula: Collocation
    imports = "from sepv.engine.stages import rules, tableau\n"

    @property
    def nodes(self) -> int:
        """Of the first rule: exact where H is a polynomial."""
        s, degree = self.formula.stages, self.problem.degree
        if not self.formula.averaged:
            return s
        return exact_nodes(s, degree) if degree else s + FIRST_NODES

    @property
    def exact(self) -> bool:
        """Whether the first rule is all there is."""
        return bool(self.problem.degree) or not self.formula.averaged

    @property
    def straight(self) -> bool:
        """Whether the nodes of the quadrature are the stages, so that a sweep is written out."""
        return self.nodes == self.formula.stages

    def more_rows(self) -> dict[str, int]:
        """Where the nodes are not the stages: the sums of the g_i."""
        return {} if self.straight else {"G": self.unknowns}

    def step(self) -> list[str]:
        """Sweeps for all lanes, rule by rule, then Newton's iteration for those in any trouble.

        BUSY is 1 in a lane that sweeps, 3 in one that is to be checked, 0 in one that is done, and 2 in one that is
        left to Newton's iteration.
        """
        lines = ["for k in range(L):", *indent(1, [*self.random_step(), *self.first()])]
        lines += ["for sweep in range(BLIND // FUSED):", "    for k in range(L):", *indent(2, self.blind())]
        lines += ["I[EVALUATIONS] += (1 + BLIND * STAGES) * I[LIVING]", "I[WORK] += (1 + BLIND) * I[LIVING]"]
        lines += ["left = I[LIVING]", "for rule in range(RULES):", "    for sweep in range(TESTED):"]
        lines += ["        if left == 0:", "            break", "        I[WORK] += left"]
        lines += ["        I[EVALUATIONS] += left * COUNTS[2 * rule]", "        left = 0"]
        lines += indent(2, self.groups(1, [*self.sums("2 * rule"), *self.lanes_do(self.iteration())]))
        if self.checked:
            finer = "2 * rule" if self.exact else "2 * rule + 1"
            lines += indent(1, self.groups(3, [*self.sums(finer), *self.lanes_do(self.check())]))
            lines += ["    I[EVALUATIONS] += I[LIVING] * COUNTS[2 * rule + 1]"]
        return [*lines, *self.left_over()]

    @property
    def checked(self) -> bool:
        """Whether a converged lane is looked at again: for its quadrature, and for its points."""
        return not self.exact or self.has_domain()

    def sums(self, rule: str) -> list[str]:
        """G_i = Σ W_in ∇H(u_n), node by node; nothing where a sweep is written out."""
        if self.straight:
            return []
        e, s, d = Text(self.parameters), self.formula.stages, self.d
        y, z = self.lane(e)
        u = list(y)
        for j in range(s):
            u = [e.let(f"fma(b{j}, {z[j * d + i]}, {v})") for i, v in enumerate(u)]
        g = [shown(v) for v in self.problem.gradient(e, u)]
        e.lines += [f"{self.at('G', i * d + r)} += a{i} * {g[r]}" for i in range(s) for r in range(d)]
        return [
            *self.lanes_do([f"{self.at('G', i)} = 0.0" for i in range(self.unknowns)]),
            f"for q in range(FIRSTS[{rule}], FIRSTS[{rule}] + COUNTS[{rule}]):",
            *indent(1, [f"a{i} = W[{i}, q]" for i in range(s)]),
            *indent(1, [f"b{j} = INTEGRALS[q, {j}]" for j in range(s)]),
            *indent(1, self.lanes_do(e.lines)),
        ]  # fmt: skip

    def sweep(self, e: Text, y: list[str], z: list[str]) -> list[str]:
        """R(z)."""
        d, s = self.d, self.formula.stages
        g = None if self.straight else [[self.at("G", i * d + r) for r in range(d)] for i in range(s)]
        return [shown(v) for v in self.formula.sweep(e, self.problem, y, z, "delta", g)]

    def lane(self, e: Text) -> tuple[list[str], list[str]]:
        """y, z and Δ of lane k."""
        y, z = self.loaded(e, "Y", "y"), self.loaded(e, "Z", "z")
        e.lines.append(f"delta = {self.at('D')}")
        return y, z

    def first(self) -> list[str]:
        """The first sweep from z = 0, where one evaluation serves all stages."""
        e = Text(self.parameters)
        y = self.loaded(e, "Y", "y")
        g = self.problem.gradient(e, y)
        R = [shown(e.product("delta", e.dot(row, g))) for row in self.problem.structure(e, y)]
        e.lines += [f"{self.at('Z', i)} = {R[i % self.d]}" for i in range(self.unknowns)]
        e.lines += [
            f"{self.at('P')} = INF",
            f"{self.at('X')} = {' + '.join(f'abs({v})' for v in y)}",
            f"{self.at('D')} = delta",
            "I[BUSY + k] = I[ALIVE + k]",
        ]
        return e.lines

    def blind(self) -> list[str]:
        """A sweep without a test, by the nodes of the stages alone, which are good enough for a start."""
        e = Text(self.parameters)
        y, R = self.lane(e)
        for _ in range(FUSED if self.straight else 1):
            R = [shown(v) for v in self.formula.sweep(e, self.problem, y, R, "delta", None)]
        return [*e.lines, *(f"{self.at('Z', i)} = {v}" for i, v in enumerate(R))]

    def iteration(self) -> list[str]:
        """The end of a sweep of all lanes, and its test."""
        e = Text(self.parameters)
        y, z = self.lane(e)
        R = self.sweep(e, y, z)
        e.lines += [
            f"m = {' + '.join(f'abs({a} - {b})' for a, b in zip(R, z, strict=True))}",
            "busy = I[BUSY + k] == 1",
            f"scale = {self.at('X')}",
            f"before = {self.at('P')}",
            f"{self.at('P')} = m",
            f"done = (m * m <= LEFT * (scale * before)) & (before < INF) | (m <= {self.unknowns} * TINY * scale)",
            f"stays = no(m <= {SHRINKS} * before)",
            "done = done | (stays & (m <= ROUNDING * scale))",
            "slow = stays & no(done)",
            *(f"{self.at('Z', i)} = pick(busy, {a}, {b})" for i, (a, b) in enumerate(zip(R, z, strict=True))),
            "left += pick(busy & no(done) & no(slow), 1, 0)",
            f"I[BUSY + k] = pick(busy, pick(done, {3 if self.checked else 0}, pick(slow, 2, 1)), I[BUSY + k])",
        ]
        return e.lines

    def check(self) -> list[str]:
        """The last sweep by a finer rule, and whether all points are in the domain."""
        e = Text(self.parameters)
        y, z = self.lane(e)
        R = self.sweep(e, y, z)
        size = " + ".join(f"abs({v})" for v in z)
        e.lines += [
            f"m = {' + '.join(f'abs({a} - {b})' for a, b in zip(R, z, strict=True))}",
            f"fine = (m <= 2.0 ** -48 * ({size})) | (m <= {self.unknowns} * TINY * {self.at('X')})",
            "asked = I[BUSY + k] == 3",
            f"{self.at('P')} = INF",
        ]
        inside = "asked"
        if self.has_domain():
            P = moments(self.formula.stages, self.nodes)[1]
            points = [*self.formula.states(e, y, z), *(at(e, y, z, row) for row in P)]
            inside = " & ".join(["asked", *(f"({self.problem.domain(e, point)})" for point in points)])
        e.lines += [
            f"inside = {inside}",
            *(
                f"{self.at('Z', i)} = pick(asked, {a}, {b})"
                for i, (a, b) in enumerate(zip(R, z, strict=True))
            ),
            "left += pick(asked & inside & no(fine), 1, 0)",
            "I[BUSY + k] = pick(asked, pick(inside, pick(fine, 0, 1), 2), I[BUSY + k])",
        ]
        return e.lines

    def carefully(self) -> list[str]:
        """One lane by itself: Newton's iteration from z = 0, with finer rules until two agree."""
        y = [f"y[{i}] = {self.at('Y', i)}" for i in range(self.d)]
        z = [f"{self.at('Z', i)} = z[{i}]" for i in range(self.unknowns)]
        return [
            "y, z = np.empty(D), np.zeros(STAGES * D)", *y, f"delta = {self.at('D')}",
            "for rule in range(RULES):",
            "    code = _newton(I, P, y, z, delta, rule)",
            "    if code != 0:", "        return code",
            "    if EXACT or _agrees(I, P, y, z, rule):", *indent(2, z), "        return 0",
            "return QUADRATURE",
        ]  # fmt: skip

    def functions(self) -> list[str]:
        """The problem's functions one by one, for lanes that are looked at by themselves."""
        d, s = self.d, self.formula.stages
        x = [f"x{i}" for i in range(d)]
        ladder = [self.nodes]
        while not self.exact and 2 * ladder[-1] <= MAX_NODES:
            ladder.append(2 * ladder[-1])
        lines = [
            f"D, STAGES, RULES, EXACT, QUADRATURE = {d}, {s}, {len(ladder)}, {self.exact}, {int(Status.QUADRATURE)}",
            f"COUNTS, FIRSTS, W, INTEGRALS = rules({s}, {tuple(ladder)})",
            f"A, WEIGHTS = tableau({s})",
            f"BLIND, FUSED = {(BLIND, FUSED) if self.straight else (4, 1)}",
            f"TESTED = {TESTED}",
            "",
        ]
        for name in ("gradient", "hessian", "structure"):
            e = Text(self.parameters)
            found = getattr(self.problem, name)(e, x)
            lines += self.function(f"_{name}(x, out, P)", e, _entries("out", found), "return")
        e = Text(self.parameters)
        derivative = self.problem.structure_derivative(e, x)
        g = [f"g[{i}]" for i in range(d)]
        turned: Table = [[e.dot(derivative[k][r], g) for k in range(d)] for r in range(d)]
        lines += self.function("_turned(x, g, out, P)", e, _entries("out", turned), "return")
        e = Text(self.parameters)
        inside = self.problem.domain(e, x) or "True"
        lines += self.function("_inside(x, P)", e, [], f"return {inside}")
        return [*lines, NEWTON]

    def function(self, head: str, e: Text, stores: Sequence[str], end: str) -> list[str]:
        """A function of the state x."""
        loads = [f"p{i} = P[{self.noises + i}]" for i in range(len(self.parameters))]
        body = [*loads, *(f"x{i} = x[{i}]" for i in range(self.d)), *e.lines, *stores, end]
        return ["@_kernel", f"def {head}:", *indent(1, body), "", ""]


def _entries(out: str, values: list[Expression] | Table) -> list[str]:
    """Assignments of a vector or of a table."""
    lines = []
    for i, value in enumerate(values):
        if isinstance(value, list):
            lines += [f"{out}[{i}, {k}] = {shown(v)}" for k, v in enumerate(value)]
        else:
            lines.append(f"{out}[{i}] = {shown(value)}")
    return lines


def rules(stages: int, ladder: Sequence[int]) -> tuple[np.ndarray, np.ndarray, Array, Array]:
    """Quadratures of a generated module: each rule and the finer one that it is compared with, one after the other.

    Returns
    -------
    counts, firsts : (2 R,)
        Nodes of each rule, and where they begin.
    W : (s, N), P : (N, s)
        `sepv.tableaux.moments` of all rules. With s nodes W is the identity.
    """
    counts = [n for nodes in ladder for n in (nodes, nodes + nodes // 2)]
    found = [moments(stages, n) for n in counts]
    parts = [np.eye(stages) if n == stages else W for n, (W, _) in zip(counts, found, strict=True)]
    firsts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    return np.array(counts), firsts, np.concatenate(parts, axis=1), np.concatenate([P for _, P in found])


def tableau(stages: int) -> tuple[Array, Array]:
    """A and b of the Gauss method."""
    found = gauss_tableau(stages)
    return found.A, gauss_legendre(stages)[1]
