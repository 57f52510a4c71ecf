"""Faults of the interface: right numbers, asked once and alone; not pure, not for a batch, not as agreed."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from sepv.errors import StepFailure
from sepv.faults._saboteurs.formula import _b_at_y0
from sepv.faults._saboteurs.record import Saboteur, around, right_side
from sepv.problem import Array, Problem
from sepv.schemes import implicit
from sepv.schemes._scheme import Step, as_lanes

_CONTRACT = ("contract",)


def _in_place(step: Step) -> Step:
    def changing(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        y += step(problem, y, h, dW) - y
        return y

    return changing


def _scaled_in_place(step: Step) -> Step:
    def changing(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        dW *= problem.c.reshape(-1, *(1,) * (dW.ndim - 1))
        return step(replace(problem, noise=np.ones(problem.noises), check=False), y, h, dW)

    return changing


def _buffered(step: Step) -> Step:
    buffers: dict[tuple[int, ...], Array] = {}

    def answering(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        buffer = buffers.setdefault(y.shape, np.empty(y.shape))
        buffer[...] = step(problem, y, h, dW)
        return buffer

    return answering


def _remembering(step: Step) -> Step:
    answers: dict[Any, Array] = {}

    def answering(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        key = (problem.data, y.shape, h, dW.tobytes())  # and not y
        if key not in answers:
            if len(answers) > 1000:
                answers.clear()
            answers[key] = step(problem, y, h, dW)
        return answers[key].copy()

    return answering


def _last_only(step: Step) -> Step:
    last: dict[str, Any] = {}

    def answering(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        key = (problem.data, y.shape, h, dW.tobytes())
        if last.get("key") != key:
            last.update(key=key, answer=step(problem, y, h, dW))
        answer: Array = last["answer"]
        return answer.copy()

    return answering


def _warm_started(_: Step) -> Step:
    """Newton's iteration, from where the last call ended. Converged; but not to the same bits."""
    last: dict[str, Array] = {}

    def answering(problem: Problem, y: Array, h: float, dW: Array) -> Array:
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

    return answering


def _timed(step: Step) -> Step:
    return lambda problem, y, h, dW: step(problem, y, h, dW) * (1 + 1e-15 * (time.perf_counter_ns() % 1000))


