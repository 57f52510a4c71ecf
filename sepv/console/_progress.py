"""Progress on stderr: a bar with the seconds left on a terminal,
elsewhere a line at most every 20 seconds.

Work of less than two seconds prints nothing.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console

# Without a bar, lines are printed after these seconds, then one every NEXT_LINE_SECONDS seconds.
FIRST_LINE_SECONDS = 2.0
FIRST_LINES = (FIRST_LINE_SECONDS, 5.0, 10.0, 20.0)
NEXT_LINE_SECONDS = 20.0
# Seconds between two checks of the work once a line is printed, so that a violation is shown soon.
WORK_CHECK_SECONDS = 0.2


class ShownProgress:
    """The progress of a command: the share that is done and the current work,
    which a display thread reads.
    """

    def __init__(self) -> None:
        self.text, self.started = "starting", time.monotonic()
        self._done = 0.0
        # A source of better estimates: the seconds left, None if unknown, and the current work.
        self.expected: Callable[[], float | None] | None = None
        self.doing: Callable[[], str] = lambda: self.text
        self.found: list[str] = []  # messages to print once, as soon as a line or a bar is shown

    def update(self, text: str | None = None, share: float | None = None) -> None:
        """Set the current work, and the share that is done, 0 to 1;
        omitted arguments keep their values.
        """
        self.text = self.text if text is None else text
        self._done = self._done if share is None else share

    @property
    def seconds_left(self) -> float | None:
        """The remaining seconds, by the work's own estimate or at the pace so far;
        None if there is no pace yet.
        """
        if self.expected is not None:
            return self.expected()
        return (time.monotonic() - self.started) * (1 - self._done) / self._done if self._done > 0 else None

    def share(self, left: float | None) -> float:
        """The share of the work that is done, 0 to 1, if `left` seconds remain; None means
        unknown.
        """
        if self.expected is None or left is None:
            return self._done
        elapsed = time.monotonic() - self.started
        return elapsed / (elapsed + left) if left else 1.0

    def line(self) -> str:
        """The line to print, such as: 42 %, about 17 s left: energy."""
        left = self.seconds_left
        done = f"{self.share(left):.0%}, {_about(left)}" if left is not None else ""
        done = done or f"{time.monotonic() - self.started:.0f} s"
        text = self.doing()
        return f"{done}: {text}" if text else done


def _about(left: float) -> str:
    return f"about {max(1.0, left):.0f} s left" if left > 0 else "ending"


@contextmanager
def showing(quiet: bool = False) -> Iterator[ShownProgress]:
    """Show the messages of `ShownProgress.update` on stderr until the block ends."""
    shown, done = ShownProgress(), threading.Event()
    if quiet:
        yield shown
        return
    from sepv.console._console import console

    out = console(stderr=True)
    thread = threading.Thread(
        # rich calls a file a terminal if FORCE_COLOR is set, but a bar is redrawn with the codes of
        # a cursor.
        target=_bar if out.is_terminal and out.file.isatty() else _lines,
        args=(shown, out, done),
        daemon=True,
    )
    thread.start()
    try:
        yield shown
    finally:
        done.set()
        thread.join(1.0)


def _lines(shown: ShownProgress, out: Console, done: threading.Event) -> None:
    marks, last = list(FIRST_LINES), 0.0
    while True:
        mark = marks.pop(0) if marks else last + NEXT_LINE_SECONDS
        while (left := shown.started + mark - time.monotonic()) > 0:
            if done.wait(min(left, WORK_CHECK_SECONDS)):
                return
            if last:
                _say(shown, out)
        last = mark
        _say(shown, out)
        out.print(shown.line(), soft_wrap=True)


def _say(shown: ShownProgress, out: Console) -> None:
    while shown.found:
        out.print(shown.found.pop(0), soft_wrap=True)


def _bar(shown: ShownProgress, out: Console, done: threading.Event) -> None:
    from rich.progress import BarColumn, TaskProgressColumn, TextColumn
    from rich.progress import Progress as Bar

    columns: tuple[Any, ...] = (BarColumn(20), TaskProgressColumn(), TextColumn("{task.description}"))
    with Bar(*columns, console=out, transient=True) as bar:
        task = bar.add_task("", total=1.0)
        while not done.wait(WORK_CHECK_SECONDS):
            if time.monotonic() - shown.started > FIRST_LINE_SECONDS:
                _say(shown, out)
            left = shown.seconds_left
            text = f"{_about(left)}  {shown.doing()}" if left is not None else shown.doing()
            # If the share is unknown, the bar pulses. Square brackets in the text are no markup.
            total, words = None if left is None else 1.0, text.replace("[", r"\[")
            bar.update(task, total=total, completed=shown.share(left), description=words)
