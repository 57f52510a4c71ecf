"""Names that a room offers and loads when they are first used."""

from __future__ import annotations

from importlib import import_module

# `typing` and `collections.abc` take longer to import than this.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from typing import Any


def lazily(room: str, offered: Mapping[str, str]) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Make `__getattr__` and `__dir__` of a room.

    Parameters
    ----------
    room : str
        Its name.
    offered : mapping of str
        Names by the module below the room that has them, separated by blanks. `one=other` is its `other` under the
        name `one`, `*one` the module itself.
    """
    places = {}
    for module, entries in offered.items():
        for entry in entries.split():
            name, _, attribute = entry.partition("=")
            places[name.lstrip("*")] = (f"{room}.{module}", "" if name[0] == "*" else attribute or name)

    def get(name: str) -> Any:
        if name not in places:
            raise AttributeError(f"module {room!r} has no attribute {name!r}")
        module, attribute = places[name]
        loaded = import_module(module)
        return getattr(loaded, attribute) if attribute else loaded

    def names() -> list[str]:
        given = {name for name in vars(import_module(room)) if name[0] != "_" or name == "__version__"}
        return sorted((given | {*places}) - {"TYPE_CHECKING", "annotations", "lazily"})

    return get, names
