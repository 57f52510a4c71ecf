"""Guarded calls of a scheme under verification: each result is checked for its type, shape,
dtype and values.
"""

from __future__ import annotations

import sys
import traceback
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sepv._arithmetic import restore
from sepv.children import TimedOut, note_step, one_process, returned_twice
from sepv.errors import NotFinite, SchemeFault, SepvError, StepFailure, UsageError, said
from sepv.problem import Array, Problem, one_field
from sepv.problems.shown_to_schemes import shown
from sepv.schemes._further_increments import answer, carry, joined
from sepv.schemes._scheme import Scheme, Step
from sepv.schemes._stateful import REFUSAL_ERRORS, PathSolver, StatefulStep, whole


class Refusal(StepFailure):
    """An ArithmeticError or LinAlgError that the scheme raised:
    it counts as a step that the scheme did not solve.

    A scheme may refuse a step whose equation may have no solution. If it refuses any other step,
    laws report an error.
    """

    def __init__(self, error: BaseException, problem: Problem, y: Array, h: float, dW: Array) -> None:
        self.problem, self.y, self.status = problem.name, y, "refused"
        # The message gives Δ if there is one: batches and whole paths have many, and several
        # structures have none.
        whole = y.ndim == dW.ndim == 1 and one_field(problem)
        self.delta = float(problem.random_step(h, dW)) if whole else float(h)
        self.residual, self.iterations = float("nan"), 0
        self.traceback = "".join(traceback.format_exception(error))
        step = f"y = {y.tolist()}, {'Δ' if whole else 'h'} = {self.delta!r}"
        step = step if y.ndim == 1 else f"y of shape {y.shape}"
        SepvError.__init__(
            self,
            f"The scheme refused the step by {type(error).__name__}: {said(error)}{_where(error)}\n"
            f"problem {problem.name}, {step}.\n"
            "Remedy: solve the step where a solution exists; beyond, a refusal is right.",
        )


_PACKAGE = str(Path(__file__).parents[1])


def _where(error: BaseException) -> str:
    """The file, line and function that raised an error, as a text in parentheses;
    empty if the place is unknown.
    """
    frames = traceback.extract_tb(error.__traceback__)[1:]  # without the frame that called the scheme
    # If the scheme calls a function of sepv that raises, the place in the scheme is shown.
    frames = [f for f in frames if not f.filename.startswith(_PACKAGE)] or frames
    return f" ({frames[-1].filename}, line {frames[-1].lineno}, in {frames[-1].name})" if frames else ""


# The names of JAX's errors for NumPy functions that are called with JAX's tracers.
_TRACER_ERRORS = {"TracerArrayConversionError", "ConcretizationTypeError", "TracerBoolConversionError"}


class SchemeCrash(SepvError):
    """An exception of the scheme that is no refusal of a step;
    `traceback` is the text of the exception's traceback.
    """

    def __init__(self, error: BaseException, shape: tuple[int, ...], given: str = "") -> None:
        self.traceback = "".join(traceback.format_exception(error))
        kind = type(error).__name__
        remedy = (
            "a problem's functions are NumPy's; sepv.posing.pose gives the same as JAX's (docs/adapting.md)"
            if kind in _TRACER_ERRORS
            else "--debug with the replay command shows the traceback"
        )
        text = said(error).partition("\n")[0] if kind in _TRACER_ERRORS else said(error)
        super().__init__(
            f"The scheme raised {kind}: {text}{_where(error)}\n"
            f"Expected y_next of shape {shape} from step(problem, y, h, dW){given}.\n"
            f"Remedy: {remedy}."
        )


