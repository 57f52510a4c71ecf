"""Time limits within a process, and the end of a copy of the process that a scheme's fork made."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from mmap import mmap
from typing import Any

# Seconds between two interruptions, in case a step swallows one.
INTERRUPT_AGAIN_SECONDS = 1.0
# The exit code of a copy.
COPY_EXIT_CODE = 71


class TimedOut(BaseException):
    """Raised in a scheme that does not return. Not an Exception,
    so that no handler in the scheme catches it.
    """


@contextmanager
def deadline(seconds: float) -> Iterator[None]:
    """Raise `TimedOut` in a block that runs longer than `seconds`,
    and again each second until it ends.

    It interrupts Python code: in the main thread of a POSIX system also a call that waits, in other
    threads at the next line. It does not end a loop in compiled code, nor a block that catches
    every exception. Processes that measure for others have a second limit, which kills
    (`TimeLimit`); of others another process says what to do (`overheard`).
    """
    main = threading.current_thread() is threading.main_thread()
    with (_by_signal if main and hasattr(signal, "setitimer") else _by_thread)(seconds):
        yield


@contextmanager
def _by_signal(seconds: float) -> Iterator[None]:
    def stop(*_: Any) -> None:
        raise TimedOut

    def unraisable(lost: Any) -> None:
        if lost.exc_type is not TimedOut:  # a destructor swallowed it, and the next one follows
            hook(lost)

    before, hook = signal.signal(signal.SIGALRM, stop), sys.unraisablehook
    sys.unraisablehook = unraisable
    signal.setitimer(signal.ITIMER_REAL, seconds, INTERRUPT_AGAIN_SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
        sys.unraisablehook = hook


@contextmanager
def _by_thread(seconds: float) -> Iterator[None]:
    import ctypes  # only here, because it is slow to load

    raise_in, me = ctypes.pythonapi.PyThreadState_SetAsyncExc, ctypes.c_ulong(threading.get_ident())
    over, lock = threading.Event(), threading.Lock()

    def ring() -> None:
        left = seconds
        while not over.wait(min(left, threading.TIMEOUT_MAX)):
            left = INTERRUPT_AGAIN_SECONDS
            with lock:
                if not over.is_set():
                    raise_in(me, ctypes.py_object(TimedOut))

    threading.Thread(target=ring, daemon=True).start()
    try:
        yield
    finally:
        # What was raised after the block and did not arrive yet must not arrive later.
        while not over.is_set():
            with suppress(TimedOut), lock:
                over.set()
        with suppress(TimedOut):
            raise_in(me, None)


@cache
def _shared() -> mmap:
    return mmap(-1, 1)  # a copy of this process shares it


@contextmanager
def one_process() -> Iterator[None]:
    """A context for calls of a scheme: if the scheme forks,
    and its copy of this process comes back too, the copy ends.

    A copy would go on as a second run. `returned_twice` then says so to the process itself.
    """
    owner, told = os.getpid(), _shared()
    try:
        yield
    finally:
        if os.getpid() != owner:
            told[0] = 1
            os._exit(COPY_EXIT_CODE)


def returned_twice() -> bool:
    """True if a copy has come back from a call of the scheme since the last question."""
    told = _shared()
    seen, told[0] = told[0], 0
    return bool(seen)
