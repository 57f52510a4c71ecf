"""One path of a scheme: `integrate`, and the `Trajectory` that it returns."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from sepv._arguments import floats
from sepv.console import facts, html
from sepv.errors import UsageError
from sepv.problem import Array, Problem, changes_of_invariants, few, known_invariants
from sepv.schemes import PointLaw, Scheme, Step, ask_next, further_rows, require_converged
from sepv.simulate import _areas as areas
from sepv.simulate import _truncation as bounded
from sepv.simulate import _wiener as wiener
from sepv.simulate._run_arguments import checked


@dataclass(frozen=True, repr=False)
class Trajectory:
    """A path of a scheme: times, states, increments, and counts of work.

    Attributes
    ----------
    t : (N + 1,)
    y : (d, N + 1)
    dW : (N, m)
        The increments given to the scheme. Lévy areas or half-step increments, if asked for, are in
        further columns.
    gradient_evaluations, divisions, continuations : int
        The numbers of evaluations of ∇H, of divided steps (`sepv.schemes.divided`), and of
        fractions of steps that were solved by continuation (`sepv.schemes.continued`).
    problem : Problem, optional
        The problem of the path, for `energy` and `casimirs`.
    """

    t: Array
    y: Array
    dW: Array
    gradient_evaluations: int
    divisions: int = 0
    continuations: int = 0
    problem: Problem | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        """One line: the steps, the times and the first and last state; the arrays are not
        printed.
        """
        d, count = self.y.shape[0], self.y.shape[1] - 1
        first, last = (", ".join(f"{v:.6g}" for v in self.y[:6, n]) + ", …" * (d > 6) for n in (0, -1))
        return f"<Trajectory of {count} steps to t = {self.t[-1]:g}, d = {d}: ({first}) → ({last})>"

    def _repr_html_(self) -> str:
        """A table for a notebook: steps, times, both ends, changes of the invariants,
        counts of work.
        """
        rows = [
            ("problem", self.problem.name if self.problem else "not known"),
            ("steps", f"{self.y.shape[1] - 1:,} from t = {self.t[0]:g} to {self.t[-1]:g}"),
            *((f"y at t = {self.t[n]:g}", few(self.y[:, n])) for n in (0, -1)),
        ]
        if self.problem is not None:
            changes = changes_of_invariants(self.problem, self.y)
            rows += [(f"largest change of {name}", f"{abs(v).max():.3g}") for name, v in changes.items()]
        for name in ("gradient_evaluations", "divisions", "continuations"):
            if count := getattr(self, name):
                rows.append((name.replace("_", " "), f"{count:,}"))
        return html(facts("Trajectory", rows))

    def energy(self) -> Array:
        """H along the path in binary64, (N + 1,). UsageError for a path made by hand,
        without its problem.
        """
        return np.asarray(known_invariants(self.problem, self.y)[0])

    def casimirs(self) -> Array:
        """The n quadratic and linear Casimirs along the path, (n, N + 1),
        in the order of the problem.
        """
        return np.asarray(known_invariants(self.problem, self.y)[1:])

    def plot(self) -> Any:
        """Draw the components of y, and the changes of H and of the Casimirs, against time.

        Returns
        -------
        matplotlib.figure.Figure
            A notebook shows it; `savefig` writes it to a file. At most six components and Casimirs
            are drawn.

        Raises
        ------
        UsageError
            If matplotlib, the extra ``plots``, is not installed.
        """
        from sepv.simulate._drawn import path_figure

        return path_figure(self)


def integrate(
    scheme: str | Scheme | Step,
    problem: str | Problem,
    *,
    h: float,
    T: float | None = None,
    steps: int | None = None,
    y0: ArrayLike | None = None,
    seed: int = 0,
    dW: ArrayLike | None = None,
    truncation: int | Literal["own"] | None = "own",
    increments: str | PointLaw | None = None,
) -> Trajectory:
    """Integrate one path from y0 (by default the problem's initial state).

    Parameters
    ----------
    scheme : str, Scheme or function
        As for `sepv.verify`: a built-in name, ``module:attribute``, a `Scheme`, or
        ``step(problem, y, h, dW)``.
    problem : str or Problem
        A built-in name, ``module:attribute``, a ``.json`` file of polynomial data, or a `Problem`.
    h : float > 0
    T, steps : exactly one of the two; T must be a multiple of h.
    y0 : (d,), optional
    seed : int
        Seed of the increments, which are those of path 0 of `ensemble` with this seed.
    dW : (N, m), optional
        Untruncated increments to use instead of drawn ones.
    truncation : int, "own" or None
        The k of the truncation in Remark 2.1; "own" means the k that the scheme declares, None
        means no truncation.
    increments : "normal", "two-point", "three-point" or PointLaw, optional
        The distribution of the increments; by default the one that the scheme declares. A PointLaw
        replaces each normal increment by the law's quantile at the same probability.

    Returns
    -------
    Trajectory
        Times t (N+1,), states y (d, N+1), the increments dW (N, m) that were used, and counts of
        work.

    Raises
    ------
    StepFailure
        If the implicit equation of a step was not solved; raised at the first such step.
    SchemeFault
        If the scheme returns something that is no state: its shape or type is wrong, or it is not
        finite.
    UsageError, TargetError
        UsageError for invalid arguments. TargetError if `scheme` is no scheme or `problem` is no
        problem.

    Examples
    --------
    >>> import sepv
    >>> path = sepv.integrate("energy-preserving", "rigid-body", h=0.01, T=1.0)
    >>> path.y.shape
    (3, 101)
    """
    scheme, problem, start, count, k = checked(scheme, problem, h, T, steps, y0, truncation, increments)
    m = problem.noises
    if dW is not None:
        raw = floats("dW", dW)
    elif scheme.asks:
        fine = areas.drawn(seed, T=h * count, steps=areas.FINE_STEPS * count, noises=m, paths=1)
        raw = fine.rows(count, scheme.asks)[:, :, 0]
    else:
        raw = wiener.increments(seed, T=h * count, steps=count, noises=m)[:, :, 0]
    if raw.shape != (count, m + further_rows(scheme.asks, m)):
        raise UsageError(
            expected=f"dW of shape {(count, m + further_rows(scheme.asks, m))}",
            received=f"shape {raw.shape}",
            remedy=f"one row a step{', with the ' + scheme.asks + ' that the scheme asks for' if scheme.asks else ''}",
        )
    used = np.concatenate([bounded.seen(raw[:, :m], h, k, scheme.increments), raw[:, m:]], axis=1)
    return _walk(scheme, problem, start, h, used)


def _walk(scheme: Scheme, problem: Problem, y0: Array, h: float, dW: Array) -> Trajectory:
    """Take N steps of the scheme, one after the other, from y0 (d,) over the increments dW
    (N, m).
    """
    count = len(dW)
    y = np.empty((problem.dimension, count + 1))
    y[:, 0] = y0
    evaluations = divisions = continuations = 0
    state = None
    for n in range(count):
        if scheme.solve is None:
            y[:, n + 1], state = ask_next(scheme, problem, y[:, n], state, h, dW[n])
            continue
        solution = scheme.solve(problem, y[:, n], h, dW[n])
        evaluations += int(solution.gradient_evaluations[0])
        divisions += 0 if solution.divisions is None else int(solution.divisions[0])
        continuations += 0 if solution.continuations is None else int(solution.continuations[0])
        y[:, n + 1] = require_converged(problem, y[:, n : n + 1], h, dW[n][:, None], solution)[:, 0]
    return Trajectory(
        np.arange(count + 1, dtype=np.float64) * h, y, dW, evaluations, divisions, continuations, problem
    )
