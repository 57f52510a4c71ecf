"""Numbers about the source tree: ``python -m benchmarks.source_tree [FOLDER of another checkout]``.

The numbers count subpackages, modules, public names, lines, repeated lines and circular imports. A
name is public if no part of its path begins with an underscore: a name in a subpackage's
`__init__`, or of a module without underscore.
"""

from __future__ import annotations

import ast
import sys
from collections import defaultdict
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from statistics import median

from benchmarks import start

# The least length of a run of equal lines that counts as repeated; blank lines, comments and
# imports are left out.
RUN = 6


def main() -> None:
    """Print one line for each figure."""
    root = Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else Path(__file__).resolve().parents[1]
    files = sorted((root / "sepv").rglob("*.py"))
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in files}
    lengths = [len(path.read_text(encoding="utf-8").splitlines()) for path in files]
    functions = [length(node) for tree in trees.values() for node in ast.walk(tree) if is_function(node)]
    rooms = [path for path in (root / "sepv").iterdir() if (path / "__init__.py").exists()]
    rows = {
        "modules at the top": len(list((root / "sepv").glob("*.py"))),
        "rooms": len(rooms),
        "public names": sum(len(public(path, root, tree)) for path, tree in trees.items()),
        "files": len(files),
        "lines": sum(lengths),
        "median file": median(lengths),
        "longest file": max(lengths),
        "files over 400 lines": sum(n > 400 for n in lengths),
        "median function": median(functions),
        "longest function": max(functions),
        "functions over 60 lines": sum(n > 60 for n in functions),
        f"lines in runs of {RUN} and more that stand twice": repeated(files),
        "circles of imports": circles(root, trees),
    }
    for name, value in rows.items():
        print(f"{name:<48} {value:g}")


def is_function(node: ast.AST) -> bool:
    """True if a node is a function or a method."""
    return isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))


def length(node: ast.AST) -> int:
    """The number of lines of a function."""
    return int(node.end_lineno - node.lineno + 1)  # type: ignore[attr-defined]  # functions have both


def public(path: Path, root: Path, tree: ast.Module) -> set[str]:
    """The names that a user may import from a file."""
    parts = path.relative_to(root).with_suffix("").parts
    if any(part.startswith("_") and part != "__init__" for part in parts):
        return set()
    if parts == ("sepv", "__init__"):
        return set()  # the file repeats names of subpackages
    found: set[str] = set()
    for node in tree.body:
        if isinstance(node, ast.Assign) and any(ast.unparse(t) == "__all__" for t in node.targets):
            return set(ast.literal_eval(node.value))
        if isinstance(node, ast.ImportFrom):
            # In an `__init__` a name that is imported as itself (`a as a`) is public.
            found |= {a.asname for a in node.names if a.asname == a.name and a.asname}
        elif (
            isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING" and parts[-1] == "__init__"
        ):
            found |= {a.asname or a.name for n in node.body if isinstance(n, ast.ImportFrom) for a in n.names}
        elif isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            found.add(node.name)
        elif isinstance(node, (ast.Assign, ast.AnnAssign)):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found |= {t.id for t in targets if isinstance(t, ast.Name)}
    return {name for name in found if not name.startswith(("_", "pytest_"))}  # the hooks are pytest's names


def repeated(files: list[Path]) -> int:
    """The number of lines in runs of lines that occur in two places."""
    places: dict[tuple[str, ...], list[tuple[Path, int]]] = defaultdict(list)
    for path in files:
        lines = [
            (n, line.strip())
            for n, line in enumerate(path.read_text(encoding="utf-8").splitlines())
            if line.strip() and not line.strip().startswith(("#", "from ", "import ", '"', ")", "]", "}"))
        ]
        for i in range(len(lines) - RUN + 1):
            run = lines[i : i + RUN]
            places[tuple(text for _, text in run)].extend((path, n) for n, _ in run)
    twice = {place for found in places.values() if len(found) > RUN for place in found}
    return len(twice)


def circles(root: Path, trees: dict[Path, ast.Module]) -> int:
    """The number of imports to remove until no imports are circular;
    imports inside functions count too.
    """
    names = {
        ".".join(p for p in path.relative_to(root).with_suffix("").parts if p != "__init__"): tree
        for path, tree in trees.items()
    }
    arrows = {
        name: imported(tree, set(names)) - {name, "sepv"} for name, tree in names.items() if name != "sepv"
    }
    removed = 0
    while True:
        try:
            TopologicalSorter(arrows).prepare()
        except CycleError as circle:
            first, second = circle.args[1][:2]
            arrows[second].discard(first)
            removed += 1
        else:
            return removed


def imported(tree: ast.Module, names: set[str]) -> set[str]:
    """The modules that a file imports when it runs."""
    types = {
        id(n)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        for n in ast.walk(node)
    }
    found: set[str] = set()
    for node in ast.walk(tree):
        if id(node) in types:
            continue
        if isinstance(node, ast.Import):
            found |= {a.name for a in node.names} & names
        elif isinstance(node, ast.ImportFrom) and node.module:
            inner = {f"{node.module}.{a.name}" for a in node.names}
            found |= inner & names
            if not inner <= names and node.module in names:
                found.add(node.module)
    return found


if __name__ == "__main__":
    start(main)