def _dithered(step: Step) -> Step:
    rng = np.random.default_rng(1)

    def answering(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        y1 = step(problem, y, h, dW)
        return np.where(rng.random(y1.shape) < 0.5, np.nextafter(y1, 0.0), y1)

    return answering


def _hundredth(step: Step) -> Step:
    calls = [0]

    def answering(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        calls[0] += 1
        return y * 1.0 if calls[0] % 100 == 0 else step(problem, y, h, dW)

    return answering


def _thousandth(step: Step) -> Step:
    calls = [0]

    def answering(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        calls[0] += 1
        y1 = step(problem, y, h, dW)
        return np.nextafter(y1, 0.0) if calls[0] % 1000 == 0 else y1

    return answering


def _reseeding(step: Step) -> Step:
    def answering(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        np.random.seed(20140203)  # noqa: NPY002 - the global generator is the point
        return step(problem, y, h, dW)

    return answering


def _divided(step: Step) -> Step:
    def answering(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        move = step(problem, y, h, dW) - y
        with np.errstate(all="ignore"):
            return y + move * (move / move)

    return answering


def _column(step: Step) -> Step:
    def answering(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        y1 = step(problem, y, h, dW)
        return y1 if problem.noises else y1.reshape(*y1.shape, 1)

    return answering


def _returning(convert: Any) -> Any:
    return lambda step: lambda problem, y, h, dW: convert(step(problem, y, h, dW))


def _refusing(step: Step) -> Step:
    def answering(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        delta = np.min(problem.random_step(h, dW))
        if delta < 0:
            raise StepFailure(
                problem=problem.name, y=y, delta=float(delta), residual=1.0, status="Δ < 0", iterations=0
            )
        return step(problem, y, h, dW)

    return answering


def _at_most_four(step: Step) -> Step:
    def answering(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        if problem.dimension > 4:
            raise IndexError("index 4 is out of bounds for axis 0 with size 4")
        return step(problem, y, h, dW)

    return answering


def _small_batches(step: Step) -> Step:
    wrong = implicit(_b_at_y0)

    def answering(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        return (wrong if y.ndim == 2 and y.shape[1] > 8 else step)(problem, y, h, dW)

    return answering


def _square_batch(step: Step) -> Step:
    def answering(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        if y.ndim == 2 and y.shape[0] == y.shape[1]:
            return step(problem, y.T.copy(), h, dW).T.copy()
        return step(problem, y, h, dW)

    return answering


def _first_lane(step: Step) -> Step:
    def answering(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        same = np.repeat(dW[:, :1], y.shape[1], axis=1) if y.ndim == 2 else dW
        return step(problem, y, h, same)

    return answering


def _in_place_in_batches(step: Step) -> Step:
    changing = _in_place(step)
    return lambda problem, y, h, dW: (step if y.ndim == 1 else changing)(problem, y, h, dW)


def _buffered_in_batches(step: Step) -> Step:
    answering = _buffered(step)
    return lambda problem, y, h, dW: (step if y.ndim == 1 else answering)(problem, y, h, dW)


def _by_id(step: Step) -> Step:
    known: dict[int, Array] = {}

    def answering(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        c = known.setdefault(id(problem), problem.c)
        if c.shape != problem.c.shape or np.array_equal(c, problem.c):
            return step(problem, y, h, dW)
        return step(replace(problem, noise=c, check=False), y, h, dW)

    return answering


def _unhandled(step: Step) -> Step:
    def answering(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        np.seterr(over="ignore")
        return step(problem, y, h, dW)

    return answering


def _whole_blocks(step: Step) -> Step:
    def answering(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        y1 = step(problem, y, h, dW)
        if y.ndim == 2 and y.shape[1] > 32:
            rest = y.shape[1] // 32 * 32
            y1[:, rest:] = y[:, rest:]
        return y1

    return answering


def _first_of_a_batch(step: Step) -> Step:
    def answering(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        y1 = step(problem, y, h, dW)
        if y.ndim == 2 and y.shape[1] > 1:
            y1[:, 0] = np.nextafter(y1[:, 0], 0.0)
        return y1

    return answering


def _scaled_by_the_batch(step: Step) -> Step:
    def answering(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        y1 = step(problem, y, h, dW)
        size = np.mean(np.abs(y1)) if y1.ndim == 2 else 1.0
        return y1 / size * size if size else y1

    return answering


_TABLE = (
    ("changes-y", "y is changed in place", around(_in_place), _CONTRACT),
    ("changes-increments", "dW is multiplied by c in place", around(_scaled_in_place), _CONTRACT),
    (
        "returns-a-buffer",
        "the answer is a buffer that the next call overwrites",
        around(_buffered),
        _CONTRACT,
    ),
    (
        "remembers-without-y",
        "answers are remembered by h and dW, whatever y",
        around(_remembering),
        ("contract", "energy", "reference"),
    ),
    (
        "remembers-the-last",
        "the last answer is given again for the same h and dW, whatever y",
        around(_last_only),
        # Not energy: a step that repeats the last answer keeps it.
        ("contract", "reference"),
    ),
    ("warm-started", "the iteration starts from where the last call ended", around(_warm_started), _CONTRACT),
    (
        "depends-on-time",
        "y1 has an error of up to 1e-12 that depends on the clock",
        around(_timed),
        _CONTRACT,
    ),
    ("dithered", "the last bit is drawn at random", around(_dithered), _CONTRACT),
    ("hundredth-call", "each hundredth call returns y0", around(_hundredth), _CONTRACT),
    ("thousandth-call", "each thousandth call is an ulp off", around(_thousandth), _CONTRACT),
    ("reseeds", "NumPy's global random numbers are seeded", around(_reseeding), _CONTRACT),
    (
        "changes-y-in-batches",
        "y is changed in place where it is a batch",
        around(_in_place_in_batches),
        _CONTRACT,
    ),
    (
        "returns-a-buffer-in-batches",
        "the answer to a batch is a buffer that the next call overwrites",
        around(_buffered_in_batches),
        _CONTRACT,
    ),
    (
        "remembers-by-id",
        "the c_j are remembered by the id of the problem's record",
        around(_by_id),
        _CONTRACT,
    ),
    ("sets-error-handling", "NumPy is told to ignore overflow, for ever", around(_unhandled), _CONTRACT),
    (
        "whole-blocks-only",
        "what is left of a batch after blocks of 32 is not stepped",
        around(_whole_blocks),
        ("reproducibility",),
    ),
    (
        "first-of-a-batch",
        "the first state of a batch is rounded otherwise",
        around(_first_of_a_batch),
        ("reproducibility",),
    ),
    ("nan-at-rest", "0/0 where a component does not move", around(_divided), ("contract", "identity")),
    (
        "column-without-noise",
        "the answer is a column where the problem has no noise",
        around(_column),
        _CONTRACT,
    ),
    (
        "returns-float32",
        "the answer is of single precision",
        around(_returning(lambda y: y.astype(np.float32))),
        _CONTRACT,
    ),
    (
        "returns-complex",
        "the answer is complex",
        around(_returning(lambda y: y.astype(np.complex128))),
        _CONTRACT,
    ),
    ("returns-a-list", "the answer is a list", around(_returning(lambda y: y.tolist())), _CONTRACT),
    (
        "refuses-negative-steps",
        "the step is not made where Δ < 0",
        around(_refusing),
        ("energy", "reference"),
    ),
    (
        "crashes-beyond-four",
        "the step raises IndexError for d > 4",
        around(_at_most_four),
        ("energy", "reference"),
    ),
    (
        "small-batches-only",
        "B is taken at y0 in a batch of more than eight",
        around(_small_batches),
        ("reproducibility", "mean-square-order", "right-limit"),
    ),
    (
        "square-batch",
        "a batch of d states is taken for its transpose",
        around(_square_batch),
        ("reproducibility",),
    ),
    (
        "first-lane-only",
        "all states of a batch get the increments of the first",
        around(_first_lane),
        ("reproducibility", "mean-square-order", "right-limit"),
    ),
    (
        "scaled-by-the-batch",
        "rounding depends on the other states of the batch",
        around(_scaled_by_the_batch),
        ("reproducibility",),
    ),
)

SABOTEURS = tuple(Saboteur(name, "interface", broken, make, laws) for name, broken, make, laws in _TABLE)
