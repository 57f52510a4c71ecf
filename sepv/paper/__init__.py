"""The paper (Cohen and Dujardin 2014) reproduced: the figures of §4, its remarks,
and a verdict on each statement.

The package is installed, because `sepv reproduce` runs it. Read `record` first (panels and
statements), then `suite`, which computes all panels. Each other file is a figure or a part of the
theory.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .suite import reproduce as reproduce


def __getattr__(name: str) -> Any:
    if name != "reproduce":
        raise AttributeError(f"module 'sepv.paper' has no attribute {name!r}")
    from .suite import reproduce

    return reproduce
