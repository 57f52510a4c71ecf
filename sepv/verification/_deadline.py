"""A limit of time for code that may not come back."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


class TimedOut(BaseException):
    """Raised in a scheme that does not come back; not an Exception, so that no handler of its own keeps it."""


@contextmanager
def deadline(seconds: float) -> Iterator[None]:
    """`TimedOut` is raised in what runs here for longer, in the main thread of a POSIX system; elsewhere nothing is."""
    if not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(*_: Any) -> None:
        raise TimedOut

    before = signal.signal(signal.SIGALRM, stop)
    # Again and again, in case the scheme swallows the first one.
    signal.setitimer(signal.ITIMER_REAL, seconds, 1.0)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
