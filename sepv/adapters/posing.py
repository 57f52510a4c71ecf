"""A problem for a library with arrays of its own: `field_in` gives f = B∇H as a function of JAX's or torch's arrays.

A problem's own functions are NumPy's, which a compiler cannot trace (`TracerArrayConversionError`) and an automatic
derivative does not see through. Problems given as data are posed again from their numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from sepv.adapters._posing import field, pose
from sepv.adapters.multistep import PathSolver
from sepv.problem import Problem
from sepv.target import load_problem

__all__ = ["PathSolver", "field_in"]


def field_in(xp: Any, problem: str | Problem) -> Callable[[Any], Any]:
    """y (d,) or (d, M) -> f(y) = B(y)∇H(y), in the arrays of the namespace `xp`: jax.numpy, torch or numpy.

    Use float64: ``jax.config.update("jax_enable_x64", True)`` before any JAX array is made, or
    ``torch.set_default_dtype(torch.float64)``.

    Raises
    ------
    UsageError
        For a problem made of Python functions: other libraries cannot run NumPy's.
    """
    posed = pose(load_problem(problem))
    make = getattr(xp, "as_tensor", None) or xp.asarray
    arrays = tuple(make(a) for a in posed.arrays)
    return lambda y: field(xp, posed.kind, posed.powers, arrays, y)
