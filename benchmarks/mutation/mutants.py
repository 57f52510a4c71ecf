"""The mutants of a module: one small change each, made by the operators of `benchmarks.mutation.operators`.

Changed is what runs when a function is called. Left alone are strings and docstrings, annotations, decorators, and
everything inside a `raise` statement: the texts of errors. Whether an error is raised is still put to the test, by the
mutants of its condition. Assertions and the `strict` of `zip`, which is one, are left alone too: turned round they fail
in every test, left out in none. Statements outside functions run at import and stay as they are.
"""

from __future__ import annotations

import ast
import importlib.util
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import libcst as cst
from libcst.metadata import MetadataWrapper, PositionProvider

from benchmarks.mutation.operators import OPERATORS

# As mutmut does: len(None) and isinstance(None, T) tell nothing about the tests.
PLAIN_CALLS = ("len", "isinstance")
LEFT_ALONE = (cst.BaseString, cst.Annotation, cst.Decorator, cst.Raise, cst.Assert)


@dataclass(frozen=True)
class Mutant:
    """One changed function.

    Attributes
    ----------
    function : str
        The outermost function or method, such as "solve" or "Grid.streams".
    lines : range
        The statement that was changed, without the blocks below it.
    old, new : str
        The lines that differ.
    source : str
        The changed function, without decorators, at the left margin.
    """

    module: str
    function: str
    lines: range
    old: str
    new: str
    source: str

    @property
    def name(self) -> str:
        """What tells it from the others, and does not change when lines move."""
        return f"{self.module}.{self.function}: {self.old} -> {self.new}"


def path_of(module: str) -> Path:
    """The source of a module."""
    spec = importlib.util.find_spec(module)
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin)


def mutants(module: str) -> list[Mutant]:
    """All mutants of a module, in the order of its source."""
    text = path_of(module).read_text(encoding="utf-8")
    wrapper = MetadataWrapper(cst.parse_module(text))
    positions = wrapper.resolve(PositionProvider)
    statements = _statements(text)
    found: list[Mutant] = []
    for qualified, function in _functions(wrapper.module):
        plain = function.with_changes(decorators=[], leading_lines=[])
        before = _source(plain)
        for node in _changeable(plain):
            for kind, operator in OPERATORS:
                for changed in operator(node) if isinstance(node, kind) else ():
                    after = _source(plain.deep_replace(node, changed))
                    if _same_code(before, after):
                        continue
                    line = positions[node].start.line if node in positions else positions[function].start.line
                    old, new = _difference(before, after)
                    found.append(
                        Mutant(
                            module, qualified, statements.get(line, range(line, line + 1)), old, new, after
                        )
                    )
    return _numbered(found)


def _functions(module: cst.Module) -> Iterator[tuple[str, cst.FunctionDef]]:
    for statement in module.body:
        if isinstance(statement, cst.FunctionDef):
            yield statement.name.value, statement
        elif isinstance(statement, cst.ClassDef):
            for inner in statement.body.body:
                if isinstance(inner, cst.FunctionDef):
                    yield f"{statement.name.value}.{inner.name.value}", inner


def _changeable(node: cst.CSTNode) -> Iterator[cst.CSTNode]:
    if isinstance(node, LEFT_ALONE) or (
        isinstance(node, cst.Arg) and node.keyword and node.keyword.value == "strict"
    ):
        return
    if isinstance(node, cst.Call) and isinstance(node.func, cst.Name) and node.func.value in PLAIN_CALLS:
        return
    yield node
    for child in node.children:
        yield from _changeable(child)


def _source(function: cst.CSTNode) -> str:
    return cst.Module(body=[function]).code  # type: ignore[list-item]


def _same_code(before: str, after: str) -> bool:
    """Whether nothing changed but the text: (x) for x, and reshape(-2) for reshape(-1), which NumPy takes alike."""
    return _dump(before) == _dump(after)


def _dump(text: str) -> str:
    tree = ast.parse(text)
    for call in ast.walk(tree):
        if (
            isinstance(call, ast.Call)
            and isinstance(call.func, ast.Attribute)
            and call.func.attr == "reshape"
        ):
            for node in ast.walk(call):
                if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
                    node.operand = ast.Constant(1)
    return ast.dump(tree)


def _statements(text: str) -> dict[int, range]:
    """The lines of the innermost statement at each line; of a compound statement its head."""
    found: dict[int, range] = {}
    for node in ast.walk(ast.parse(text)):  # outer statements first
        if isinstance(node, ast.stmt):
            body = getattr(node, "body", None)
            last = body[0].lineno - 1 if body else node.end_lineno
            lines = range(node.lineno, max(node.lineno, last or node.lineno) + 1)
            found.update(dict.fromkeys(lines, lines))
    return found


def _difference(before: str, after: str) -> tuple[str, str]:
    """The lines between the first and the last that differ, stripped."""
    a, b = before.splitlines(), after.splitlines()
    start = next(i for i, (x, y) in enumerate(zip([*a, ""], [*b, ""], strict=False)) if x != y)
    tail = 0
    while tail < min(len(a), len(b)) - start and a[-1 - tail] == b[-1 - tail]:
        tail += 1
    return tuple(" ".join(line.strip() for line in part[start : len(part) - tail]) for part in (a, b))  # type: ignore[return-value]


def _numbered(found: list[Mutant]) -> list[Mutant]:
    """Names made unique: the same change of equal lines gets (2), (3), …"""
    seen: Counter[str] = Counter()
    unique = []
    for mutant in found:
        seen[mutant.name] += 1
        again = f" ({seen[mutant.name]})" if seen[mutant.name] > 1 else ""
        unique.append(Mutant(**{**vars(mutant), "new": mutant.new + again}))
    return unique
