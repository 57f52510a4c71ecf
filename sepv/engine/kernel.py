"""The generated module: Newton's iteration for a block of lanes in lockstep, written for one problem and scheme.

The loop over iterations is outside the loop over lanes, whose body is straight-line code with selects,
so that it becomes SIMD code; a block leaves the iteration when none of its lanes is busy. All state of a
block lies in one scratch buffer at fixed offsets.

A lane is done where its correction, applied, leaves an error below rounding: with corrections m, then at worst
m²/m_before next, because Newton's converge faster than linearly; or where corrections are small and no longer
shrink. The last correction is always applied.
"""

from __future__ import annotations

from functools import lru_cache

from sepv.engine.code import ProblemCode
from sepv.engine.linear import solve
from sepv.engine.schemes import Formula
from sepv.engine.text import Text, shown
from sepv.implicit import MAX_HALVINGS, MAX_ITERATIONS, STAGNATION, Status

# The error that a lane may be left with, relative to its state: 2⁻¹⁰ of a rounding.
LEFT = 2.0**-62
# Before there are two corrections to compare, only one so small that its square is below that counts.
FIRST = 2.0**-31
# Where corrections are below a quarter of a rounding nothing is left to correct.
TINY = 2.0**-54


@lru_cache(maxsize=256)
def module_text(
    problem: ProblemCode, formula: Formula, noises: int, lanes: int, compensated: bool
) -> tuple[str, list[float]]:
    """The module's source, and the parameters that its kernel reads (the c_j first)."""
    writer = _Writer(problem, formula, noises, lanes, compensated)
    return writer.text(), writer.parameters


