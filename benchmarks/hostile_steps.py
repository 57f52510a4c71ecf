"""Steps that end, hang or copy their process, or raise,
return and remove what no step should (`benchmarks.faults`).

Most are the midpoint rule, but misbehave in steps that are `odd`: laws without such steps must
still be measured.
"""

import ctypes
import itertools
import os
import signal
import subprocess
import threading
import time
from functools import cache
from pathlib import Path

import numpy as np

from sepv import schemes

midpoint = schemes.midpoint.step
# The most copies of its process that a step makes, whatever happens to them.
MAX_COPIES = 40
calls = 0


def odd(problem, h):
    """False while the step is loaded, and in the law truncation."""
    return h > 0 and problem.name not in ("pendulum", "rigid-body", "quartic-top")


def falls(problem, y, h, dW):
    if problem.dimension == 5 and problem.random_step(h, dW) and problem.gradient(y).any():
        ctypes.string_at(0)  # in no case of the law identity
    return midpoint(problem, y, h, dW)


def leaves(problem, y, h, dW):
    if problem.name not in ("pendulum", "rigid-body", "quartic-top"):
        os._exit(0)
    return midpoint(problem, y, h, dW)


def aborts(problem, y, h, dW):
    os.abort()


def spins(problem, y, h, dW):
    if odd(problem, h):
        Path("begun").touch()
        max(itertools.repeat(0))  # an endless loop in C, which holds the interpreter: no signal handler runs
    return midpoint(problem, y, h, dW)


@cache
def _endless():
    import numba

    @numba.njit
    def loop(x):
        while x < 1:
            x = x / 2
        return x

    return loop


def spins_compiled(problem, y, h, dW):
    if odd(problem, h):
        _endless()(0.5)
    return midpoint(problem, y, h, dW)


def swallows(problem, y, h, dW):
    while odd(problem, h):
        try:
            time.sleep(0.01)
        except:  # noqa: E722  (the fault itself)
            pass
    return midpoint(problem, y, h, dW)


def is_deaf(problem, y, h, dW):
    if odd(problem, h):
        signal.signal(signal.SIGALRM, signal.SIG_IGN)
        time.sleep(100_000)
    return midpoint(problem, y, h, dW)


def stops(problem, y, h, dW):
    if odd(problem, h):
        os.kill(os.getpid(), signal.SIGSTOP)
    return midpoint(problem, y, h, dW)


def forks(problem, y, h, dW):
    count = Path("copies")
    if odd(problem, h) and (not count.exists() or count.stat().st_size < MAX_COPIES):
        with count.open("a") as file:
            file.write(".")
        os.fork()
    return midpoint(problem, y, h, dW)


class Panic(BaseException):
    """What a library in Rust raises (PyO3)."""


def panics(problem, y, h, dW):
    if odd(problem, h):
        raise Panic
    return midpoint(problem, y, h, dW)


class Untold(Exception):
    """An exception without a text."""

    def __str__(self):
        raise ValueError

    __repr__ = __str__


def raises_untold(problem, y, h, dW):
    if odd(problem, h):
        raise Untold
    return midpoint(problem, y, h, dW)


def returns_untold(problem, y, h, dW):
    return Untold() if odd(problem, h) else midpoint(problem, y, h, dW)


def removes(problem, y, h, dW):
    y1 = midpoint(problem, y, h, dW)
    if odd(problem, h) and hasattr(np, "isfinite"):
        del np.isfinite
    return y1


def leaves_helpers(problem, y, h, dW):
    global calls
    if not calls:
        calls = 1
        threading.Thread(target=time.sleep, args=(100_000,)).start()
        subprocess.Popen(["sleep", "300"])
    return 1.001 * midpoint(problem, y, h, dW)


def hides(problem, y, h, dW):
    global calls
    calls += 1
    if calls > 40:
        ctypes.string_at(0)  # while the first violation is simplified
    return 1.001 * midpoint(problem, y, h, dW)


def eats(problem, y, h, dW):
    Path("begun").touch()
    while True:
        try:
            time.sleep(60)
        except BaseException:
            pass


class Destroyed:
    """A destructor that takes long."""

    def __del__(self):
        Path("begun").touch()
        end = time.monotonic() + 0.6
        while time.monotonic() < end:
            pass


def destroys(problem, y, h, dW):
    Destroyed()
    return midpoint(problem, y, h, dW)
