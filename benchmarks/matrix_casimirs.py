"""Changes of the Casimirs tr Pᵏ on su(3)* and su(4)* by two midpoint schemes:
``python -m benchmarks.matrix_casimirs``.

The table has for each scheme the rms over paths of the largest change of each Casimir over [0, 1],
at several h. The problems are `su3-top` and the Zeitlin truncation of Euler's equations with N = 4,
with noise and without.
"""

from __future__ import annotations

import numpy as np

import sepv
from benchmarks import arguments, over, start
from sepv import problems
from sepv.console import markdown
from sepv.problem import Problem
from sepv.problems import algebra_of

SCHEMES = ("isospectral-midpoint", "stochastic-midpoint")
STEPS = (2.0**-3, 2.0**-5, 2.0**-7)
QUIET = 1e-9  # the noise c_j in place of zero, so that the problem still has several Hamiltonians


def powers(problem: Problem, y: np.ndarray) -> np.ndarray:
    """The Casimirs tr Pᵏ, k = 2 … n, of states y (d, M), as an array (n − 1, M)."""
    P = algebra_of(problem, y).matrix(y) / 1j
    values = np.linalg.eigvalsh(P)
    return np.array([np.sum(values**k, axis=1) for k in range(2, P.shape[1] + 1)])


def loss(problem: Problem, scheme: str, h: float, paths: int) -> np.ndarray:
    """The rms over paths of the largest |C_k(y_n) − C_k(y_0)| over [0, 1], one for each k."""
    times = h * np.arange(1, round(1 / h) + 1)
    found = sepv.ensemble(scheme, problem, h=h, T=1.0, paths=paths, times=times)
    before = powers(problem, np.asarray(problem.initial)[:, None])
    most = np.max([np.abs(powers(problem, state) - before) for state in found.states.swapaxes(0, 1)], axis=0)
    return np.asarray(np.sqrt(np.mean(most**2, axis=1)))


def rows(paths: int) -> list[list[str]]:
    """A row for each problem, noise and scheme."""
    found = []
    cases = [
        (name, loud, scheme)
        for name in ("su3_top", "zeitlin")
        for loud in (True, False)
        for scheme in SCHEMES
    ]
    for name, loud, scheme in over(cases, lambda case: " ".join(map(str, case))):
        make = getattr(problems, name)
        problem = make() if loud else make(noise=(QUIET, QUIET))
        lost = np.array([loss(problem, scheme, h, paths if loud else 1) for h in STEPS])
        cells = [", ".join(f"{v:.0e}" for v in column) for column in lost.T]
        noise = "yes" if loud else "no"
        found.append([problem.name, noise, scheme, *cells, *[""] * (3 - len(cells))])
    return found


def main() -> None:
    """Print the table as Markdown."""
    options = arguments(__doc__, paths=100)
    print(markdown(["problem", "noise", "scheme", "tr P²", "tr P³", "tr P⁴"], rows(options.paths)))


if __name__ == "__main__":
    start(main)
