"""The class `Peer`, which describes another library's solvers for sepv,
and how its objects are found.

A peer is one file with one `Peer`, called `PEER`. sepv's own peers are the modules of this folder.
Another package offers one by an entry point of the group ``sepv.peers``, under the library's name:

    [project.entry-points."sepv.peers"]
    mylibrary = "mypackage.adapter:PEER"

`sepv verify` and `sepv compare` take names such as ``sdeint-strat-heun``: the library's name, a
hyphen and the solver's name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar

from sepv._arguments import did_you_mean, optional
from sepv.errors import TargetError, UnknownTarget, unknown_name
from sepv.posing import Path as WholePath
from sepv.schemes import PathSolver, Scheme, Step
from sepv.studies import Method

ENTRY_POINTS = "sepv.peers"
_Kind = TypeVar("_Kind")


@dataclass(frozen=True)
class Solver:
    """A solver for general noise and its documentation. A solver of Itô equations gets the system
    in Itô's form, which has the same solution.

    Attributes
    ----------
    name : str
        "library name".
    documented : {kind of noise: (strong order, weak order)}
        The kinds are those of `sepv.problem.column`. An order is None if the documentation names
        none; kinds that the solver does not take are left out.
    source : str
        The place in the documentation.
    step : callable (kind of noise) -> step
    ito : bool
        True if the solver is documented for Itô's form.
    asks : str
        The areas that it needs, as for `Scheme`.
    batched : bool
        True if the step takes a batch, as for `Scheme`.
    path : callable (kind of noise) -> path, optional
        For a solver with a state of its own: (problem, y0, h, dW (N, m + k, M)) -> states (N + 1,
        d, M).
    """

    name: str
    documented: Mapping[str, tuple[float | None, float | None]]
    source: str
    step: Callable[[str], Step]
    ito: bool = False
    asks: str = ""
    batched: bool = True
    path: Callable[[str], WholePath] | None = None


@dataclass(frozen=True)
class Peer:
    """A library, with the solvers that sepv can run.

    Attributes
    ----------
    library : str
        The name by which Python imports the library.
    schemes : dict of str to Scheme
        The solvers as single steps, for the laws. Keys are the names after "library-".
    methods : dict of str to Method
        The solvers over whole paths in the library's fastest known loop, for `sepv compare`.
    drawing : tuple of Scheme
        Solvers that draw a Lévy area too. So an average of y1 over ΔW alone is not the mean of y1.
    absent : tuple of str
        Solvers that the installed release lacks.
    integrators : dict of str to Scheme
        Integrators of mechanical systems without noise, one step at a time, for the laws.
    solvers : tuple of Solver
        All solvers for general noise, with their documented orders, of which
        `benchmarks.peers.solvers` makes a page.
    thermostats : dict of str to Scheme
        Integrators of Langevin dynamics whose noise is given, one step at a time, for the laws.
    """

    library: str
    schemes: Mapping[str, Scheme] = field(default_factory=dict)
    methods: Mapping[str, Method] = field(default_factory=dict)
    drawing: tuple[Scheme, ...] = ()
    absent: tuple[str, ...] = ()
    integrators: Mapping[str, Scheme] = field(default_factory=dict)
    solvers: tuple[Solver, ...] = ()
    thermostats: Mapping[str, Scheme] = field(default_factory=dict)

    def drivers(self) -> dict[str, Method | None]:
        """The solvers of whole paths for `sepv compare`: `methods`,
        with None for each scheme with a `PathSolver`.
        """
        paths = [name for name, scheme in self.schemes.items() if isinstance(scheme.step, PathSolver)]
        return {**dict.fromkeys(paths), **self.methods}


def names() -> list[str]:
    """The names of libraries that have a `Peer` here or in another package, installed or not."""
    own_names = sorted(
        p.stem for p in Path(__file__).parent.glob("*.py") if p.stem != "peer" and p.stem[0] != "_"
    )
    return list(
        dict.fromkeys((*own_names, *(point.name for point in metadata.entry_points(group=ENTRY_POINTS))))
    )


def installed() -> list[Peer]:
    """The peers whose library is installed."""
    return [load(name) for name in names() if find_spec(name)]


def load(library: str) -> Peer:
    """The `Peer` of a library. This imports the library.

    Raises
    ------
    TargetError
        If the library is not installed, or its entry point gives no `Peer`.
    """
    points = {point.name: point.value for point in metadata.entry_points(group=ENTRY_POINTS)}
    module, _, attribute = points.get(library, f"sepv.peers.{library}:PEER").partition(":")
    peer = getattr(
        optional(module, f"the library {library}", f"pip install {library}", TargetError), attribute, None
    )
    if not isinstance(peer, Peer):
        raise TargetError(
            expected=f"a sepv.peers.Peer at {module}:{attribute}",
            received=f"{type(peer).__name__}",
            remedy=f"correct the entry point {library} of the group {ENTRY_POINTS}",
        )
    return peer


def library_of(target: str) -> str:
    """The library with which a name such as ``sdeint-strat-heun`` begins;
    "" if the name begins with no library.
    """
    return next((name for name in names() if target.startswith(f"{name}-")), "")


def scheme(target: str) -> Scheme | None:
    """The scheme that takes single steps of the solver ``library-name``;
    None if the name begins with no library.

    Raises TargetError as `load` does, or if the library has no solver of that name.
    """
    library = library_of(target)
    if not library:
        return None
    peer = load(library)
    return _one(target, library, {**peer.schemes, **peer.integrators, **peer.thermostats})


def method(target: str) -> Method | None:
    """The solver `target` of whole paths for `sepv compare`; None if it is run as a scheme,
    like an integrator, or if the name begins with no library.

    Raises TargetError as `scheme`.
    """
    library = library_of(target)
    if not library:
        return None
    peer = load(library)
    return _one(target, library, {**dict.fromkeys((*peer.integrators, *peer.thermostats)), **peer.drivers()})


def _one(target: str, library: str, known: Mapping[str, _Kind]) -> _Kind:
    by_name: dict[str, Any] = {f"{library}-{name}": value for name, value in known.items()}
    if target not in by_name:
        unknown = unknown_name(
            f"a solver of {library}", did_you_mean(target, by_name), by_name, "see `sepv peers`"
        )
        raise UnknownTarget(expected=unknown.expected, received=unknown.received, remedy=unknown.remedy)
    kind: _Kind = by_name[target]
    return kind