def ask(scheme: Scheme, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """y1 of one step of the scheme from y, with the checks and exceptions of `ask_next`."""
    return ask_next(scheme, problem, y, None, h, dW)[0]


def ask_next(
    scheme: Scheme, problem: Problem, y: Array, state: Any, h: float, dW: Array
) -> tuple[Array, Any]:
    """y1 of one step of the scheme, checked by `check_answer`,
    and the state that the scheme carries to the next step.

    The scheme gets copies of the arguments. `state` is the state after the step before. It is None
    at the beginning of a path, and for schemes without a `StatefulStep`.

    Raises
    ------
    SchemeFault
        If the result has a wrong type, shape or dtype or is not finite, or if the scheme changed an
        argument.
    StepFailure
        If the scheme did not solve the step: its own StepFailure, or a `Refusal` for an
        ArithmeticError.
    SchemeCrash
        For any other exception of the scheme.
    """
    given, noise = scheme.numbers(y), scheme.numbers(dW)
    with translated(problem, y, h, dW):
        y1, state = carry(scheme, shown(problem, scheme.needs), given, state, h, noise, any_path=True)
    y1 = check_answer(y1, y, scheme.dtype)
    require_unchanged(y=(scheme.numbers(y), given), dW=(scheme.numbers(dW), noise))
    return y1.astype(np.float64, copy=False), state


def require_unchanged(**arguments: tuple[Array, Array]) -> None:
    """Raise a SchemeFault if a step has changed an argument;
    each is given as (array before, array after).
    """
    for name, (before, after) in arguments.items():
        frozen = "" if after.flags.writeable else ", and read-only,"
        if frozen or before.shape != after.shape or before.tobytes() != after.tobytes():
            raise SchemeFault(
                expected=f"{name} unchanged by the step",
                received=f"{name} = {after.tolist()!r:.200}{frozen} after, {before.tolist()!r:.200} before",
                remedy=f"work on a copy: {name} = {name}.copy(), and no operators such as += on arguments",
            )


def raw_answer(scheme: Scheme, problem: Problem, y: Array, h: float, dW: Array) -> Any:
    """The scheme's result without any check; the scheme is called with the given arrays themselves,
    not with copies.
    """
    with translated(problem, y, h, dW):
        return answer(scheme, shown(problem, scheme.needs), y, h, dW, any_path=True)


@contextmanager
def translated(problem: Problem, y: Array, h: float, dW: Array) -> Iterator[None]:
    """A context for calls of a scheme that turns the scheme's exceptions into `Refusal` or
    `SchemeCrash`.

    The messages name the problem, y, h and dW. At the end the process rounds to nearest again, with
    subnormal numbers.
    """
    given = (
        f", called with the problem {problem.name}, y of shape {y.shape}, h = {h:g}, dW of shape {dW.shape}"
    )
    try:
        with one_process(), np.errstate(all="ignore"):
            yield
    except (StepFailure, KeyboardInterrupt, TimedOut):
        raise
    except REFUSAL_ERRORS as error:
        raise Refusal(error, problem, y, h, dW) from error
    except (
        BaseException
    ) as error:  # a panic of Rust's PyO3, asyncio's CancelledError and SystemExit are no Exception
        # A UsageError is the scheme's error: it gave wrong arguments to a function of sepv.
        if isinstance(error, SepvError) and type(error) is not UsageError:
            raise
        raise SchemeCrash(error, y.shape, given) from error
    finally:
        restore()
    require_one_return(y.shape, given)


def require_one_return(shape: tuple[int, ...] = (), given: str = "") -> None:
    """Raise a SchemeCrash if a step forked, and its copy of this process came back as this process
    did.
    """
    if returned_twice():
        error = RuntimeError(
            "the step forked this process and came back in the copy too, which was ended: os._exit in the copy, "
            "or subprocess instead of os.fork"
        )
        raise SchemeCrash(error, shape, given)


# The names of NumPy that a step may take away from everybody, as they were before any step.
_NUMPY = {module: dict(vars(module)) for module in (np, np.linalg, np.random)}


def restored_names() -> str:
    """Restore what a scheme removed from NumPy's modules or replaced there; return the names,
    empty if none.
    """
    changed = []
    for module, before in _NUMPY.items():
        now, names = (
            vars(module),
            [name for name, value in before.items() if vars(module).get(name) is not value],
        )
        now.update((name, before[name]) for name in names)
        changed += [f"{module.__name__}.{name}" for name in names]
    return ", ".join(changed[:5]) + (f" and {len(changed) - 5} more" if len(changed) > 5 else "")


def check_answer(answer: Any, y: Array, dtype: str = "float64", *, finite: bool = True) -> Array:
    """The result of a step from y, if it is a finite NumPy array of y's shape and the given dtype.

    Raises SchemeFault for any other result. If `finite` is False, NaN and infinity are allowed.
    """
    if type(answer) is not np.ndarray:  # no subclass: masked arrays and matrices compute differently
        raise SchemeFault(
            expected=f"a NumPy array of shape {y.shape}",
            received=f"{type(answer).__name__}: {said(answer, 80)}",
            remedy="return np.asarray(…) of the new state (of a torch tensor: .numpy())"
            + _jax_is_single("; "),
        )
    if answer.shape != y.shape:
        raise SchemeFault(
            expected=f"y_next of the shape of y, {y.shape}",
            received=f"shape {answer.shape}",
            remedy="component first: one state is (d,), a batch (d, M)",
        )
    if answer.dtype != dtype:
        raise SchemeFault(
            expected=f"y_next of dtype {dtype}",
            received=f"dtype {answer.dtype}",
            remedy=_of_dtype(answer.dtype, dtype),
        )
    if finite and not np.all(np.isfinite(answer)):
        raise NotFinite(
            expected="finite values",
            received=f"{answer.tolist()!r:.200}",
            remedy="raise sepv.StepFailure where a step cannot be made, instead of returning NaN or infinity",
        )
    return answer


def _of_dtype(received: np.dtype[Any], expected: str) -> str:
    if received.kind == "c":
        return "a complex value hints at a square root or logarithm out of range"
    if expected != "float64":
        return "return y's dtype: constants and matrices of float64 raise it; or leave out dtype='float32'"
    double = _jax_is_single() or "compute in float64 throughout (torch: torch.as_tensor keeps the dtype of y)"
    return f"{double}, or say Scheme(…, dtype='float32') of a step in single precision"


def _jax_is_single(before: str = "") -> str:
    """The remedy for JAX without float64, after the words `before`; "" if JAX is not loaded,
    or computes in float64.
    """
    config = getattr(sys.modules.get("jax"), "config", None)
    if getattr(config, "jax_enable_x64", True):
        return ""
    return f"{before}JAX computes in float32 until jax.config.update('jax_enable_x64', True), before its first array"


def guarded(scheme: Scheme) -> Scheme:
    """A copy of a scheme for long runs: exceptions become `Refusal` or `SchemeCrash`,
    and results are checked.

    NaN and infinity are allowed, because a path may diverge. The copy has no `solve`: its `step` is
    called.
    """

    def carried(
        problem: Problem, path: tuple[Array, Any], h: float, dW: Array, further: Array | None = None
    ) -> tuple[Array, Any]:
        y, state = path
        noise = dW.copy() if further is None else joined(scheme.asks, dW, further)
        note_step(lambda: _step_in_words(problem, y, h, dW))
        given, increments = scheme.numbers(y), scheme.numbers(noise)
        noise = increments.copy()
        with translated(problem, y, h, noise):
            y1, state = carry(scheme, shown(problem, scheme.needs), given, state, h, noise, any_path=True)
        require_unchanged(y=(scheme.numbers(y), given), dW=(increments, noise))
        check_answer(y1, y, scheme.dtype, finite=False)
        return np.asarray(y1, dtype=np.float64), state

    def path(problem: Problem, y0: Array, h: float, dW: Array) -> Array:
        assert isinstance(scheme.step, PathSolver)
        note_step(lambda: f"{problem.name}: a path from y0 = {y0.tolist()} of {len(dW)} steps h = {h!r}")
        with translated(problem, y0, h, dW):
            return whole(scheme.step.path, shown(problem, scheme.needs), y0, h, dW[:, :, 0])[:, :, None]

    if isinstance(scheme.step, PathSolver):
        return replace(scheme, step=PathSolver(path), solve=None)
    rule = StatefulStep(lambda _, y: (y, None), carried, lambda path: path[0])
    # For a scheme without states the copy's step is a function.
    step: Step = rule if isinstance(scheme.step, StatefulStep) else rule.__call__
    return replace(scheme, step=step, solve=None, dtype="float64")


def _step_in_words(problem: Problem, y: Array, h: float, dW: Array) -> str:
    first, noise = (v if v.ndim == 1 else v[:, 0] for v in (y, dW))
    others = "" if y.ndim == 1 or y.shape[1] == 1 else f", and from {y.shape[1] - 1} other states at once"
    return f"{problem.name}: a step from y = {first.tolist()} with h = {h!r}, dW = {noise.tolist()}{others}"


def ask_once(scheme: Scheme, problem: Problem, y: Array, h: float) -> None:
    """Check a scheme without `solve` by a step with dW = 0; any error is raised except
    StepFailure.
    """
    if scheme.solve is None:
        with suppress(StepFailure):
            guarded(scheme).step(problem, y, h, np.zeros(problem.noises))


def takes_batches(scheme: Scheme, given: Iterable[Problem] = ()) -> bool:
    """True if a scheme's step accepts batches: for a batch of five states it returns the bits of
    each state alone.

    The step is tried on the problems `given`, else on two of the paper's. For a user's problem the
    states are reached from its initial state by small steps, because a step from an arbitrary state
    may fail for other reasons.
    """
    from sepv import problems

    candidates = tuple(given)
    for problem in candidates or (problems.rigid_body(), problems.pendulum()):
        if problem.initial is None:
            return False
        rng = np.random.default_rng(3)
        y = np.repeat(np.asarray(problem.initial, dtype=np.float64)[:, None], 5, axis=1)
        unit = 2.0**-6 if candidates else 1.0
        if not candidates:
            y = y * (1 + 0.1 * rng.standard_normal(y.shape))
        # For a user's problem the five paths start from one state, and their states differ from the
        # second step on.
        for h in (unit / 16, unit / 32, unit / 64)[: 3 if candidates else 1]:
            dW = 0.1 * unit * rng.standard_normal((problem.noises, 5))
            try:
                together = ask(scheme, problem, y, h, dW)
                alone = np.stack([ask(scheme, problem, y[:, k], h, dW[:, k]) for k in range(5)], axis=1)
            except SepvError:
                return False
            if not np.array_equal(together, alone):
                return False
            y = alone
    return True
