"""Types in signatures lead to their public names: ``sepv.problem._problem.Problem`` is
``sepv.Problem``.
"""

from __future__ import annotations

import re
from functools import cache
from importlib import import_module
from typing import Any


def setup(app: Any) -> dict[str, bool]:
    """Register the extension with Sphinx."""
    app.connect("missing-reference", _by_object)
    app.connect("autodoc-process-signature", _readable)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _readable(
    _app: Any, _what: str, _name: str, _object: Any, _options: Any, signature: str | None, result: str | None
) -> tuple[str | None, str | None]:
    """Replace defaults such as ``<factory>``, which Sphinx cannot read,
    so that the types of the others are links.
    """
    return _UNREADABLE.sub(" = ...", signature) if signature else signature, result


# A default value without a literal: its repr stands in angle brackets, which may be nested once.
_UNREADABLE = re.compile(r" ?= ?<(?:[^<>]|<[^<>]*>)*>")


def _by_object(app: Any, env: Any, node: Any, shown: Any) -> Any:
    """Link a reference to a private name of sepv to the documented name of the same object."""
    target = str(node.get("reftarget", ""))
    if node.get("refdomain") != "py" or not target.startswith("sepv."):
        return None
    found = _documented(env).get(_found(target))
    if found is None:
        return None
    shown.children = [type(child)(found.rpartition(".")[2]) for child in shown.children]
    domain = env.get_domain("py")
    return domain.resolve_xref(env, node["refdoc"], app.builder, "obj", found, node, shown)


def _documented(env: Any) -> dict[Any, str]:
    names = [name for name in env.get_domain("py").objects if name.startswith("sepv.")]
    return {key: name for name in names if (key := _found(name)) is not None}


@cache
def _found(name: str) -> Any:
    """The module and qualified name of the object called `name`;
    None if there is no such class or function.
    """
    parts = name.split(".")
    for cut in range(len(parts) - 1, 0, -1):
        try:
            value = import_module(".".join(parts[:cut]))
        except ImportError:
            continue
        for part in parts[cut:]:
            value = getattr(value, part, None)
        origin = getattr(value, "__module__", None), getattr(value, "__qualname__", None)
        return origin if all(origin) else None
    return None
