"""Both engines on one ensemble, and a system of which every part matters."""

import numpy as np

import sepv
from sepv import problems, schemes

EP = schemes.energy_preserving


def both(scheme, problem, **arguments):
    """The same ensemble by both engines."""
    return (sepv.ensemble(scheme, problem, engine=engine, **arguments) for engine in ("compiled", "numpy"))


def same(a, b) -> bool:
    keys = ("y", "W", "status", "failed_step", "energy_defect", "casimir_defect", "states")
    return (
        all(np.array_equal(getattr(a, key), getattr(b, key)) for key in keys) and a.iterations == b.iterations
    )


def quartic(values=(0.7, 0.4, 0.3, 0.1, -0.05, 1.0, 0.25, -0.125), noise=(0.5, 0.25)) -> sepv.Problem:
    """A random-looking quartic H in the plane with B(y) of degree one: nodes, derivatives and parameters all matter."""
    a, b, c, e, f, *B = values
    from sepv.problem import PolynomialSystem
    from sepv.record import polynomial

    H = polynomial(2, {(2, 0): a, (0, 2): b, (1, 2): c, (4, 0): e, (2, 2): f})
    entry = polynomial(2, {(0, 0): B[0], (1, 0): B[1], (0, 1): B[2]})
    return problems.polynomial_problem(PolynomialSystem(2, H, ((0, 1, entry),), noise))
