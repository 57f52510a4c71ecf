"""Imports run one way, and nothing heavy is loaded before it is used."""

import ast
import re
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest
from doors import ROOT, python

from sepv._lazy import find
from sepv.errors import UnknownTarget

# Folders whose files are installed under another name.
FOLDERS = (("sepv", "sepv"), ("properties", "sepv.properties"), ("reference", "sepv.reference"))


def modules() -> dict[str, Path]:
    found = {}
    for folder, prefix in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            parts = path.relative_to(ROOT / folder).with_suffix("").parts
            found[".".join((prefix, *(p for p in parts if p != "__init__")))] = path
    return found


MODULES = modules()


def resolved(node: ast.ImportFrom, path: Path) -> str:
    """The module that a statement names: relative ones are counted from the folder of the file."""
    if not node.level:
        return node.module or ""
    package = next(m for m, p in MODULES.items() if p == path.parent / "__init__.py").split(".")
    return ".".join((*package[: len(package) + 1 - node.level], *([node.module] if node.module else [])))


# A text that is the name of a module, or the beginning of one that is made.
NAMED = re.compile(r"sepv(\.\w+)+\.?(:\w+)?")


def by_name(node: ast.AST) -> str:
    """The module that a text names, as for `import_module`; "" if it names none."""
    if not (isinstance(node, ast.Constant) and isinstance(node.value, str) and NAMED.fullmatch(node.value)):
        return ""
    name = node.value.partition(":")[0].rstrip(".")
    while name and name not in MODULES:
        name = name.rpartition(".")[0]
    return name


def imports(path: Path) -> set[str]:
    """The modules of sepv that a file imports: inside functions, for types alone,
    and those of other rooms by name.

    A room may load its own files by their names, or start processes that run them.
    """
    names, own = set(), next((room(m) for m, p in MODULES.items() if p == path), "")
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            source = resolved(node, path)
            inner = {f"{source}.{a.name}" for a in node.names}
            found = inner & MODULES.keys()
            names |= found if len(found) == len(inner) else found | {source}
        elif (name := by_name(node)) and room(name) != own:
            names.add(name)
    return {n for n in names if n.startswith("sepv")}


def below(module: str, packages: tuple[str, ...]) -> str | None:
    return next((p for p in packages if f"{module}.".startswith(f"{p}.")), None)


def room(module: str) -> str:
    """sepv.schemes._scheme stands in sepv.schemes."""
    return ".".join(module.split(".")[:2])


def order(arrows: dict[str, set[str]]) -> list[str]:
    """Lowest first; the test fails with the circle where there is one."""
    try:
        return list(TopologicalSorter(arrows).static_order())
    except CycleError as circle:
        pytest.fail(f"imports go round: {' → '.join(circle.args[1])}")


def test_imports_between_rooms_go_one_way() -> None:
    """The layers are read from the tree: each room imports from those below it alone,
    inside functions too.
    """
    arrows: dict[str, set[str]] = {}
    for module, path in MODULES.items():
        if module not in ("sepv", "sepv.__main__"):  # the front doors
            arrows.setdefault(room(module), set()).update(map(room, imports(path) - {"sepv"}))
    lowest_first = order({a: b - {a} for a, b in arrows.items()})
    for ground in ("sepv.console", "sepv.statistics"):
        assert arrows[ground] <= {ground, "sepv._lazy"}, f"{ground} imports {arrows[ground]}"
    assert arrows["sepv.core"] <= {"sepv.core", "sepv.errors"}, f"sepv.core imports {arrows['sepv.core']}"
    assert lowest_first.index("sepv.problem") < lowest_first.index("sepv.schemes")
    assert lowest_first.index("sepv.schemes") < lowest_first.index("sepv.law")
    assert lowest_first.index("sepv.law") < lowest_first.index("sepv.properties")
    assert lowest_first.index("sepv.properties") < lowest_first.index("sepv.verification")
    assert lowest_first.index("sepv.studies") < lowest_first.index("sepv.peers")
    assert lowest_first.index("sepv.peers") < lowest_first.index("sepv.commands")


