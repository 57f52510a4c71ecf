"""Measurements that take minutes. Each shows its progress on stderr,
and ends with one word if it is interrupted.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Iterator
from contextvars import ContextVar
from pathlib import Path
from typing import Any, TypeVar

from sepv.console import ShownProgress, showing

T = TypeVar("T")
# The repository.
ROOT = Path(__file__).resolve().parents[1]


class _Track:
    """The progress of a benchmark in nested loops.

    The innermost loop covers the fraction `span` of the whole work, beginning at the fraction
    `low`.
    """

    def __init__(self, shown: ShownProgress) -> None:
        self.shown, self.low, self.span = shown, 0.0, 1.0
        self.texts: list[str] = []


_TRACK: ContextVar[_Track | None] = ContextVar("_TRACK", default=None)


def over(items: Iterable[T], text: Callable[[T], str] = str) -> Iterator[T]:
    """Yield the items in order, and show the fraction done and the next item on stderr.
    Loops may be nested.
    """
    track, listed = _TRACK.get(), list(items)
    if track is None:
        yield from listed
        return
    low, span = track.low, track.span
    for n, item in enumerate(listed):
        track.low, track.span = low + span * n / len(listed), span / len(listed)
        track.texts.append(text(item))
        track.shown.update(", ".join(filter(None, track.texts)), track.low)
        yield item
        track.texts.pop()
    track.low, track.span = low, span


def tell(text: str, share: float) -> None:
    """Show the current work and the fraction of all work that is done, 0 to 1,
    for work that is no loop by `over`.
    """
    track = _TRACK.get()
    if track is not None:
        track.shown.update(text, share)


def arguments(about: str | None, **options: Any) -> argparse.Namespace:
    """Read a benchmark's options from its command line. For each the default is given, whose type
    it takes, False for a flag, or the keywords of `add_argument`.
    """
    parser = argparse.ArgumentParser(description=(about or "").partition("\n\n")[0])
    for name, value in options.items():
        usual = {"action": "store_true"} if value is False else {"type": type(value), "default": value}
        parser.add_argument(f"--{name}", **(value if isinstance(value, dict) else usual))
    return parser.parse_args()


def start(main: Callable[[], Any]) -> None:
    """Run a benchmark's main with progress on stderr; if it is interrupted,
    print one word and exit with code 130.
    """
    try:
        with showing() as shown:
            _TRACK.set(_Track(shown))
            main()
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        raise SystemExit(130) from None
