"""Methods and problems from what a user names."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec

import numpy as np

from sepv.errors import SchemeFault, TargetError
from sepv.problem import Problem
from sepv.schemes import ask, load_scheme
from sepv.schemes._load_target import load_object
from sepv.studies._compare.method import Method, exact_time_change, from_scheme

# Other libraries' solvers under the best driver one can give them: the library, and what `sepv.peers` has of it.
PEERS = (
    "diffrax-heun", "diffrax-heun-vmap", "diffrax-euler-heun", "diffrax-reversible-heun", "diffrax-spark",
    "diffrax-slow-rk", "diffrax-tsit5", "diffrax-dopri8", "diffrax-dopri8-vmap", "torchsde-heun", "torchsde-midpoint",
    "torchsde-reversible-heun", "sdeint-heun",
)  # fmt: skip
EXACT = "exact-flow"
NUMPY = "numpy/"


def load_method(target: str, problem: Problem) -> Method:
    """A built-in scheme, ``exact-flow``, a peer by name, or module:attribute with a scheme or a `Method`.

    ``numpy/SCHEME`` is a scheme in NumPy batches where the compiled engine would take it.
    A third party's scheme is asked for one step first, so that a wrong shape is a message and no traceback.

    Raises
    ------
    TargetError
    """
    if target == EXACT:
        return exact_time_change()
    if target in PEERS:
        return _peer(target)
    if ":" in target:
        found = load_object(target)
        if isinstance(found, Method):
            return found
    plain = target.startswith(NUMPY)
    scheme = load_scheme(target.removeprefix(NUMPY))
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


def _peer(name: str) -> Method:
    library, _, solver = name.partition("-")
    try:
        drivers = import_module(f"sepv.peers._compare_{library}")
    except ModuleNotFoundError as error:
        raise TargetError(
            expected=f"the library of {name}",
            received=f"{error}",
            remedy="pip install diffrax torchsde sdeint, or the one that is named",
        ) from error
    method: Method = getattr(drivers, solver.replace("-", "_"))
    return method


def installed_peers() -> list[str]:
    """The peers whose library is installed."""
    return [name for name in PEERS if find_spec(name.partition("-")[0])]
