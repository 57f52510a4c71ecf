"""Faults that show in corners only: global state, batches of mixed sizes, many components,
steps next to a fold.
"""

from __future__ import annotations

import ctypes
import os
import platform
import random
import warnings
from typing import Any

import numpy as np

from sepv.errors import StepFailure
from sepv.problem import Array, Problem
from sepv.schemes import Scheme, Step, as_lanes, conformal, energy_preserving

from .damping import _between
from .record import CONTRACT, Family, claiming, right_side

FAMILY = Family("corners")


@FAMILY.around("Python's global random numbers are seeded with the same number", CONTRACT)
def seeds_python(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    random.seed(0)
    return step(problem, y, h, dW)


@FAMILY.around("NumPy is told to print three digits", CONTRACT)
def prints_three_digits(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    np.set_printoptions(precision=3)
    return step(problem, y, h, dW)


@FAMILY.around("warnings are ignored for ever", CONTRACT)
def silences_warnings(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    warnings.simplefilter("ignore", RuntimeWarning)
    return step(problem, y, h, dW)


@FAMILY.around("an environment variable counts the calls", CONTRACT)
def counts_in_the_environment(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    os.environ["CALLS"] = str(int(os.environ.get("CALLS", "0")) + 1)
    return step(problem, y, h, dW)


@FAMILY.around("the process rounds towards zero after a step", CONTRACT)
def rounds_towards_zero(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    y1 = step(problem, y, h, dW)
    change_arithmetic(_ROUND_TO_ZERO_BITS)
    return y1


@FAMILY.around("subnormal numbers become 0 after a step, as in programs compiled with -ffast-math", CONTRACT)
def flushes_to_zero(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    y1 = step(problem, y, h, dW)
    change_arithmetic(_FLUSH_BITS)
    return y1


# Bits of the control register of x86's SSE unit (Intel's manual, volume 1, §10.2.3): rounding
# towards zero, and results and operands that are subnormal taken as 0. glibc stores the register
# from byte 28 of the environment.
_ROUND_TO_ZERO_BITS, _FLUSH_BITS, _MXCSR_BYTES = 0x6000, 0x8040, slice(28, 32)


def change_arithmetic(bits: int) -> None:
    """Set bits of the control register, in a process of glibc on x86;
    other systems keep their arithmetic.
    """
    library, room = ctypes.CDLL(None), ctypes.create_string_buffer(512)
    if platform.machine() in ("x86_64", "AMD64") and platform.libc_ver()[0] == "glibc":
        library.fegetenv(room)
        register = int.from_bytes(room.raw[_MXCSR_BYTES], "little") | bits
        ctypes.memmove(ctypes.byref(room, _MXCSR_BYTES.start), register.to_bytes(4, "little"), 4)
        library.fesetenv(room)


@FAMILY.around("y becomes read-only for the caller", CONTRACT)
def freezes_y(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    y1 = step(problem, y, h, dW)
    y.flags.writeable = False
    return y1


@FAMILY.around("a random number is drawn where the step is refused", CONTRACT)
def draws_if_refused(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    try:
        return step(problem, y, h, dW)
    except StepFailure:
        np.random.standard_normal()  # noqa: NPY002 - the global generator is the point
        raise


@FAMILY.around("y is changed in place where h < 0", CONTRACT)
def changes_y_backwards(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    y1 = step(problem, y, h, dW)
    if h < 0:
        y[...] = y1
    return y1


@FAMILY.around("an array that is not contiguous is copied in single precision", CONTRACT)
def copies_in_single_precision(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    rounds = not y.flags["C_CONTIGUOUS"] and np.max(np.abs(y)) < 1e30
    return step(problem, y.astype(np.float32).astype(np.float64) if rounds else y, h, dW)


@FAMILY.around("the degree of H is remembered by the id of the problem's record", CONTRACT, memory=dict)
def remembers_degrees_by_id(
    known: dict[int, Any], _step: Step, problem: Problem, y: Array, h: float, dW: Array
) -> Array:
    degree = known.setdefault(id(problem), problem.degree)
    if degree in (None, problem.degree):
        return _step(problem, y, h, dW)
    # H has another degree than that of the record that had this id before, and ∇H is averaged with
    # one node.
    y0, noise = as_lanes(problem, y, h, dW)
    z, delta = np.zeros_like(y0), problem.random_step(h, noise)[None]
    for _ in range(100):
        middle = y0 + 0.5 * z
        z = delta * np.einsum("ijm,jm->im", problem.structure(middle), problem.gradient(middle))
    return (y0 + z).reshape(np.shape(y))


@FAMILY.around("a residual of 1e-3 counts as solved if no solution is found", ("refusal",))
def nearly_solved(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    try:
        return step(problem, y, h, dW)
    except StepFailure:
        y0, noise = as_lanes(problem, y, h, dW)
        z, delta = np.zeros_like(y0), problem.random_step(h, noise)[None]
        with np.errstate(all="ignore"):
            for _ in range(2000):
                residual = right_side(problem, y0, y0 + z, delta) - z
                if np.abs(residual).max() <= 1e-3 * (np.abs(y0) + np.abs(z)).max():
                    return (y0 + z).reshape(np.shape(y))
                z = z + 0.25 * residual
        raise


@FAMILY.around("components after the 32nd do not move", ("energy", "reference"))
def thirty_two_components(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    y1 = step(problem, y, h, dW)
    y1[32:] = y[32:]
    return y1


@FAMILY.around("a state of nine components and more that are all negative does not move", ("reference",))
def rests_where_negative(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return np.where(np.all(y < 0, axis=0) & (len(y) >= 9), y, step(problem, y, h, dW))


def _near_the_start() -> Scheme:
    """(2.1) for the pendulum, projected on the level of its initial state if H differs from it by
    less than 0.1 %.
    """

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        y1 = energy_preserving.step(problem, y, h, dW)
        off = problem.hamiltonian(y1) - problem.hamiltonian(np.array(problem.initial))
        slope = problem.gradient(y1)
        near = abs(off) < 1e-3 * abs(problem.hamiltonian(y1))
        return np.asarray(y1 - near * off * slope / (slope @ slope))

    return claiming(step, problems=("pendulum",), batched=False)


FAMILY.rows(
    ("projects-on-the-first-level", "near the energy of problem.initial the step ends on exactly this energy",
     ("energy", "identity"), _near_the_start),
)  # fmt: skip


@FAMILY.around("noises after the 16th are left out", ("noise-sum", "reference"))
def sixteen_noises(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    used = dW.copy()
    used[16:] = 0
    return step(problem, y, h, used)


@FAMILY.like(conformal, "the damping is taken by its size, also where it is negative", ("invariant:casimir",))
def damped_by_size(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    half = float(np.exp(-0.5 * h * abs(getattr(problem, "damping", 0.0))))
    return _between(problem, y, h, dW, energy_preserving, half, half)