class _Writer:
    def __init__(
        self, problem: ProblemCode, formula: Formula, noises: int, lanes: int, compensated: bool
    ) -> None:
        self.problem, self.formula, self.noises = problem, formula, noises
        self.lanes, self.compensated = lanes, compensated
        self.d = problem.dimension
        self.parameters: list[float] = []
        d, L = self.d, lanes
        names = ["Y", "Z", "C", "E"]
        self.offset = {name: n * d * L for n, name in enumerate(names)}
        base = len(names) * d * L
        for n, name in enumerate(("D", "P", "H", "WH", "WC")):
            self.offset[name] = base + n * L
        base += 5 * L
        self.casimirs = len(problem.casimirs(Text(), [f"y{i}" for i in range(d)]))
        self.offset["K"] = base
        self.size = base + self.casimirs * L

    def at(self, name: str, i: int = 0) -> str:
        """An element of the scratch buffer: component i of lane k."""
        return f"S[{self.offset[name] + i * self.lanes} + k]"

    def text(self) -> str:
        body = self.implicit() if self.formula.implicit else self.explicit()
        start, update = self.start(), self.update()
        loads = [f"p{i} = P[{self.noises + i}]" for i in range(len(self.parameters))]
        c = [f"c{j} = P[{j}]" for j in range(self.noises)]
        head = _HEAD.format(
            preamble=self.problem.preamble,
            lanes=self.lanes,
            size=self.size,
            noises=self.noises,
            piece=max(16, 1024 // self.lanes),
            implicit=self.formula.implicit,
            energy=self.offset["WH"] // self.lanes,
            casimir=self.offset["WC"] // self.lanes,
        )
        lines = [head]
        lines += ["@_kernel", "def _start(S, P):", *_indent(1, loads), *_indent(1, start), ""]
        lines += ["", "@_kernel", "def _advance(S, I, buffer, count, first, h, bound, P):"]
        lines += _indent(1, ["wide()", *c, *loads, "for n in range(count):", *_indent(1, [*body, *update])])
        return "\n".join(lines) + "\n" + _DRIVER

    def start(self) -> list[str]:
        """The invariants at the start."""
        e = Text(self.parameters)
        y = [f"y{i}" for i in range(self.d)]
        e.lines += [f"{v} = {self.at('Y', i)}" for i, v in enumerate(y)]
        e.lines.append(f"{self.at('H')} = {shown(self.problem.hamiltonian(e, y))}")
        for i, value in enumerate(self.problem.casimirs(e, y)):
            e.lines.append(f"{self.at('K', i)} = {shown(value)}")
        e.lines += [f"{self.at('WH')} = 0.0", f"{self.at('WC')} = 0.0"]
        e.lines += [f"{self.at('E', i)} = 0.0" for i in range(self.d)]
        return ["for k in range(L):", *_indent(1, e.lines)]

    def random_step(self) -> list[str]:
        lines = ["delta = h"]
        for j in range(self.noises):
            lines += [
                f"u = buffer[n, {j}, k]",
                "u = pick(u < -bound, -bound, u)",
                "u = pick(u > bound, bound, u)",
                f"delta = delta + c{j} * u",
            ]
        return lines

    def implicit(self) -> list[str]:
        d = self.d
        first = [
            *self.random_step(),
            f"{self.at('D')} = delta",
            f"{self.at('P')} = INF",
            "I[BUSY + k] = I[ALIVE + k]",
        ]
        first += [f"{self.at('Z', i)} = 0.0" for i in range(d)]
        lines = ["for k in range(L):", *_indent(1, first), "limit = FIRST", "for iteration in range(MOST):"]
        lines += ["    left = 0", "    outside = 0", "    for k in range(L):"]
        lines += _indent(2, self.iteration())
        if self.has_domain():
            lines += _indent(1, self.back_into_domain())
        lines += ["    if left == 0:", "        break", "    limit = STAGNATION"]
        return lines

    def has_domain(self) -> bool:
        return self.problem.domain(Text(), [f"y{i}" for i in range(self.d)]) is not None

    def iteration(self) -> list[str]:
        d = self.d
        e = Text(self.parameters)
        y, z = [f"y{i}" for i in range(d)], [f"z{i}" for i in range(d)]
        e.lines += [f"{v} = {self.at('Y', i)}" for i, v in enumerate(y)]
        e.lines += [f"{v} = {self.at('Z', i)}" for i, v in enumerate(z)]
        e.lines.append(f"delta = {self.at('D')}")
        R, K = self.formula.increment(e, self.problem, y, z, "delta")
        F = [e.let(f"{z[i]} - {shown(R[i])}" if R[i] is not None else z[i]) for i in range(d)]
        A = [
            [e.let(f"{float(i == j)} - {K[i][j]}") if K[i][j] is not None else ("(1.0)" if i == j else None)
             for j in range(d)]
            for i in range(d)
        ]  # fmt: skip
        c = solve(e, A, list(F))
        e.lines += [
            f"residual = {' + '.join(f'abs({f})' for f in F)}",
            f"size = {' + '.join(f'abs({v})' for v in c)}",
            "busy = I[BUSY + k] != 0",
            "rest = residual == 0.0",  # a state at rest is a solution, also where the Jacobian is singular
            "broken = no(residual < INF)",
            "singular = no(broken | rest | (size < INF))",
            f"m = abs({c[0]})",
            f"scale = abs(y0) + abs({z[0]})",
        ]
        for i in range(1, d):
            e.lines += [f"v = abs({c[i]})", "m = pick(v > m, v, m)"]
            e.lines += [f"v = abs(y{i}) + abs({z[i]})", "scale = pick(v > scale, v, scale)"]
        e.lines += [
            f"before = {self.at('P')}",
            "small = m <= limit * scale",
            "close = (m * m <= LEFT * scale * before) | (m >= 0.5 * before) | (m <= TINY * scale)",
            "done = rest | (small & close)",
            "stop = broken | singular",
            "move = busy & no(rest | stop)",
        ]
        moved = [f"n{i}" for i in range(d)]
        e.lines += [f"{moved[i]} = {z[i]} - {c[i]}" for i in range(d)]
        if self.has_domain():
            there = [e.let(f"{y[i]} + {moved[i]}") for i in range(d)]
            inside = self.problem.domain(e, there)
            e.lines += [
                f"inside = {inside}",
                "out = move & no(inside)",
                "move = move & inside",
                "done = rest | (done & inside)",
            ]
            e.lines += [f"{self.at('C', i)} = {c[i]}" for i in range(d)]
            e.lines += ["outside += pick(out, 1, 0)", "I[OUT + k] = pick(out, 1, 0)"]
        e.lines += [f"{self.at('Z', i)} = pick(move, {moved[i]}, {z[i]})" for i in range(d)]
        e.lines += [
            f"{self.at('P')} = m",
            "code = pick(broken, BROKEN, SINGULAR)",
            "I[STATUS + k] = pick(busy & stop, code, I[STATUS + k])",
            "I[WORK + k] += pick(busy, 1, 0)",
            "still = busy & no(done | stop)",
            "left += pick(still, 1, 0)",
            "I[BUSY + k] = pick(still, 1, 0)",
        ]
        return e.lines

    def back_into_domain(self) -> list[str]:
        """Corrections halved until they stay in the domain, for the few lanes that need it, one by one."""
        d = self.d
        e = Text(self.parameters)
        there = [f"({self.at('Y', i)} + ({self.at('Z', i)} - factor * {self.at('C', i)}))" for i in range(d)]
        inside = self.problem.domain(e, [e.let(t) for t in there])
        moves = [f"{self.at('Z', i)} = {self.at('Z', i)} - factor * {self.at('C', i)}" for i in range(d)]
        return [
            "if outside > 0:",
            "    for k in range(L):",
            "        if I[OUT + k] != 0:",
            "            factor = 1.0",
            "            found = False",
            "            for halving in range(HALVINGS):",
            "                factor *= 0.5",
            *_indent(4, e.lines),
            f"                if {inside}:",
            "                    found = True",
            "                    break",
            "            if found:",
            *_indent(4, moves),
            "            else:",
            "                I[STATUS + k] = LEFT_DOMAIN",
            "                I[BUSY + k] = 0",
            "                left -= 1",
        ]

    def explicit(self) -> list[str]:
        raise NotImplementedError

    def update(self) -> list[str]:
        """The step's end: states, invariants, statuses."""
        d = self.d
        e = Text(self.parameters)
        y = [f"y{i}" for i in range(d)]
        e.lines += [f"x{i} = {self.at('Y', i)}" for i in range(d)]
        e.lines += [
            "alive = I[ALIVE + k] != 0",
            "code = pick(I[BUSY + k] != 0, NO_CONVERGENCE, I[STATUS + k])",
            "ok = alive & (code == 0)",
            "I[STATUS + k] = pick(alive, code, I[STATUS + k])",
            "I[FAILED + k] = pick(alive & no(ok), first + n, I[FAILED + k])",
            "I[ALIVE + k] = pick(ok, 1, 0)",
            "living += pick(ok, 1, 0)",
        ]
        for i in range(d):
            if self.compensated:
                # Kahan: what a sum loses is kept and added to the next increment.
                e.lines += [
                    f"q{i} = {self.at('Z', i)} + {self.at('E', i)}",
                    f"y{i} = x{i} + q{i}",
                    f"r{i} = (x{i} - y{i}) + q{i}",
                    f"{self.at('E', i)} = pick(ok, r{i}, {self.at('E', i)})",
                ]
            else:
                e.lines.append(f"y{i} = x{i} + {self.at('Z', i)}")
        e.lines += [f"y{i} = pick(ok, y{i}, x{i})" for i in range(d)]
        e.lines += [f"{self.at('Y', i)} = y{i}" for i in range(d)]
        e.lines.append(f"drift = abs({shown(self.problem.hamiltonian(e, y))} - {self.at('H')})")
        e.lines.append(f"{self.at('WH')} = pick(drift > {self.at('WH')}, drift, {self.at('WH')})")
        for i, value in enumerate(self.problem.casimirs(e, y)):
            e.lines.append(f"drift = abs({shown(value)} - {self.at('K', i)})")
            e.lines.append(f"{self.at('WC')} = pick(drift > {self.at('WC')}, drift, {self.at('WC')})")
        return ["living = 0", "for k in range(L):", *_indent(1, e.lines), "if living == 0:", "    return 1"]


def _indent(depth: int, lines: list[str]) -> list[str]:
    return ["    " * depth + line for line in lines]


_HEAD = f'''"""Generated by sepv; see sepv/engine/kernel.py."""

import numpy as np
from numba import njit

from sepv.engine.functions import fma, no, pick, wide
from sepv.engine.lanes import coarse, fill
{{preamble}}
_kernel = njit(error_model="numpy", nogil=True, cache=True)
L, SIZE, NOISES = {{lanes}}, {{size}}, {{noises}}
INF = np.inf
MOST, HALVINGS = {MAX_ITERATIONS}, {MAX_HALVINGS}
STAGNATION, FIRST, LEFT, TINY = {STAGNATION!r}, {FIRST!r}, {LEFT!r}, {TINY!r}
NO_CONVERGENCE, LEFT_DOMAIN = {int(Status.NO_CONVERGENCE)}, {int(Status.LEFT_DOMAIN)}
BROKEN, SINGULAR = {int(Status.OVERFLOW)}, {int(Status.SINGULAR)}
PIECE, IMPLICIT = {{piece}}, {{implicit}}
# Rows of L in the scratch buffer.
ENERGY, CASIMIR = {{energy}}, {{casimir}}
BUSY, ALIVE, STATUS, FAILED, WORK, OUT = 0, L, 2 * L, 3 * L, 4 * L, 5 * L


'''
_DRIVER = '''    return 0


@njit(
    "void(float64[:,::1], int64[:,::1], float64[:,:,::1], uint64[:,:,:,::1], float64[:,:,:,::1], float64[:,:,:,::1],"
    " float64[::1], int64, int64, float64[:,:,::1], int64, int64, int64, float64, float64, float64[::1])",
    error_model="numpy", nogil=True, cache=True,
)
def run(S, I, W, rng, stack, top, factors, base, halvings, given, place, n0, n1, h, bound, P):
    """Steps n0 … n1 − 1 of a chunk of blocks; S, I, W, rng, stack and top are its state.

    Increments are drawn, or those of lanes `place` and on of `given` (N, m, M) where it is not empty.
    """
    buffer = np.empty((PIECE, NOISES, L))
    raw = np.empty(L, np.uint64)
    for b in range(S.shape[0]):
        if n0 == 0:
            _start(S[b], P)
            if given.shape[0] == 0 and top.shape[1] > 0:
                coarse(rng[b], top[b], factors, base, halvings, np.empty((top.shape[1], NOISES, L)), raw)
        alive = True
        for n in range(n0, n1, PIECE):
            count = min(PIECE, n1 - n)
            if given.shape[0] == 0:
                fill(buffer, n, count, rng[b], stack[b], top[b], factors, halvings, raw)
            else:
                for i in range(count):
                    for j in range(NOISES):
                        for k in range(L):
                            lane = place + b * L + k
                            buffer[i, j, k] = given[n + i, j, lane] if lane < given.shape[2] else 0.0
            for i in range(count):
                for j in range(NOISES):
                    for k in range(L):
                        W[b, j, k] += buffer[i, j, k]
            if alive:
                alive = _advance(S[b], I[b], buffer, count, n, h, bound, P) == 0
'''
