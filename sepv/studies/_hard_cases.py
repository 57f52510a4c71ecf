"""Steps of a scheme on hard cases (`sepv.hard_cases`): how they end,
and their errors of H in extended precision.

A step ends well in one of two ways: a value within the derived bound of `sepv.law.tolerance`, or a
refusal that the case allows. Every other end is counted as a fault: a value that is not finite or
outside the domain, a defect beyond the bound, a refusal although a solution exists.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sepv.core.newton import Status
from sepv.errors import SepvError, StepFailure
from sepv.hard_cases import CATALOGUE, HardCase, Sample
from sepv.law import Case, energy_bound, energy_ulp, step_residual
from sepv.problem import Array, Description, GivenProblem, Problem, matvec
from sepv.reference.exact_energy import exact_energy
from sepv.reference.problem import exact_problem
from sepv.schemes import Scheme
from sepv.schemes import gauss_amplification as amplification
from sepv.simulate import initial_state

# The number of steps in a batch, which are solved together and have the same random h.
HARD_BATCH = 500


@dataclass
class Seen:
    """The results of one scheme on one hard case, collected over batches of steps.

    statuses : status -> number of steps, by name of `Status`; REFUSED after StepFailure, CRASH
        after another error
    wrong : kind -> number of wrong values that the scheme returned as solutions; kinds are "not
        finite", "outside the domain", "beyond the bound" and "residual beyond the bound"
    defects : (n,), energy defects of the solved steps, in energy ulps
    ratio : the largest quotient of a defect and its bound
    iterations : (n,), Newton iterations of the solved steps, if the scheme reports them
    worst : the first step that went wrong, else the step with the largest ratio; None if it cannot
        be stored as data
    laws : law -> (number of steps on which it held, number of steps on which it was measured)
    unmeasured : the number of solved steps whose energy ulp or bound exceeds the largest binary64
        number
    """

    case: HardCase
    steps: int = 0
    statuses: dict[str, int] = field(default_factory=dict)
    wrong: dict[str, int] = field(default_factory=dict)
    defects: Array = field(default_factory=lambda: np.empty(0))
    ratio: float = 0.0
    iterations: Array = field(default_factory=lambda: np.empty(0))
    worst: Case | None = None
    laws: dict[str, tuple[int, int]] = field(default_factory=dict)
    unmeasured: int = 0

    @property
    def solved(self) -> int:
        """The number of steps that ended with a solution."""
        return self.statuses.get("CONVERGED", 0)

    @property
    def strays(self) -> set[str]:
        """The names of statuses in which steps ended although the case does not allow them.

        If the case allows some refusal, it allows StepFailure too, because the exception does not
        tell the status.
        """
        refusals = {*self.case.refusals, "REFUSED"} if self.case.refusals else set()
        return set(self.statuses) - {"CONVERGED"} - refusals

    @property
    def as_expected(self) -> bool:
        """True if the case allows the statuses of all steps, no returned value is wrong,
        and every law held.
        """
        return not self.wrong and not self.strays and all(a == b for a, b in self.laws.values())

    def to_json(self) -> dict[str, Any]:
        """All numbers of the case as an object for the file of `sepv hard --json`."""
        from sepv.law.cases import case as cases

        return {
            "case": self.case.name,
            "reason": self.case.reason,
            "expected": self.case.expected,
            "refusals_allowed": list(self.case.refusals),
            **{name: getattr(self, name) for name in ("steps", "statuses", "wrong", "unmeasured")},
            "defect_median": _median(self.defects),
            "defect_largest": float(self.defects.max()) if self.defects.size else None,
            "largest_defect_over_bound": self.ratio,
            "iterations_median": _median(self.iterations),
            "iterations_largest": int(self.iterations.max()) if self.iterations.size else None,
            "laws": {law: {"held": a, "measured": b} for law, (a, b) in self.laws.items()},
            "as_expected": self.as_expected,
            "worst": None if self.worst is None else cases.to_json(self.worst),
        }


def run(
    scheme: Scheme,
    cases: Sequence[HardCase] = CATALOGUE,
    *,
    steps: int = 200,
    laws: int = 2,
    seed: int = 0,
    progress: Callable[[str, float], None] = lambda *_: None,
) -> list[Seen]:
    """Run a scheme on `steps` random steps of each hard case;
    check the case's laws on `laws` other random steps.

    Parameters
    ----------
    steps : int ≥ 1
        The number of steps of each case.
    seed : int
        The same seed draws the same steps of a case, whichever other cases are run.
    progress : callable (text, share)
        Called before each case with its name and the fraction of the cases that are done, 0 to 1.
    """
    rows = []
    for number, case in enumerate(cases):
        progress(case.name, number / len(cases))
        rng = np.random.default_rng([seed, *case.name.encode()])
        seen = Seen(case, laws=_laws(scheme, case, case.sample(rng, laws), laws) if laws else {})
        while seen.steps < steps:
            _measure(seen, scheme, case.sample(rng, min(HARD_BATCH, steps - seen.steps)))
        rows.append(seen)
    return rows


def _measure(seen: Seen, scheme: Scheme, sample: Sample) -> None:
    """Solve the steps of one sample, and add their statuses,
    energy defects and wrong values to `seen`.
    """
    problem, (y, h, dW) = seen.case.problem, sample
    value, names, residual, iterations = ask_each(scheme, problem, sample)
    seen.steps += y.shape[1]
    before = seen.strays
    for name in np.unique(names):
        seen.statuses[str(name)] = seen.statuses.get(str(name), 0) + int((names == name).sum())
    if seen.strays and not before and not seen.wrong:
        seen.worst = _as_case(seen.case, sample, int(np.argmax(np.isin(names, list(seen.strays)))))
    solved = names == "CONVERGED"
    finite = np.isfinite(value).all(axis=0)
    _count(seen, sample, solved & ~finite, "not finite")
    good = np.flatnonzero(solved & finite)
    if problem.domain is not None:
        inside = np.asarray(problem.domain(value[:, good]), dtype=bool)
        _count(seen, sample, good[~inside], "outside the domain")
        good = good[inside]
    if not good.size:
        return
    y0, y1, increments = y[:, good], value[:, good], dW[:, good]
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        allowed = step_residual(problem, y0, y1, h, increments, scheme)
        bound = energy_bound(problem, y0, y1, allowed) + _tilt(seen.case, scheme, y0, y1, h, increments)
        if isinstance(seen.case.data, GivenProblem):
            bound = bound + exact_problem(seen.case.data).uncertainty(y0, y1)
        unit = energy_ulp(problem, y0, y1)
    defect = energy_defects(seen.case.data, y0, y1)
    if scheme.solve is not None:
        _count(seen, sample, good[~(residual[good] <= allowed.max(axis=0))], "residual beyond the bound")
    judged = np.isfinite(bound) & np.isfinite(unit)
    seen.unmeasured += int((~judged).sum())
    good, ratio = good[judged], defect[judged] / bound[judged]
    seen.defects = np.concatenate([seen.defects, defect[judged] / unit[judged]])
    seen.iterations = np.concatenate([seen.iterations, iterations[good]])
    if not good.size:
        return
    if "energy" in scheme.claims:
        _count(seen, sample, good[~(ratio <= 1)], "beyond the bound")
        if not ratio.max() <= seen.ratio and not seen.wrong and not seen.strays:
            seen.worst = _as_case(seen.case, sample, int(good[np.argmax(ratio)]))
    seen.ratio = max(seen.ratio, float(ratio.max()))


def long_steps(problem: Problem, text: str = "") -> HardCase:
    """Make a hard case of a user's problem: steps from near its initial state,
    some of them too long to be solved.

    The scheme may refuse any step, but every value that it returns must be right.
    """
    from sepv.law import describe, units_of

    start = initial_state(problem, None)
    longest = 10 * units_of(problem).time / 8  # the slopes allow steps of an eighth of the unit of time

    def sample(rng: np.random.Generator, lanes: int) -> Sample:
        y = start[:, None] * rng.uniform(0.5, 1.5, (start.size, lanes))
        if problem.domain is not None:
            y = np.where(np.asarray(problem.domain(y), dtype=bool), y, start[:, None])
        h = float(longest * 10.0 ** rng.uniform(-3, 0))
        return Sample(y, h, np.sqrt(h) * rng.standard_normal((problem.noises, lanes)))

    refusals = ("REFUSED", *(s.name for s in Status if s is not Status.CONVERGED))
    return HardCase(
        problem.name,
        "a problem of your own: steps from a hundredth to ten times what its slopes allow",
        "solved to the bound, or refused",
        describe(problem, text),
        sample,
        refusals,
    )


def energy_defects(data: Description, y0: Array, y1: Array) -> Array:
    """The defects |H(y1) − H(y0)| of M steps, (M,), with H evaluated in extended precision at the
    binary64 states.
    """
    H = exact_energy(data)
    return np.array([abs(float(H(b) - H(a))) for a, b in zip(y0.T, y1.T, strict=True)])


def ask_each(scheme: Scheme, problem: Problem, sample: Sample) -> tuple[Array, np.ndarray, Array, np.ndarray]:
    """The results of a scheme on M steps: values (d, M), names of statuses (M,), residuals (M,)
    and iterations (M,).

    The scheme's `solve` computes all steps at once. If the scheme has no `solve`, steps are
    computed one at a time, and residuals and iterations are 0.
    """
    y, h, dW = sample
    if scheme.solve is not None:
        solution = scheme.solve(problem, y, h, dW)
        names = np.array([Status(int(s)).name for s in solution.status])
        return solution.value, names, solution.residual, solution.iterations
    from sepv.schemes import raw_answer

    value, names = np.full_like(y, np.nan), np.full(y.shape[1], "CONVERGED", dtype="<U16")
    for lane in range(y.shape[1]):
        try:
            answer = np.asarray(raw_answer(scheme, problem, y[:, lane].copy(), h, dW[:, lane].copy()))
            if answer.shape == y[:, lane].shape and answer.dtype == np.float64:
                value[:, lane] = answer
        except StepFailure:
            names[lane] = "REFUSED"
        except SepvError:
            names[lane] = "CRASH"
    return value, names, np.zeros(y.shape[1]), np.zeros(y.shape[1])


def _count(seen: Seen, sample: Sample, lanes: Array, what: str) -> None:
    numbers = np.flatnonzero(lanes) if lanes.dtype == bool else lanes
    if numbers.size:
        if not seen.wrong:
            seen.worst = _as_case(seen.case, sample, int(numbers[0]))
        seen.wrong[what] = seen.wrong.get(what, 0) + int(numbers.size)


def _tilt(case: HardCase, scheme: Scheme, y0: Array, y1: Array, h: float, dW: Array) -> Array | float:
    """The bound |Δ| gᵀ|S|g (M,) of the change of H by a B that is not quite skew,
    with the symmetric part S of B.

    g is the largest |∇H| at points from y0 to y1. A scheme's averages of ∇H are at most
    `amplification` times g.
    """
    if not case.skewness:
        return 0.0
    problem = case.problem
    along = np.linspace(0, 1, 9).reshape(1, -1, 1)
    g = np.abs(problem.gradient(y0[:, None] + along * (y1 - y0)[:, None])).max(axis=1)
    S = problem.structure(y0)
    tilt: Array = np.sum(g * matvec(0.5 * np.abs(S + np.swapaxes(S, 0, 1)), g), axis=0)
    # The mean of |∇H| is below its largest value, which 9 points may miss by a little: hence the
    # factor 1.1.
    allowed: Array = 1.1 * amplification(scheme.stages) ** 2 * np.abs(problem.random_step(h, dW)) * tilt
    return allowed


def _as_case(case: HardCase, sample: Sample, lane: int) -> Case | None:
    if case.structure is not None:
        return None
    y, h, dW = sample
    return Case(case.data, tuple(y[:, lane].tolist()), float(h), tuple(dW[:, lane].tolist()))


def _laws(scheme: Scheme, case: HardCase, sample: Sample, count: int) -> dict[str, tuple[int, int]]:
    """Check the claimed laws of the case on `count` steps;
    return law -> (steps on which it held, steps measured).

    If the case allows refusals, a refused step is not counted as measured.
    """
    from sepv.law import Verdict
    from sepv.law.cases import case as cases
    from sepv.verification import load_laws

    claimed = [law for law in load_laws(case.laws) if law.claimed_by(scheme)] if case.laws else []
    witnesses = [w for lane in range(count) if (w := _as_case(case, sample, lane)) is not None]
    silent = (Verdict.ERROR, Verdict.NOT_APPLICABLE) if case.refusals else ()
    by_law = {}
    for law in claimed:
        verdicts = [law.replay(law, scheme, cases.to_json(w)).verdict for w in witnesses]
        measured = [v for v in verdicts if v not in silent]
        by_law[law.name] = (sum(v is Verdict.HOLDS for v in measured), len(measured))
    return by_law


def _median(values: Sequence[float] | Array) -> float | None:
    return float(np.median(values)) if len(values) else None
