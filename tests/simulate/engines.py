"""Both engines on one ensemble, workers and a functional, and a system of which every part matters."""

from typing import Any

import numpy as np

import sepv
from sepv import problems, schemes
from sepv.simulate._batch import AXES

EP, PENDULUM = schemes.energy_preserving, problems.pendulum()


def both(scheme, problem, **arguments):
    """The same ensemble by both engines."""
    return (sepv.ensemble(scheme, problem, engine=engine, **arguments) for engine in ("compiled", "numpy"))


def same(a: Any, b: Any) -> bool:
    """The bits of all paths, in memory or on disk, and the work."""
    alike = (np.array_equal(getattr(a, key)[...], getattr(b, key)[...]) for key in AXES)
    return all(alike) and a.iterations == b.iterations


def backwards(function: Any, tasks: Any) -> Any:
    """A map that begins with the last task."""
    return [function(task) for task in reversed(tasks)]


def position(ends: Any) -> Any:
    return ends.y[0]


def quartic(values=(0.7, 0.4, 0.3, 0.1, -0.05, 1.0, 0.25, -0.125), noise=(0.5, 0.25)) -> sepv.Problem:
    """A random-looking quartic H in the plane with B(y) of degree one: nodes, derivatives and parameters all matter."""
    a, b, c, e, f, *B = values
    from sepv.problem import PolynomialSystem
    from sepv.record import polynomial

    H = polynomial(2, {(2, 0): a, (0, 2): b, (1, 2): c, (4, 0): e, (2, 2): f})
    entry = polynomial(2, {(0, 0): B[0], (1, 0): B[1], (0, 1): B[2]})
    return problems.polynomial_problem(PolynomialSystem(2, H, ((0, 1, entry),), noise))
