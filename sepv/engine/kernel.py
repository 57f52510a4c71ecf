"""The generated module: Newton's iteration for a block of lanes in lockstep, written for one problem and scheme.

The loop over iterations is outside the loop over lanes, whose body is straight-line code with selects,
so that it becomes SIMD code; a block leaves the iteration when none of its lanes is busy. All state of a
block lies in one scratch buffer at fixed offsets.

A lane is done where its correction m, applied, leaves an error below rounding: Newton's corrections shrink
quadratically, so that the next one is m³/m_before², or m by the relative error of Newton's matrix where that is more.
A lane that is not done after a few steps, that overflows or leaves the domain, is solved again by itself with every
test of `sepv.implicit`: stagnation, a correction halved until it stays in the domain, a status. What a lane does
never depends on the others.
"""

from __future__ import annotations

import re

from sepv.engine.code import ProblemCode, Table
from sepv.engine.linear import pivoted_solve, solve
from sepv.engine.schemes import Formula, middle, rate
from sepv.engine.text import Expression, Text, shown
from sepv.implicit import MAX_HALVINGS, MAX_ITERATIONS, ROUNDING, STAGNATION, Status
from sepv.wiener import STREAMS

# The error that a lane may be left with, relative to its state: 2⁻¹⁰ of a rounding.
LEFT = 2.0**-62
# Before there are two corrections to compare, only one so small that its square is below that counts.
FIRST = 2.0**-31
# Where corrections are below a quarter of a rounding nothing is left to correct.
TINY = 2.0**-54
# Sweeps z ← Δ f(ȳ) before Newton's iteration. Where H is at most quadratic they solve the equation itself and leave
# O(Δ⁵) for what a step of the iteration costs, which leaves O(Δ³), as two of them do elsewhere.
SWEEPS, ROUGH_SWEEPS = 4, 2
# Steps of Newton's iteration in registers for up to LARGE unknowns, of which the last is the first that is tested.
# A path that is compensated takes one or two more. A correction below half a rounding of z is lost when it is applied,
# so that what is left before it stays, and has a sign: a mean of 1e-4 roundings a step, a tenth of that for each more.
FIRST_STEPS = 2
LARGE = 6
# Lanes that go on together: two registers, for less is not made SIMD code of.
GROUP = 16
# Steps of all lanes together, before those that are not done are looked at one by one.
FAST = 8


