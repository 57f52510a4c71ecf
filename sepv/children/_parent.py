"""The end of a process whose parent has ended, also in a loop of compiled code,
in which no thread of Python runs.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
import time
from functools import cache
from typing import Any

_PR_SET_PDEATHSIG = 1  # prctl(2)
# Seconds between two looks at the parent, where the system has no such signal.
LOOK_AT_PARENT_SECONDS = 1.0


def end_with_parent(parent: int) -> None:
    """End this process when the process `parent` ends, at once if it has: on Linux by SIGKILL,
    else by a thread.
    """
    if told_by_signal():
        _prctl()(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        if os.getppid() != parent:
            os._exit(1)
    else:
        threading.Thread(target=_look, args=(parent,), daemon=True).start()


def told_by_signal() -> bool:
    """True if the system sends a signal when the thread ends that started a process."""
    return _prctl() is not None


@cache
def _prctl() -> Any:
    return ctypes.PyDLL(None).prctl if sys.platform == "linux" else None


def _look(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(LOOK_AT_PARENT_SECONDS)
    os._exit(1)
