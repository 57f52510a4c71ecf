"""Faults of the interface: single calls are right, but a step has side effects, fails in batches,
or breaks types.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import count
from typing import Any

import numpy as np

from sepv.errors import StepFailure
from sepv.problem import Array, Problem
from sepv.schemes import Step, as_lanes, implicit

from .formula import b_at_y0
from .record import CONTRACT, Family, answering, right_side

FAMILY = Family("interface")
# The memory of a saboteur between calls.
Memory = dict[Any, Array]
Calls = Iterator[int]


@FAMILY.around("y is changed in place", CONTRACT)
def changes_y(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    y += step(problem, y, h, dW) - y
    return y


@FAMILY.around("dW is multiplied by c in place", CONTRACT)
def changes_increments(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    dW *= problem.c.reshape(-1, *(1,) * (dW.ndim - 1))
    return step(replace(problem, noise=np.ones(problem.noises), check=False), y, h, dW)


@FAMILY.around("the answer is a buffer that the next call overwrites", CONTRACT, memory=dict)
def returns_a_buffer(buffers: Memory, step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    buffer = buffers.setdefault(y.shape, np.empty(y.shape))
    buffer[...] = step(problem, y, h, dW)
    return buffer


@FAMILY.around(
    "answers are remembered by h and dW, whatever y", ("contract", "energy", "reference"), memory=dict
)
def remembers_without_y(
    answers: Memory, step: Step, problem: Problem, y: Array, h: float, dW: Array, most: int = 1000
) -> Array:
    key = (problem.data, y.shape, h, dW.tobytes())  # and not y
    if key not in answers:
        answer = step(problem, y, h, dW)
        if len(answers) > most:
            answers.clear()
        answers[key] = answer
    return answers[key].copy()


# The law *energy* is not named, because a step that repeats the last answer keeps the energy.
@FAMILY.around(
    "the last answer is given again for the same h and dW, whatever y", ("contract", "reference"), memory=dict
)
def remembers_the_last(last: Memory, step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return remembers_without_y(last, step, problem, y, h, dW, most=0)


@FAMILY.around("y1 − y0 is remembered while y is the same array object", CONTRACT, memory=dict)
def remembers_the_array(
    last: dict[str, Any], step: Step, problem: Problem, y: Array, h: float, dW: Array
) -> Array:
    key = (id(problem), h, dW.tobytes())
    if last.get("y") is not y or last["key"] != key:
        last.update(y=y, key=key, move=step(problem, y, h, dW) - y)
    return y + last["move"]


@FAMILY.around("the iteration starts from where the last call ended", CONTRACT, memory=dict)
def warm_started(last: Memory, _step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Start the fixed-point iteration from the last result,
    so that y1 differs in its last bits between equal calls.
    """
    y0, noise = as_lanes(problem, y, h, dW)
    guess = last.get("z")
    z = guess if guess is not None and guess.shape == y0.shape else np.zeros_like(y0)
    z = 1e-3 * z / (1 + np.max(np.abs(z))) * np.max(np.abs(y0))
    delta = problem.random_step(h, noise)[None]
    for _ in range(80):
        z, before = right_side(problem, y0, y0 + z, delta), z
        if np.array_equal(z, before):
            break
    last["z"] = z
    return (y0 + z).reshape(np.shape(y))