class Writer:
    """A kernel being written: `text` is the module's source, `parameters` what it reads after the c_j."""

    imports = ""

    def __init__(
        self, problem: ProblemCode, formula: Formula, noises: int, lanes: int, compensated: bool
    ) -> None:
        self.problem, self.formula, self.noises = problem, formula, noises
        self.lanes, self.compensated = lanes, compensated
        self.d = problem.dimension
        self.parameters: list[float] = []
        d, L = self.d, lanes
        self.unknowns = formula.stages * d
        small = self.unknowns <= LARGE
        exact = 0 < problem.degree <= 2
        self.sweeps = (SWEEPS if exact else ROUGH_SWEEPS) if small else 0
        self.steps = FIRST_STEPS + (compensated and (1 if exact else 2)) if small else 0
        self.offset = {}
        base = 0
        # State, unknowns of Newton's iteration, what Kahan's sum lost; Δ, the last correction, the size of the
        # state, the energy at the start, the largest defects of energy and Casimirs.
        rows = {"Y": d, "Z": self.unknowns, "E": d, **dict.fromkeys(("D", "P", "X", "H", "WH", "WC"), 1)}
        for name, count in {**rows, **self.more_rows()}.items():
            self.offset[name] = base
            base += count * L
        self.casimirs = len(problem.casimirs(Text(), [f"y{i}" for i in range(d)]))
        self.offset["K"] = base
        self.size = base + self.casimirs * L

    def at(self, name: str, i: int = 0) -> str:
        """An element of the scratch buffer: component i of lane k."""
        return f"S[{self.offset[name] + i * self.lanes} + k]"

    def text(self) -> str:
        body = self.implicit() if self.formula.implicit else self.explicit()
        careful = self.carefully() if self.formula.implicit else ["return 0"]
        start, update, functions = self.start(), self.update(), self.functions()
        loads = [f"p{i} = P[{self.noises + i}]" for i in range(len(self.parameters))]
        c = [f"c{j} = P[{j}]" for j in range(self.noises)]
        head = _HEAD.format(
            preamble=self.problem.preamble,
            imports=self.imports,
            lanes=self.lanes,
            size=self.size,
            group=min(GROUP, self.lanes),
            noises=self.noises,
            piece=max(16, 1024 // self.lanes),
            implicit=self.formula.implicit,
            energy=self.offset["WH"] // self.lanes,
            casimir=self.offset["WC"] // self.lanes,
        )
        lines = [head, *functions]
        lines += ["@_kernel", "def _start(S, P):", *indent(1, loads), *indent(1, start), ""]
        lines += ["", "@_kernel", "def _carefully(S, I, k, P):", *indent(1, loads), *indent(1, careful), ""]
        lines += ["", "@_kernel", "def _advance(S, I, buffer, count, first, h, bound, P):"]
        lines += indent(1, ["wide()", *c, *loads, "for n in range(count):", *indent(1, [*body, *update])])
        return "\n".join(lines) + "\n" + _DRIVER

    def more_rows(self) -> dict[str, int]:
        """More rows of the scratch buffer."""
        return {}

    def functions(self) -> list[str]:
        """Functions that the kernel calls."""
        return []

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
        return ["for k in range(L):", *indent(1, e.lines)]

    def random_step(self) -> list[str]:
        lines = ["delta = h", "noise = 0.0"]
        for j in range(self.noises):
            lines += [
                f"u = buffer[n, {j}, k]",
                "u = pick(u < -bound, -bound, u)",
                "u = pick(u > bound, bound, u)",
                f"delta = delta + c{j} * u",
                f"noise = noise + c{j} * u",
            ]
        return lines

    def implicit(self) -> list[str]:
        """Newton's iteration: the first steps for all lanes, the next for groups, and what is left lane by lane."""
        lines = ["left = 0", *self.side_by_side([*self.random_step(), *self.first_steps()])]
        lines += [f"I[WORK] += {self.sweeps + self.steps} * I[LIVING]"]
        lines += ["for iteration in range(FAST):"]
        lines += ["    if left == 0:", "        break", "    I[WORK] += left", "    left = 0"]
        lines += indent(1, self.groups(1, self.lanes_do(self.iteration())))
        lines += ["trouble = left", "if left > 0:", "    for k in range(L):", "        if I[BUSY + k] != 0:"]
        lines += ["            code = _carefully(S, I, k, P)", "            I[STATUS + k] = code"]
        lines += ["            trouble += 1 if code != 0 else 0"]
        return lines

    def groups(self, mark: int, lines: list[str]) -> list[str]:
        """The lines for each group of lanes, one of which at least has this mark."""
        some = [
            "some = 0",
            "for k in range(group, group + GROUP):",
            f"    some += pick(I[BUSY + k] == {mark}, 1, 0)",
        ]
        return ["for group in range(0, L, GROUP):", *indent(1, [*some, "if some > 0:", *indent(1, lines)])]

    def lanes_do(self, lines: list[str]) -> list[str]:
        """The lines for each lane of a group."""
        return ["for k in range(group, group + GROUP):", *indent(1, lines)]

    def side_by_side(self, lines: list[str]) -> list[str]:
        """The lines for each lane, those of a lane of the second half after each of one of the first.

        A step is one chain of operations that wait for each other: two chains take little longer than one.
        """
        if self.lanes < 2 * GROUP:
            return ["for k in range(L):", *indent(1, lines)]
        own = {"k", *(line.split(" = ")[0] for line in lines)}
        other = [
            re.sub(r"\b[A-Za-z_]\w*", lambda name: f"{name[0]}_" if name[0] in own else name[0], line)
            for line in lines
        ]
        half = self.lanes // 2
        both = [line for pair in zip(lines, other, strict=True) for line in pair]
        return [f"for k in range({half}):", f"    k_ = k + {half}", *indent(1, both)]

    def first_steps(self) -> list[str]:
        """Sweeps and steps in registers; only the last is tested, since a test costs as much as a third of a step.

        Where sweeps gain at least a factor of two each there is one solution near zero (Banach), the one that Newton's
        iteration finds from there. A lane where they do not begins anew, at zero: its P is infinite.
        """
        n = self.unknowns
        e = Text(self.parameters)
        y = [f"y{i}" for i in range(self.d)]
        e.lines += [f"{v} = {self.at('Y', i)}" for i, v in enumerate(y)]
        e.lines += ["busy = I[ALIVE + k] != 0", f"scale = {' + '.join(f'abs({v})' for v in y)}"]
        z = ["0.0"] * n
        for _ in range(self.sweeps):
            z = [shown(v) for v in rate(e, self.problem, middle(e, y, z), "delta")]
        z = self.kept_inside(e, y, z) if self.sweeps else z
        size = " + ".join(f"abs({v})" for v in z)
        inverse = None
        for step in range(self.steps):
            c, inverse = self.newton(e, y, z, inverse)
            e.lines += [*(["before = m"] if step else []), *self.magnitude(c)]
            e.lines += [f"contracts = {2**self.sweeps}.0 * m <= {size}"] if self.sweeps and not step else []
            z = [e.let(f"-{b}") if a == "0.0" else e.let(f"{a} - {b}") for a, b in zip(z, c, strict=True)]
            z = self.kept_inside(e, y, z)
        e.lines += self.test(compared=True) if self.steps else ["m = INF", "still = busy"]
        if self.sweeps:
            e.lines += ["still = still | busy & no(contracts)", "m = pick(contracts, m, INF)"]
        e.lines += [f"{self.at('Z', i)} = {v}" for i, v in enumerate(z)]
        e.lines += [
            f"{self.at('P')} = m",
            f"{self.at('X')} = scale",
            f"{self.at('D')} = delta",
            "left += pick(still, 1, 0)",
            "I[BUSY + k] = pick(still, 1, 0)",
        ]
        return e.lines

    def kept_inside(self, e: Text, y: list[str], z: list[str]) -> list[str]:
        """z, no number where its state is outside the domain: nothing is computed with that, and it is never done."""
        if not self.has_domain():
            return z
        e.lines.append(f"inside = {self.inside(e, y, z)}")
        return [e.let(f"pick({self.inside(e, y, z)}, {v}, NAN)") for v in z]

    @staticmethod
    def magnitude(c: list[str]) -> list[str]:
        """m = Σ|c_i|."""
        return [f"m = {' + '.join(f'abs({v})' for v in c)}"]

    def test(self, compared: bool) -> list[str]:
        """Whether the correction of size m, applied, leaves an error below rounding.

        `compared` where there was surely a correction before it: were that one infinite, m would be no number.
        """
        first = [] if compared else ["later = (before < INF) | (m <= FIRST * scale)"]
        return [
            *first,
            "next = (m * m * m <= LEFT * scale * (before * before)) | (before <= FIRST * scale)",
            f"near = m <= {LEFT / self.problem.rate!r} * scale",
            f"done = (next & near{'' if compared else ' & later'}) | (m <= TINY * scale)",
            f"still = busy & no(done{' & inside' if self.has_domain() else ''})",
        ]

    def newton(
        self, e: Text, y: list[str], z: list[str], near: str | None = None
    ) -> tuple[list[str], str | None]:
        """The correction (1 − K)⁻¹F: see `sepv.engine.linear.solve`."""
        F, A = self.system(e, y, z)
        return solve(e, A, list(F), near)

    def system(self, e: Text, y: list[str], z: list[str]) -> tuple[list[str], Table]:
        """F = z − R and 1 − K."""
        n = len(z)
        assert self.formula.increment is not None
        assert self.formula.jacobian is not None
        R = self.formula.increment(e, self.problem, y, z, "delta")
        K = self.formula.jacobian(e, self.problem, y, z, "delta")
        F = [_minus(e, z[i], R[i]) for i in range(n)]
        return F, [[_one_minus(e, i == j, K[i][j]) for j in range(n)] for i in range(n)]

    def iteration(self) -> list[str]:
        """A step of all lanes and its test; a lane in any trouble stays busy, and is left to `_carefully`."""
        n, d = self.unknowns, self.d
        e = Text(self.parameters)
        y, z = [f"y{i}" for i in range(d)], [f"z{i}" for i in range(n)]
        e.lines += [f"{v} = {self.at('Y', i)}" for i, v in enumerate(y)]
        e.lines += [f"before = {self.at('P')}", f"delta = {self.at('D')}"]
        e.lines += [f"{v} = pick(before < INF, {self.at('Z', i)}, 0.0)" for i, v in enumerate(z)]
        c, _ = self.newton(e, y, z)
        moved = self.kept_inside(e, y, [e.let(f"{a} - {b}") for a, b in zip(z, c, strict=True)])
        e.lines += [
            *self.magnitude(c),
            "busy = I[BUSY + k] != 0",
            f"scale = {self.at('X')}",
            f"{self.at('P')} = m",
            *self.test(compared=False),
        ]
        e.lines += [f"{self.at('Z', i)} = pick(busy, {moved[i]}, {self.at('Z', i)})" for i in range(n)]
        e.lines += ["left += pick(still, 1, 0)", "I[BUSY + k] = pick(still, 1, 0)"]
        return e.lines

    def carefully(self) -> list[str]:
        """One lane by itself, from z = 0, with every test of `sepv.implicit`."""
        n, d = self.unknowns, self.d
        y, z = [f"y{i}" for i in range(d)], [f"z{i}" for i in range(n)]
        e = Text(self.parameters)
        F, A = self.system(e, y, z)
        c = pivoted_solve(e, A, F) if n > 3 else solve(e, A, list(F))[0]
        e.lines += [
            "I[WORK] += 1",
            f"residual = max({', '.join(f'abs({f})' for f in F)}, 0.0)",
            f"m = max({', '.join(f'abs({v})' for v in c)}, 0.0)",
            f"scale = max({', '.join(f'abs(y{i % d}) + abs({z[i]})' for i in range(n))}, 0.0)",
            f"if not ({' + '.join(f'abs({f})' for f in F)} < INF):",
            "    return BROKEN",
            "if residual == 0.0:",  # a state at rest is a solution, also where the Jacobian is singular
            "    break",
            f"if not ({' + '.join(f'abs({v})' for v in c)} < INF):",
            "    return SINGULAR",
            "done = m <= limit * scale and m * m <= LEFT * scale * before or m <= TINY * scale",
            "small = m <= STAGNATION * scale and residual <= ROUNDING * scale",
            "done = done or small and m >= 0.5 * before",
            "before = m",
            "limit = STAGNATION",
            "factor = 1.0",
        ]
        moved = [f"n{i}" for i in range(n)]
        step = [f"{moved[i]} = {z[i]} - factor * {c[i]}" for i in range(n)]
        lines = [*e.lines, *step]
        if self.has_domain():
            e = Text(self.parameters)
            inside = self.inside(e, y, moved)
            lines += ["found = False", "for halving in range(HALVINGS):", *indent(1, e.lines)]
            lines += [f"    if {inside}:", "        found = True", "        break", "    done = False"]
            lines += ["    factor *= 0.5", *indent(1, step), "if not found:", "    return LEFT_DOMAIN"]
        lines += [f"{z[i]} = {moved[i]}" for i in range(n)]
        lines += ["if done:", "    break"]
        head = [f"{v} = {self.at('Y', i)}" for i, v in enumerate(y)]
        head += [*(f"{v} = 0.0" for v in z), f"delta = {self.at('D')}", "before = INF", "limit = FIRST"]
        body = [
            *head,
            "for iteration in range(MOST):",
            *indent(1, lines),
            "else:",
            "    return NO_CONVERGENCE",
        ]
        return [*body, *(f"{self.at('Z', i)} = {v}" for i, v in enumerate(z)), "return 0"]

    def inside(self, e: Text, y: list[str], z: list[str]) -> str:
        """Whether all states that belong to z are in the domain."""
        found = [self.problem.domain(e, state) for state in self.formula.states(e, y, z)]
        return " & ".join(f"({f})" for f in found)

    def has_domain(self) -> bool:
        return self.problem.domain(Text(), [f"y{i}" for i in range(self.d)]) is not None

    def explicit(self) -> list[str]:
        """The increment itself, and whether it leads anywhere."""
        d = self.d
        e = Text(self.parameters)
        y = [f"y{i}" for i in range(d)]
        e.lines += [f"{v} = {self.at('Y', i)}" for i, v in enumerate(y)]
        assert self.formula.increment is not None
        z = [shown(v) for v in self.formula.increment(e, self.problem, y, y, "delta")]
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
        return ["trouble = 0", "for k in range(L):", *indent(1, [*self.random_step(), *e.lines])]

    def update(self) -> list[str]:
        """The step's end: states, statuses, invariants; without masks where all lanes live and none failed."""
        quick, masked = self.moves(masked=False), self.moves(masked=True)
        return [
            "if trouble == 0 and I[LIVING] == L:",
            "    for k in range(L):",
            *indent(2, quick),
            "else:",
            "    living = 0",
            "    for k in range(L):",
            *indent(2, masked),
            "    I[LIVING] = living",
            "    if living == 0:",
            "        return 1",
        ]

    def moves(self, masked: bool) -> list[str]:
        d = self.d
        e = Text(self.parameters)
        y = [f"y{i}" for i in range(d)]
        e.lines += [f"x{i} = {self.at('Y', i)}" for i in range(d)]
        if masked:
            e.lines += [
                "alive = I[ALIVE + k] != 0",
                "code = I[STATUS + k]",
                "ok = alive & (code == 0)",
                "I[FAILED + k] = pick(alive & no(ok), first + n, I[FAILED + k])",
                "I[ALIVE + k] = pick(ok, 1, 0)",
                "living += pick(ok, 1, 0)",
            ]
        z = self.formula.update(e, [self.at("Z", i) for i in range(self.unknowns)])
        for i in range(d):
            if self.compensated:
                # What a sum loses is kept and added to the next increment: Kahan's summation with Knuth's two-sum,
                # since a component next to zero is smaller than its increment.
                lost = self.at("E", i)
                kept = f"pick(ok, r{i}, {lost})" if masked else f"r{i}"
                e.lines += [f"q{i} = {z[i]} + {lost}", f"y{i} = x{i} + q{i}", f"t{i} = y{i} - x{i}"]
                e.lines.append(f"r{i} = (x{i} - (y{i} - t{i})) + (q{i} - t{i})")
                e.lines.append(f"{lost} = {kept}")
            else:
                e.lines.append(f"y{i} = x{i} + {z[i]}")
        if masked:
            e.lines += [f"y{i} = pick(ok, y{i}, x{i})" for i in range(d)]
        e.lines += [f"{self.at('Y', i)} = y{i}" for i in range(d)]
        energy = self.problem.hamiltonian(e, y)
        e.lines += self.drift(energy, "H", "WH")
        for i, value in enumerate(self.problem.casimirs(e, y)):
            e.lines += self.drift(value, ("K", i), "WC")
        return e.lines

    def drift(self, value: Expression, start: str | tuple[str, int], worst: str) -> list[str]:
        """The largest deviation so far from the value at the start."""
        before = self.at(start) if isinstance(start, str) else self.at(*start)
        largest = self.at(worst)
        return [
            f"drift = abs({shown(value)} - {before})",
            f"{largest} = pick(drift > {largest}, drift, {largest})",
        ]


def _minus(e: Text, z: str, value: Expression) -> str:
    if value is None:
        return z
    return e.let(f"-{value}") if z == "0.0" else e.let(f"{z} - {value}")


def _one_minus(e: Text, diagonal: bool, value: Expression) -> Expression:
    """An entry of 1 − K."""
    if value is None:
        return "(1.0)" if diagonal else None
    return e.let(f"1.0 - {value}") if diagonal else e.let(f"-{value}")


def indent(depth: int, lines: list[str]) -> list[str]:
    """The lines, `depth` levels in."""
    return ["    " * depth + line for line in lines]


_HEAD = f'''"""Generated by sepv; see sepv/engine/kernel.py."""

import numpy as np
from numba import njit

from sepv.engine.functions import fma, no, pick, pivoted, prefetch, wide
from sepv.engine.lanes import coarse, fill, mix
{{imports}}{{preamble}}
_kernel = njit(error_model="numpy", nogil=True, cache=True)
L, SIZE, NOISES = {{lanes}}, {{size}}, {{noises}}
INF = np.inf
MOST, HALVINGS = {MAX_ITERATIONS}, {MAX_HALVINGS}
STAGNATION, FIRST, LEFT, TINY, ROUNDING = {STAGNATION!r}, {FIRST!r}, {LEFT!r}, {TINY!r}, {ROUNDING!r}
FAST, GROUP = {FAST}, {{group}}
NAN = np.nan
NO_CONVERGENCE, LEFT_DOMAIN = {int(Status.NO_CONVERGENCE)}, {int(Status.LEFT_DOMAIN)}
BROKEN, SINGULAR = {int(Status.OVERFLOW)}, {int(Status.SINGULAR)}
PIECE, IMPLICIT = {{piece}}, {{implicit}}
# Rows of L in the scratch buffer.
ENERGY, CASIMIR = {{energy}}, {{casimir}}
STREAMS = {STREAMS}
BUSY, ALIVE, STATUS, FAILED = 0, L, 2 * L, 3 * L
EVALUATIONS, STRUCTURES, LIVING, WORK, DONE = 4 * L, 4 * L + 1, 4 * L + 2, 4 * L + 3, 4 * L + 4


'''
_DRIVER = '''    return 0


@njit(
    "void(float64[:,::1], int64[:,::1], float64[:,:,::1], uint64[:,:,:,::1], float64[:,:,:,::1], float64[::1],"
    " uint64[:,::1], float64[::1], int64, int64, int64, int64, float64[::1])",
    error_model="numpy", nogil=True, cache=True,
)
def begin(S, I, W, rng, top, y0, words, factors, base, halvings, first, count, P):
    """Paths first … first + count − 1 of a chunk of blocks from y0; their streams from `words`."""
    raw = np.empty(L, np.uint64)
    for b in range(S.shape[0]):
        living = min(L, count - b * L)
        for k in range(L):
            I[b, BUSY + k], I[b, STATUS + k], I[b, FAILED + k] = 0, 0, -1
            I[b, ALIVE + k] = 1 if k < living else 0
        I[b, EVALUATIONS:] = 0
        I[b, LIVING] = living
        for i in range(y0.shape[0]):
            S[b, i * L : (i + 1) * L] = y0[i]
        W[b] = 0.0
        _start(S[b], P)
        for stream in range(rng.shape[1]):
            state = rng[b, stream]
            for k in range(L):
                path = np.uint64(first + b * L + k)
                state[0, k], state[1, k] = words[stream, 0], words[stream, 1]
                state[2, k] = words[stream, 2] + path * np.uint64(STREAMS)
                state[3, k] = np.uint64(1)
            mix(state)
        if top.shape[1] > 0:
            coarse(rng[b], top[b], factors, base, halvings, np.empty((top.shape[1], NOISES, L)), raw)


@njit(
    "void(float64[:,::1], int64[:,::1], float64[:,:,::1], float64[:,::1], float64[:,::1], int64[::1], int64[::1],"
    " float64[::1], float64[::1], int64[::1])",
    error_model="numpy", nogil=True, cache=True,
)
def ends(S, I, W, y, total, status, failed, energy, casimir, work):
    """What came of the paths: states (d, M), sums of the increments (m, M), statuses and so on."""
    for path in range(y.shape[1]):
        b, k = path // L, path % L
        for i in range(y.shape[0]):
            y[i, path] = S[b, i * L + k]
        for j in range(NOISES):
            total[j, path] = W[b, j, k]
        status[path], failed[path] = I[b, STATUS + k], I[b, FAILED + k]
        energy[path], casimir[path] = S[b, ENERGY * L + k], S[b, CASIMIR * L + k]
    work[:] = 0
    for b in range(S.shape[0]):
        work[0] += I[b, EVALUATIONS]
        work[1] += I[b, STRUCTURES]
        work[2] += I[b, WORK]


@njit(
    "void(float64[:,::1], int64[:,::1], float64[:,:,::1], uint64[:,:,:,::1], float64[:,:,:,::1], float64[:,:,:,::1],"
    " float64[::1], int64, float64[:,:,::1], int64, int64, int64, float64, float64, float64[::1])",
    error_model="numpy", nogil=True, cache=True,
)
def run(S, I, W, rng, stack, top, factors, halvings, given, place, n0, n1, h, bound, P):
    """Steps n0 … n1 − 1 of a chunk of blocks; S, I, W, rng, stack and top are its state.

    Increments are drawn, or those of lanes `place` and on of `given` (N, m, M) where it is not empty.
    """
    buffer = np.empty((PIECE, NOISES, L))
    raw = np.empty(L, np.uint64)
    for b in range(S.shape[0]):
        alive = True
        for n in range(n0, n1, PIECE):
            count = min(PIECE, n1 - n)
            if given.shape[0] == 0:
                fill(buffer, n, count, rng[b], stack[b], top[b], factors, halvings, raw)
            else:
                lane = place + b * L
                width = min(L, given.shape[2] - lane)
                for i in range(count):
                    for j in range(NOISES):
                        if n + PIECE + i < n1:
                            for k in range(0, width, 8):
                                prefetch(given, n + PIECE + i, j, lane + k)
                        row = given[n + i, j, lane : lane + width]
                        if width == L:
                            for k in range(L):
                                buffer[i, j, k] = row[k]
                        else:
                            for k in range(L):
                                buffer[i, j, k] = row[k] if k < width else 0.0
            for i in range(count):
                for j in range(NOISES):
                    for k in range(L):
                        W[b, j, k] += buffer[i, j, k]
            if alive:
                alive = _advance(S[b], I[b], buffer, count, n, h, bound, P) == 0
        # Written here and not by the caller, so that an interrupt never finds states ahead of their number.
        I[b, DONE] = n1
'''
