"""Methods of a comparison, made from the names that a user gives:
solvers of many paths with given increments.

All methods get the same Wiener increments, and so compute the same paths. A method's `prepare` does
work that is not the method's own, such as moving arrays into another library. It returns a job;
only this job is timed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from sepv._lazy import find
from sepv.errors import SchemeFault, SepvError, TargetError
from sepv.exact import ExactFlow, exact_flow
from sepv.law import quiet_problem
from sepv.problem import Array, Problem, invariants
from sepv.schemes import Look, Scheme, SchemeCrash, ask, load_object, load_scheme
from sepv.simulate import CHUNK, Ensemble, judged, run_chunk
from sepv.simulate import choose_engine as choose
from sepv.studies._evaluation_count import Work, counted


class MethodEnds(NamedTuple):
    """The ends of M paths at the final time T: states y (d, M),
    and the `sepv.core.newton.Status` of each path (M,).
    """

    y: Array
    status: np.ndarray


class Followed(NamedTuple):
    """The results of an untimed run of a method, in which invariant defects are measured and
    evaluations counted.

    energy_defect, casimir_defect : (M,), the largest |H(y_n) − H(y_0)| over the steps of each path,
        and the largest |C(y_n) − C(y_0)| over steps and Casimirs C
    work : the evaluations, or None if the driver's evaluations cannot be counted
    stated_error : the error that the method itself estimates; 0 for schemes
    """

    ends: MethodEnds
    energy_defect: Array
    casimir_defect: Array
    work: Work | None
    stated_error: float = 0.0


# Functions of (problem, y0 (d,), h, untruncated dW (N, m, M)). `Prepare` returns a job; `Follow`
# runs it with defects.
Prepare = Callable[[Problem, Array, float, Array], Callable[[], MethodEnds]]
Follow = Callable[[Problem, Array, float, Array], Followed]
# A function of (problem, y0, h, dW, keep) that returns a job, and the job returns states: see
# `from_states`.
Run = Callable[[Problem, Array, float, Array, bool], Callable[[], Array]]


@dataclass(frozen=True)
class Method:
    """A solver of whole paths that `compare` measures: a scheme, another library's solver,
    or the exact flow.

    Attributes
    ----------
    prepare, follow : functions that prepare the timed run, and that do the untimed run with defects
    source : where the method comes from and how it is run
    batched : False for a method that computes one path at a time, which is given fewer paths
    evaluations : evaluations of f = B∇H per step, if they are known from the method but cannot be
        counted
    steps_matter : False for the exact flow φ_θ(y0), which uses W(T) only and no step size
    truncation : the k of Remark 2.1 for the method's increments; None for untruncated increments
    look : the look in pictures; None for a generated one, which no other method has
    deterministic : True for a method without noise; the comparison is then made without noise, c
        = ()
    called_each_step : True if Python calls a function for each step of a batch, False for one
        compiled loop
    """

    name: str
    prepare: Prepare
    follow: Follow
    source: str = ""
    batched: bool = True
    evaluations: float | None = None
    steps_matter: bool = True
    truncation: int | None = None
    look: Look | None = None
    deterministic: bool = False
    called_each_step: bool = False


def invariant_defects(problem: Problem, states: Array) -> tuple[Array, Array]:
    """The largest defects (M,) of H and (M,) of the Casimirs along states (N+1, d, M),
    evaluated in binary64.
    """
    with np.errstate(all="ignore"):
        values = invariants(problem, np.moveaxis(states, 1, 0))
        worst = np.max(np.abs(values - values[:, :1]), axis=1)
    return worst[0], np.max(worst[1:], axis=0, initial=0.0)


def finite_ends(problem: Problem, y: Array) -> MethodEnds:
    """The `MethodEnds` of a solver that returns states y only;
    a path fails if its y is not finite or outside the domain.
    """
    return MethodEnds(y, judged(problem, y, np.zeros(y.shape[1], dtype=np.int64)))


def from_scheme(scheme: Scheme, problem: Problem, engine: str = "auto") -> Method:
    """The `Method` that runs a `sepv.Scheme` by `sepv.ensemble`,
    with increments truncated as the scheme declares.

    engine : "auto" chooses the compiled engine (extra `fast`) if it can run the scheme on the
        problem, else "numpy". The compiled engine is timed as users run it: it also computes the
        defects of invariants and the statuses.
    """
    target, reason = choose(engine, scheme, problem, compensated=False)
    whole = target.name != "numpy"
    prepare, follow = _by_target(scheme, target.name) if whole else _in_batches(scheme)
    how = f"; {target.name} engine" if whole else "" if engine == "numpy" else f"; NumPy batch: {reason}"
    return Method(
        scheme.name, prepare, follow, scheme.source + how, batched=whole or scheme.batched,
        truncation=scheme.truncation, look=scheme.look, deterministic=scheme.deterministic, called_each_step=not whole,
    )  # fmt: skip


def _ends(run: Ensemble) -> MethodEnds:
    return MethodEnds(run.y, run.status)


def _in_batches(scheme: Scheme) -> tuple[Prepare, Follow]:
    """The functions `prepare` and `follow` of a `Method` for a scheme that runs in NumPy batches of
    ≤ CHUNK paths.
    """

    def prepare(problem: Problem, y0: Array, h: float, dW: Array) -> Callable[[], MethodEnds]:
        parts = [np.ascontiguousarray(dW[:, :, p : p + CHUNK]) for p in range(0, dW.shape[2], CHUNK)]

        def job() -> MethodEnds:
            runs = [_run(scheme, problem, y0, h, part, track=False) for part in parts]
            return MethodEnds(
                np.concatenate([r.y for r in runs], axis=1), np.concatenate([r.status for r in runs])
            )

        return job

    def follow(problem: Problem, y0: Array, h: float, dW: Array) -> Followed:
        work = Work()
        plain = _run(scheme, _watched(scheme, problem, y0, h, dW, work), y0, h, dW, track=False)
        work.iterations = int(plain.iterations) if scheme.solve is not None else None
        run = _run(scheme, problem, y0, h, dW, track=True)
        return Followed(_ends(run), run.energy_defect, run.casimir_defect, work)

    return prepare, follow


def _by_target(scheme: Scheme, engine: str) -> tuple[Prepare, Follow]:
    """The functions `prepare` and `follow` of a `Method` for a scheme that runs by
    `sepv.ensemble(engine=engine)`.
    """

    def ensemble_for(problem: Problem, y0: Array, h: float, dW: Array) -> Callable[[], Ensemble]:
        from sepv.simulate import ensemble

        given = np.ascontiguousarray(dW)
        return lambda: ensemble(
            scheme, problem, h=h, steps=len(given), dW=given, y0=y0, engine=engine, workers=1
        )

    def prepare(problem: Problem, y0: Array, h: float, dW: Array) -> Callable[[], MethodEnds]:
        run = ensemble_for(problem, y0, h, dW)
        return lambda: _ends(run())

    def follow(problem: Problem, y0: Array, h: float, dW: Array) -> Followed:
        run = ensemble_for(problem, y0, h, dW)()
        if scheme.solve is None:  # all paths have the same counts, so only one path is counted, in NumPy
            work = Work()
            one = dW[:, :, :1]
            _run(scheme, _watched(scheme, problem, y0, h, one, work), y0, h, one, track=False)
            work.evaluations = {kind: n * dW.shape[2] for kind, n in work.evaluations.items()}
        else:
            work = Work(iterations=int(run.iterations))
            work.evaluations |= {"gradient": run.gradient_evaluations, "structure": run.structure_evaluations}
        return Followed(_ends(run), run.energy_defect, run.casimir_defect, work)

    return prepare, follow


def _watched(scheme: Scheme, problem: Problem, y0: Array, h: float, dW: Array, work: Work) -> Problem:
    """A copy of the problem that counts its evaluations in `work`,
    after a first step that is not counted.

    The first step may compute values that are kept for the problem. Their evaluations are not part
    of a usual step.
    """
    watched = counted(problem, work)
    _run(scheme, watched, y0, h, dW[:1], track=False)
    work.evaluations |= dict.fromkeys(work.evaluations, 0)
    return watched


def _run(scheme: Scheme, problem: Problem, y0: Array, h: float, dW: Array, *, track: bool) -> Ensemble:
    try:
        return run_chunk(scheme, problem, y0, h, dW, scheme.truncation, track=track)
    except SepvError:
        raise
    except (Exception, SystemExit) as error:
        raise SchemeCrash(error, (problem.dimension, dW.shape[2])) from error


def from_states(name: str, run: Run, source: str, **more: Any) -> Method:
    """The `Method` of a solver that returns states only, from which failures are recognized.

    run : a function (problem, y0, h, dW, keep) that returns a job. The job returns all states (N
        + 1, d, M) from y0 on if `keep` is true, else an array whose last entry is the states at T
    more : further fields of `Method`
    """

    def prepare(problem: Problem, y0: Array, h: float, dW: Array) -> Callable[[], MethodEnds]:
        job = run(problem, y0, h, dW, False)
        return lambda: finite_ends(problem, job()[-1])

    def follow(problem: Problem, y0: Array, h: float, dW: Array) -> Followed:
        states = run(problem, y0, h, dW, True)()
        return Followed(finite_ends(problem, states[-1]), *invariant_defects(problem, states), None)

    return Method(name, prepare, follow, source, **more)


def exact_time_change() -> Method:
    """The `Method` that computes the exact solution φ_θ(y0), θ = T + Σ c_j W_j(T),
    by one dense solve for all paths.

    The method has no step size, so it gives one point of the comparison. Its error is the larger of
    its own estimate and the measured error, because a reference without a closed form is computed
    in the same way.
    """

    def job_for(problem: Problem, y0: Array, h: float, dW: Array) -> Callable[[], ExactFlow]:
        return lambda: exact_flow(problem, problem.random_step(h * len(dW), dW.sum(axis=0)), y0, dense=True)

    def prepare(problem: Problem, y0: Array, h: float, dW: Array) -> Callable[[], MethodEnds]:
        solve = job_for(problem, y0, h, dW)
        return lambda: finite_ends(problem, solve().y)

    def follow(problem: Problem, y0: Array, h: float, dW: Array) -> Followed:
        work = Work()
        flow = job_for(counted(problem, work), y0, h, dW)()
        states = np.stack([np.repeat(y0[:, None], flow.y.shape[1], axis=1), flow.y])
        return Followed(finite_ends(problem, flow.y), *invariant_defects(problem, states), work, flow.error)

    return Method(
        "exact-flow", prepare, follow, "the exact time change, one dense solve", steps_matter=False,
        look=Look("#333333", "#DDDDDD", "v"),
    )  # fmt: skip


EXACT_NAME = "exact-flow"
NUMPY_PREFIX = "numpy/"


def load_method(target: str, problem: Problem) -> Method:
    """The `Method` that a user's `target` names, for a comparison on `problem`.

    A target is a built-in scheme, ``exact-flow``, a peer's solver, or module:attribute with a
    scheme or a `Method`. ``numpy/SCHEME`` runs in NumPy batches even if the compiled engine could
    run it. The scheme first takes one step. If its result is wrong, for example has a wrong shape,
    TargetError says so without a traceback.
    """
    if target == EXACT_NAME:
        return exact_time_change()
    driven: Method | None = find("method", target)
    if driven is not None:
        return driven
    if ":" in target:
        named = load_object(target)
        if isinstance(named, Method):
            return named
    plain = target.startswith(NUMPY_PREFIX)
    scheme = load_scheme(target.removeprefix(NUMPY_PREFIX))
    problem = quiet_problem(problem) if scheme.deterministic else problem
    h = 2.0**-10
    if problem.initial is not None:
        try:
            ask(scheme, problem, np.array(problem.initial, dtype=np.float64), h, np.zeros(problem.noises))
        except SchemeFault as fault:
            raise TargetError(
                expected=f"{fault.expected} from {target}", received=fault.received, remedy=fault.remedy
            ) from fault
    method = from_scheme(scheme, problem, "numpy" if plain else "auto")
    if plain:
        return replace(method, name=target, source=f"{scheme.source}; NumPy batch", look=None)
    return replace(method, name=target) if ":" in target and scheme.name in (target, "step") else method
