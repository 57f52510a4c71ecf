"""What is going on, on stderr: a bar with the seconds left on a terminal, else a line now and then.

Nothing that takes longer than two seconds is silent, piped or not; what is done sooner says nothing.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from rich.console import Console

from sepv.verification import Finding, Law
from sepv.verification._report import console
from sepv.verification._verify import LawProgress

# Seconds after which a line is printed where nobody sees a bar; then one every REPEAT.
FIRST_LINES = (2.0, 5.0, 10.0, 20.0)
REPEAT = 20.0


class Shown:
    """The share that is done, None where nobody knows, and what is being done; read by whoever shows it."""

    def __init__(self) -> None:
        self.text, self.share, self.started = "starting", 0.0, time.monotonic()

    def update(self, text: str | None = None, share: float | None = None) -> None:
        """What is being done, and how much of all is done, 0 to 1; what is left out stays as it was."""
        self.text = self.text if text is None else text
        self.share = self.share if share is None else share

    @property
    def seconds_left(self) -> float | None:
        """At the pace so far; None where there is no pace yet."""
        return (time.monotonic() - self.started) * (1 - self.share) / self.share if self.share > 0 else None

    def line(self) -> str:
        """42 %, about 17 s left: energy."""
        left = self.seconds_left
        known = f"{self.share:.0%}, {_about(left)}" if left is not None else ""
        elapsed = f"{time.monotonic() - self.started:.0f} s"
        return f"{known or elapsed}: {self.text}" if self.text else known or elapsed


def _about(left: float) -> str:
    return f"about {max(1.0, left):.0f} s left" if left > 0 else "ending"


@contextmanager
def showing(quiet: bool = False) -> Iterator[Shown]:
    """What `Shown.update` is told appears on stderr until the block ends."""
    shown, done = Shown(), threading.Event()
    if quiet:
        yield shown
        return
    out = console(stderr=True)
    thread = threading.Thread(
        target=_bar if out.is_terminal else _lines, args=(shown, out, done), daemon=True
    )
    thread.start()
    try:
        yield shown
    finally:
        done.set()
        thread.join(1.0)


def _lines(shown: Shown, out: Console, done: threading.Event) -> None:
    marks, last = list(FIRST_LINES), 0.0
    while True:
        mark = marks.pop(0) if marks else last + REPEAT
        last = mark
        if done.wait(max(0.0, shown.started + mark - time.monotonic())):
            return
        out.print(shown.line(), soft_wrap=True)


def _bar(shown: Shown, out: Console, done: threading.Event) -> None:
    from rich.progress import BarColumn, TaskProgressColumn, TextColumn
    from rich.progress import Progress as Bar

    columns: tuple[Any, ...] = (BarColumn(20), TaskProgressColumn(), TextColumn("{task.description}"))
    with Bar(*columns, console=out, transient=True) as bar:
        task = bar.add_task("", total=1.0)
        while not done.wait(0.2):
            left = shown.seconds_left
            text = f"{_about(left)}  {shown.text}" if left is not None else shown.text
            # No square bracket is markup here.
            bar.update(task, completed=shown.share, description=text.replace("[", r"\["))


@contextmanager
def watching(quiet: bool = False, laws: Sequence[Law] = ()) -> Iterator[LawProgress]:
    """A progress callback for `sepv.verification.verify` of these laws, each of which counts by its cost."""
    whole = sum(law.cost for law in laws)
    with showing(quiet) as shown:
        running: list[str] = []
        finished: dict[str, float] = {}

        def step(law: Law, finding: Finding | None) -> None:
            if finding is None:
                running.append(law.name)
            else:
                running[:] = [name for name in running if name != law.name]
                finished[law.name] = law.cost
            text = f"{len(finished)} of {len(laws)} laws, {', '.join(running)}".rstrip(", ")
            shown.update(text, min(1.0, sum(finished.values()) / whole))

        yield step