@FAMILY.around("y1 has an error of up to 1e-12 that depends on the clock", CONTRACT)
def depends_on_time(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return step(problem, y, h, dW) * (1 + 1e-15 * (time.perf_counter_ns() % 1000))


@FAMILY.around("the last bit is drawn at random", CONTRACT, memory=lambda: np.random.default_rng(1))
def dithered(rng: np.random.Generator, step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    y1 = step(problem, y, h, dW)
    return np.where(rng.random(y1.shape) < 0.5, np.nextafter(y1, 0.0), y1)


@FAMILY.around("each hundredth call returns y0", CONTRACT, memory=lambda: count(1))
def hundredth_call(calls: Calls, step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return y * 1.0 if next(calls) % 100 == 0 else step(problem, y, h, dW)


@FAMILY.around("each thousandth call is an ulp off", CONTRACT, memory=lambda: count(1))
def thousandth_call(calls: Calls, step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    off = next(calls) % 1000 == 0
    y1 = step(problem, y, h, dW)
    return np.nextafter(y1, 0.0) if off else y1


@FAMILY.around("NumPy's global random numbers are seeded", CONTRACT)
def reseeds(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    np.random.seed(20140203)  # noqa: NPY002 - the global generator is the point
    return step(problem, y, h, dW)


@FAMILY.around("y is changed in place where it is a batch", CONTRACT)
def changes_y_in_batches(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return step(problem, y, h, dW) if y.ndim == 1 else changes_y(step, problem, y, h, dW)


@FAMILY.around("the answer to a batch is a buffer that the next call overwrites", CONTRACT, memory=dict)
def returns_a_buffer_in_batches(
    buffers: Memory, step: Step, problem: Problem, y: Array, h: float, dW: Array
) -> Array:
    return step(problem, y, h, dW) if y.ndim == 1 else returns_a_buffer(buffers, step, problem, y, h, dW)


@FAMILY.around("the c_j are remembered by the id of the problem's record", CONTRACT, memory=dict)
def remembers_by_id(known: Memory, step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    c = known.setdefault(id(problem), problem.c)
    if c.shape != problem.c.shape or np.array_equal(c, problem.c):
        return step(problem, y, h, dW)
    return step(replace(problem, noise=c, check=False), y, h, dW)


@FAMILY.around("results are remembered by the id of the problem, y, h and Δ", CONTRACT, memory=dict)
def remembers_steps_by_id(
    known: Memory, step: Step, problem: Problem, y: Array, h: float, dW: Array
) -> Array:
    key = (id(problem), y.shape, y.tobytes(), h, np.asarray(problem.random_step(h, dW)).tobytes())
    if key not in known:
        known[key] = step(problem, y, h, dW)
    return np.array(known[key])


@FAMILY.around("NumPy is told to ignore overflow, for ever", CONTRACT)
def sets_error_handling(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    np.seterr(over="ignore")
    return step(problem, y, h, dW)


@FAMILY.around("NumPy is told to print four digits, or five where these were four", CONTRACT)
def sets_print_options(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    np.set_printoptions(precision=4 + (np.get_printoptions()["precision"] == 4))
    return step(problem, y, h, dW)


@FAMILY.around("what is left of a batch after blocks of 32 is not stepped", ("reproducibility",))
def whole_blocks_only(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    y1 = step(problem, y, h, dW)
    if y.ndim == 2 and y.shape[1] > 32:
        rest = y.shape[1] // 32 * 32
        y1[:, rest:] = y[:, rest:]
    return y1


@FAMILY.around("the first state of a batch is rounded otherwise", ("reproducibility",))
def first_of_a_batch(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    y1 = step(problem, y, h, dW)
    if y.ndim == 2 and y.shape[1] > 1:
        y1[:, 0] = np.nextafter(y1[:, 0], 0.0)
    return y1


@FAMILY.around("0/0 where a component does not move", ("contract", "identity"))
def nan_at_rest(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    move = step(problem, y, h, dW) - y
    with np.errstate(all="ignore"):
        return y + move * (move / move)


@FAMILY.around("a rest point at 0 is returned as integers", CONTRACT)
def integers_at_rest(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    y1 = step(problem, y, h, dW)
    return y1 if np.any(y1) else np.zeros(y.shape, dtype=np.int64)


@FAMILY.around("the answer is a column where the problem has no noise", CONTRACT)
def column_without_noise(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    y1 = step(problem, y, h, dW)
    return y1 if problem.noises else y1.reshape(*y1.shape, 1)


FAMILY.rows(
    ("returns-float32", "the answer is of single precision", CONTRACT, lambda _, y1: y1.astype(np.float32)),
    ("returns-complex", "the answer is complex", CONTRACT, lambda _, y1: y1.astype(np.complex128)),
    ("returns-a-list", "the answer is a list", CONTRACT, lambda _, y1: y1.tolist()),
    by=answering,
)  # fmt: skip


@FAMILY.around("the step is not made where Δ < 0", ("energy", "reference"))
def refuses_negative_steps(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    delta = np.min(problem.random_step(h, dW))
    if delta < 0:
        raise StepFailure(
            problem=problem.name, y=y, delta=float(delta), residual=1.0, status="Δ < 0", iterations=0
        )
    return step(problem, y, h, dW)


@FAMILY.around("the step raises IndexError for d > 4", ("energy", "reference"))
def crashes_beyond_four(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    if problem.dimension > 4:
        raise IndexError("index 4 is out of bounds for axis 0 with size 4")
    return step(problem, y, h, dW)


@FAMILY.around(
    "B is taken at y0 in a batch of more than eight",
    ("reproducibility", "mean-square-order", "right-limit"),
    memory=lambda: implicit(b_at_y0),
)
def small_batches_only(wrong: Step, step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return (wrong if y.ndim == 2 and y.shape[1] > 8 else step)(problem, y, h, dW)


@FAMILY.around("a batch of d states is taken for its transpose", ("reproducibility",))
def square_batch(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    if y.ndim == 2 and y.shape[0] == y.shape[1]:
        return step(problem, y.T.copy(), h, dW).T.copy()
    return step(problem, y, h, dW)


@FAMILY.around(
    "all states of a batch get the increments of the first",
    ("reproducibility", "mean-square-order", "right-limit"),
)
def first_lane_only(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    same = np.repeat(dW[:, :1], y.shape[1], axis=1) if y.ndim == 2 else dW
    return step(problem, y, h, same)


@FAMILY.around("rounding depends on the other states of the batch", ("reproducibility",))
def scaled_by_the_batch(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    y1 = step(problem, y, h, dW)
    size = np.mean(np.abs(y1)) if y1.ndim == 2 else 1.0
    return y1 / size * size if size else y1


@FAMILY.around("answers are remembered by y in single precision", CONTRACT, memory=dict)
def remembers_digits(
    answers: dict[Any, Array], step: Step, problem: Problem, y: Array, h: float, dW: Array
) -> Array:
    key = (problem.data, y.shape, y.astype(np.float32).tobytes(), h, dW.tobytes())
    if key not in answers:
        answers.clear()
        answers[key] = step(problem, y, h, dW)
    return answers[key].copy()


@FAMILY.around("a step that was refused once returns y0 the next time", CONTRACT, memory=set)
def refuses_once(refused: set[Any], step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    key = (y.tobytes(), h, dW.tobytes())
    try:
        return step(problem, y, h, dW)
    except StepFailure:
        if key in refused:
            return y.copy()
        refused.add(key)
        raise


@FAMILY.around("y is scratch space while the step is made, and then restored", CONTRACT)
def writes_and_restores(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    before = y.copy()
    y1 = step(problem, before, h, dW)
    y[...] = 0.5 * (before + y1)
    y[...] = before
    return y1


@FAMILY.around("the memory of y is read as if nothing were left out of it", CONTRACT)
def reads_memory(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    memory = y if y.base is None else y.base
    return step(problem, np.ravel(memory, order="K")[: y.size].reshape(y.shape), h, dW)


@FAMILY.around("each state whose number is a multiple of 5000 is off by an ulp", CONTRACT, memory=lambda: [0])
def off_each_five_thousandth(
    number: list[int], step: Step, problem: Problem, y: Array, h: float, dW: Array
) -> Array:
    before, y1 = number[0] // 5000, step(problem, y, h, dW)
    number[0] += y.size // len(y)
    return np.nextafter(y1, np.inf) if number[0] // 5000 > before else y1