def test_imports_between_modules_go_one_way() -> None:
    lowest_first = order({m: imports(path) - {"sepv", m} for m, path in MODULES.items() if m != "sepv"})
    assert lowest_first.index("sepv.core.newton") < lowest_first.index("sepv.schemes._energy_preserving")


# What sees the inside of another room: the measurement that runs in another checkout finds in an
# old one the modules, and not what their room offers today.
SEES_INSIDE = {"sepv.studies._bench.measure": "sepv.simulate"}


def taken_from_inside(module: str, path: Path) -> list[str]:
    """The names that a module imports from modules of another room that are for that room."""
    names = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("sepv."):
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                inside = (full if full in MODULES else node.module).split(".")
                home = room(".".join(inside))
                private = any(re.match("_[^_]", part) for part in (*inside[2:], alias.name))
                if home not in (room(module), SEES_INSIDE.get(module)) and private:
                    names.append(full)
    return names


def test_names_across_rooms_come_from_the_room_itself() -> None:
    """An `__init__` offers what others need, and modules at the top are everybody's.
    Tests look inside, benchmarks do not.
    """
    scripts = {str(path.relative_to(ROOT)): path for path in (ROOT / "benchmarks").rglob("*.py")}
    readers = MODULES | scripts
    inside = {m: n for m, path in readers.items() if (n := taken_from_inside(m, path))}
    assert inside == {}, "let the room's __init__ import the name, and import it from the room"


def test_a_name_from_inside_is_seen() -> None:
    path = ROOT / "sepv" / "problems" / "_kepler.py"
    assert taken_from_inside("sepv.record", MODULES["sepv.record"]) == []
    assert taken_from_inside("sepv.exact", MODULES["sepv.problem"])
    assert taken_from_inside("sepv.problems._kepler", path) == []


def test_the_oracle_imports_no_suspect() -> None:
    allowed = (
        "sepv.errors",
        "sepv._arguments",
        "sepv.core.problem",
        "sepv.record",
        "sepv.problem",
        "sepv.reference",
    )
    for module, path in MODULES.items():
        if room(module) == "sepv.reference":
            for name in imports(path):
                assert below(name, allowed), f"{module} imports {name}"


def test_imports_by_name_and_for_types_are_seen() -> None:
    assert "sepv.law.cases.of_law" in imports(ROOT / "sepv" / "law" / "_law.py")  # for types alone
    assert "sepv.verification._worker" in imports(ROOT / "sepv" / "commands" / "_verify.py")
    for text, name in (("sepv.page", "sepv.page"), ("sepv.page:render", "sepv.page"), ("in sepv.page", "")):
        assert by_name(ast.Constant(text)) == name
    assert by_name(ast.Constant("sepv.properties.test_")) == "sepv.properties"


def test_a_room_below_asks_for_what_the_front_door_names() -> None:
    """Schemes and comparisons find solvers of other libraries without importing `sepv.peers`."""
    for kind in ("scheme", "method"):
        assert find(kind, "midpoint") is None
        with pytest.raises(UnknownTarget, match="a solver of scipy"):
            find(kind, "scipy-midpoint")


def test_laws_do_not_import_their_neighbours() -> None:
    for module, path in MODULES.items():
        if module.startswith("sepv.properties"):
            assert not any(name.startswith("sepv.properties.test_") for name in imports(path)), module


@pytest.mark.parametrize(
    ("statement", "heavy"),
    [
        ("import sepv", "numpy scipy hypothesis mpmath rich click"),
        ("from sepv import schemes, problems; schemes.energy_preserving, problems.pendulum()",
         "scipy hypothesis mpmath rich click pytest"),
        ("import sepv.reference.steps", "scipy hypothesis sepv.schemes sepv.core.newton"),
        ("from sepv import verify; laws = 'rounding,mean-square-order,weak-order,right-limit'; "
         "assert verify('energy-preserving', laws=laws).exit_code == 0", "scipy"),
    ],
)  # fmt: skip
def test_an_import_loads_nothing_heavy(statement: str, heavy: str) -> None:
    loaded = python(f"import sys; {statement}; print(' '.join(sys.modules))")
    assert not {*loaded.split()} & {*heavy.split()}
