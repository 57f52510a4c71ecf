"""The writer of a kernel, with the parts that the kernels of all schemes share.

The loops are functions of `sepv.simulate._compiled.kernels`. A writer writes their work on a lane
(a path of a block): straight-line code with selects, so that it becomes SIMD code. The state of a
block is in one scratch buffer.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

from sepv.simulate._compiled.code_builder import CodeBuilder, Expression, shown
from sepv.simulate._compiled.layout import constants, text
from sepv.simulate._compiled.recorded import RecordedProblem
from sepv.simulate._compiled.schemes import Formula


class Writer(ABC):
    """A kernel under construction: `text` is the module's source,
    which reads the noise's c_j and then `parameters`.
    """

    imports = ""
    # The function of `sepv.simulate._compiled.kernels` that advances a block.
    kernel: str

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
        # Rows: state, largest defects of energy and of Casimirs (in the order of `driver`),
        # unknowns of the iteration, roundings of Kahan's sums, size of the last correction, energy
        # at the start. Numbers that few lanes need are computed again, because a store takes as
        # long as several operations.
        rows = {"Y": d, "WH": 1, "WC": 1, "Z": self.unknowns, "E": d if compensated else 0, "P": 1, "H": 1}
        for name, count in {**rows, **self.more_rows()}.items():
            self.offset[name] = base
            base += count * L
        self.casimirs = len(problem.casimirs(CodeBuilder(), [f"y{i}" for i in range(d)]))
        self.offset["K"] = base
        self.size = base + self.casimirs * L

    def at(self, name: str, i: int = 0) -> str:
        """An element of the scratch buffer: component i of lane k."""
        return f"S[{self.offset[name] + i * self.lanes} + k]"

    def loaded(self, code: CodeBuilder, row: str, names: str) -> list[str]:
        """Write lines that load the components of a row under `names` with the numbers 0, 1, …;
        return these names.
        """
        found = [f"{names}{i}" for i in range(self.unknowns if row == "Z" else self.d)]
        code.lines += [f"{v} = {self.at(row, i)}" for i, v in enumerate(found)]
        return found

    def text(self) -> str:
        """The source of the module."""
        pieces = {
            **self.pieces(), "quick": (self.moves(masked=False), "none"),
            "masked": (self.moves(masked=True), "living"), "invariants": (self.start(), "none"),
        }  # fmt: skip
        numbers = {
            **constants(self.lanes), "SIZE": self.size, "IMPLICIT": self.formula.implicit,
            "STAGES": self.formula.stages, "UNKNOWNS": self.offset["Z"] // self.lanes, **self.numbers(),
        }  # fmt: skip
        # The pieces are written first, because writing them names the coefficients.
        names = [f"c{j}" for j in range(self.noises)] + [f"p{i}" for i in range(len(self.parameters))]
        preamble = self.problem.preamble + self.imports
        return text(preamble, numbers, names, pieces, self.tables(), self.kernel)

    @abstractmethod
    def pieces(self) -> dict[str, tuple[list[str], str]]:
        """For each piece named in `kernels`: the lines of code for a lane,
        and the variable that they add to.
        """

    def numbers(self) -> dict[str, Any]:
        """The constants that only this kind of kernel has."""
        return {}

    def tables(self) -> list[str]:
        """Lines that define the arrays of this kind of kernel."""
        return []

    def more_rows(self) -> dict[str, int]:
        """Further rows of the scratch buffer."""
        return {}

    def start(self) -> list[str]:
        """Code of the invariants at the start of a path."""
        code = CodeBuilder(self.parameters)
        y = self.loaded(code, "Y", "y")
        code.lines.append(f"{self.at('H')} = {shown(self.problem.hamiltonian(code, y))}")
        for i, value in enumerate(self.problem.casimirs(code, y)):
            code.lines.append(f"{self.at('K', i)} = {shown(value)}")
        code.lines += [f"{self.at('WH')} = 0.0", f"{self.at('WC')} = 0.0"]
        code.lines += [f"{self.at('E', i)} = 0.0" for i in range(self.d) if self.compensated]
        return code.lines

    def scale(self, y: list[str]) -> str:
        """The line that computes the size Σ|y_i| of the state y."""
        return f"scale = {' + '.join(f'abs({v})' for v in y)}"

    def random_step(self) -> list[str]:
        """The lines that compute the random step Δ and the other data of the step."""
        lines = ["delta = h", "noise = 0.0"]
        lines += ["span = h"] if "span" in self.known else []
        if "variance" in self.known:
            squares = " + ".join(f"c{j} * c{j}" for j in range(self.noises)) or "0.0"
            lines.append(f"variance = 3.0 * ({squares}) * h")
        for j in range(self.noises):
            own = [f"noise{j} = c{j} * u"] if f"noise{j}" in self.known else []
            lines += [
                f"u = buffer[n, {j}, k]",
                "u = select(u < -bound, -bound, u)",
                "u = select(u > bound, bound, u)",
                f"delta = delta + c{j} * u",
                f"noise = noise + c{j} * u",
                *own,
            ]
        return lines

    def has_domain(self) -> bool:
        return self.problem.domain(CodeBuilder(), [f"y{i}" for i in range(self.d)]) is not None

    def moves(self, masked: bool) -> list[str]:
        d = self.d
        code = CodeBuilder(self.parameters)
        y = [f"y{i}" for i in range(d)]
        code.lines += [f"x{i} = {self.at('Y', i)}" for i in range(d)]
        if masked:
            code.lines += [
                "alive = I[ALIVE + k] != 0",
                "status = I[STATUS + k]",
                "ok = alive & (status == 0)",
                "I[FAILED + k] = select(alive & not_(ok), first + n, I[FAILED + k])",
                "I[ALIVE + k] = select(ok, 1, 0)",
                "living += select(ok, 1, 0)",
            ]
        z = self.formula.update(code, [self.at("Z", i) for i in range(self.unknowns)])
        for i in range(d):
            if self.compensated:
                # The rounding of a sum is kept and added to the next increment: Kahan's summation
                # with Knuth's two-sum, because a component near zero may be smaller than its
                # increment.
                lost = self.at("E", i)
                kept = f"select(ok, r{i}, {lost})" if masked else f"r{i}"
                code.lines += [f"q{i} = {z[i]} + {lost}", f"y{i} = x{i} + q{i}", f"t{i} = y{i} - x{i}"]
                code.lines.append(f"r{i} = (x{i} - (y{i} - t{i})) + (q{i} - t{i})")
                code.lines.append(f"{lost} = {kept}")
            else:
                code.lines.append(f"y{i} = x{i} + {z[i]}")
        if masked:
            code.lines += [f"y{i} = select(ok, y{i}, x{i})" for i in range(d)]
        code.lines += [f"{self.at('Y', i)} = y{i}" for i in range(d)]
        energy = self.problem.hamiltonian(code, y)
        code.lines += self.drift(energy, "H", "WH")
        for i, value in enumerate(self.problem.casimirs(code, y)):
            code.lines += self.drift(value, ("K", i), "WC")
        return code.lines

    def drift(self, value: Expression, start: str | tuple[str, int], worst: str) -> list[str]:
        """Lines that update the largest deviation of an invariant from its value at the start."""
        before = self.at(start) if isinstance(start, str) else self.at(*start)
        largest = self.at(worst)
        return [
            f"drift = abs({shown(value)} - {before})",
            f"{largest} = select(drift > {largest}, drift, {largest})",
        ]


class ExplicitWriter(Writer):
    """Writer of the kernel of an explicit scheme: the increment,
    and a test that the state is finite.
    """

    kernel = "explicit"

    def pieces(self) -> dict[str, tuple[list[str], str]]:
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
