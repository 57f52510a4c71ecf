"""A kernel being written: what the kernels of all schemes have in common.

The loop over iterations is outside the loop over lanes, whose body is straight-line code with selects,
so that it becomes SIMD code; a block leaves the iteration when none of its lanes is busy. All state of a
block lies in one scratch buffer at fixed offsets. What a lane does never depends on the others.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

from sepv.engine.module import ADVANCE, GROUP, HEAD, START
from sepv.engine.recorded import RecordedProblem
from sepv.engine.schemes import Formula
from sepv.engine.text import Expression, Text, shown


class Writer(ABC):
    """A kernel being written: `text` is the module's source, `parameters` what it reads after the c_j."""

    imports = ""

    def __init__(
        self, problem: RecordedProblem, formula: Formula, noises: int, lanes: int, compensated: bool
    ) -> None:
        self.problem, self.formula, self.noises = problem, formula, noises
        self.lanes, self.compensated = lanes, compensated
        self.d = problem.dimension
        self.known = formula.names(noises)
        self.parameters: list[float] = []
        d, L = self.d, lanes
        self.unknowns = formula.stages * d
        self.offset = {}
        base = 0
        # State, unknowns of Newton's iteration, what Kahan's sum lost; what is known of the step, the last correction,
        # the size of the state, the energy at the start, the largest defects of energy and Casimirs.
        rows = {"Y": d, "Z": self.unknowns, "E": d, "D": len(self.known)}
        rows |= dict.fromkeys(("P", "X", "H", "WH", "WC"), 1)
        for name, count in {**rows, **self.more_rows()}.items():
            self.offset[name] = base
            base += count * L
        self.casimirs = len(problem.casimirs(Text(), [f"y{i}" for i in range(d)]))
        self.offset["K"] = base
        self.size = base + self.casimirs * L

    def at(self, name: str, i: int = 0) -> str:
        """An element of the scratch buffer: component i of lane k."""
        return f"S[{self.offset[name] + i * self.lanes} + k]"

    def loaded(self, e: Text, row: str, names: str) -> list[str]:
        """The components of a row, loaded under these names."""
        found = [f"{names}{i}" for i in range(self.unknowns if row == "Z" else self.d)]
        e.lines += [f"{v} = {self.at(row, i)}" for i, v in enumerate(found)]
        return found

    def text(self) -> str:
        body, careful = self.step(), self.carefully()
        start, update, functions = self.start(), self.update(), self.functions()
        loads = [f"p{i} = P[{self.noises + i}]" for i in range(len(self.parameters))]
        c = [f"c{j} = P[{j}]" for j in range(self.noises)]
        head = HEAD.format(
            preamble=self.problem.preamble,
            imports=self.imports,
            lanes=self.lanes,
            size=self.size,
            group=min(GROUP, self.lanes),
            implicit=self.formula.implicit,
            energy=self.offset["WH"] // self.lanes,
            casimir=self.offset["WC"] // self.lanes,
        )
        lines = [head, *functions]
        lines += [START, "def start(S, P):", *indent(1, loads), *indent(1, start), ""]
        lines += ["", "@_kernel", "def _carefully(S, I, k, P):", *indent(1, loads), *indent(1, careful), ""]
        lines += ["", ADVANCE, "def advance(S, I, buffer, count, first, h, bound, P):"]
        lines += indent(1, ["wide()", *c, *loads, "for n in range(count):", *indent(1, [*body, *update])])
        return "\n".join([*lines, "    return 0"]) + "\n"

    @abstractmethod
    def step(self) -> list[str]:
        """A step of all lanes: z, and what has become of each lane."""

    def carefully(self) -> list[str]:
        """One lane by itself, and its status."""
        return ["return 0"]

    def more_rows(self) -> dict[str, int]:
        """More rows of the scratch buffer."""
        return {}

    def functions(self) -> list[str]:
        """Functions that the kernel calls."""
        return []

    def start(self) -> list[str]:
        """The invariants at the start."""
        e = Text(self.parameters)
        y = self.loaded(e, "Y", "y")
        e.lines.append(f"{self.at('H')} = {shown(self.problem.hamiltonian(e, y))}")
        for i, value in enumerate(self.problem.casimirs(e, y)):
            e.lines.append(f"{self.at('K', i)} = {shown(value)}")
        e.lines += [f"{self.at('WH')} = 0.0", f"{self.at('WC')} = 0.0"]
        e.lines += [f"{self.at('E', i)} = 0.0" for i in range(self.d)]
        return ["for k in range(L):", *indent(1, e.lines)]

    def random_step(self) -> list[str]:
        lines = ["delta = h", "noise = 0.0"]
        lines += ["span = h"] if "span" in self.known else []
        for j in range(self.noises):
            own = [f"noise{j} = c{j} * u"] if f"noise{j}" in self.known else []
            lines += [
                f"u = buffer[n, {j}, k]",
                "u = pick(u < -bound, -bound, u)",
                "u = pick(u > bound, bound, u)",
                f"delta = delta + c{j} * u",
                f"noise = noise + c{j} * u",
                *own,
            ]
        return lines

    def stored(self) -> list[str]:
        """What is known of the step, into its row."""
        return [f"{self.at('D', i)} = {name}" for i, name in enumerate(self.known)]

    def recalled(self) -> list[str]:
        """The same from its row."""
        return [f"{name} = {self.at('D', i)}" for i, name in enumerate(self.known)]

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

    @staticmethod
    def left_over() -> list[str]:
        """Every lane that is still busy, by itself."""
        return [
            "trouble = 0", "for k in range(L):", "    trouble += pick(I[BUSY + k] != 0, 1, 0)",
            "if trouble > 0:", "    for k in range(L):", "        if I[BUSY + k] != 0:",
            "            I[STATUS + k] = _carefully(S, I, k, P)",
        ]  # fmt: skip

    def has_domain(self) -> bool:
        return self.problem.domain(Text(), [f"y{i}" for i in range(self.d)]) is not None

    @staticmethod
    def magnitude(c: list[str]) -> list[str]:
        """m = Σ|c_i|."""
        return [f"m = {' + '.join(f'abs({v})' for v in c)}"]

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


def indent(depth: int, lines: list[str]) -> list[str]:
    """The lines, `depth` levels in."""
    return ["    " * depth + line for line in lines]
