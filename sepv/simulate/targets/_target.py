"""The interface of a target: what it takes, how its chunks are made and how large they are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from sepv.problem import Problem
from sepv.schemes import Scheme
from sepv.simulate._batch import Ensemble
from sepv.simulate._ensembles.task import Task


class CannotCompile(Exception):
    """Raised by a target that cannot run a scheme or a problem; the message says why."""


class Chunk(Protocol):
    """A chunk of paths at some step. Arrays may be those of another library with NumPy's interface,
    such as CuPy's.
    """

    @property
    def done(self) -> int:
        """The number of steps done."""

    def advance(self, steps: int) -> None:
        """Take the next `steps` steps."""

    def failed(self) -> bool:
        """True if every path of the chunk has failed."""

    def states(self) -> Any:
        """The present states (d, M)."""

    def result(self, kept: Any) -> Ensemble:
        """The present states as an `Ensemble`; `kept` are the states at the steps `Task.stops`."""


@dataclass(frozen=True)
class Target:
    """A target runs the chunks of an ensemble.

    Attributes
    ----------
    name : str
        The value of `engine` that asks for it, and of `Ensemble.engine`.
    prepare : (scheme, problem, paths, compensated, here) -> None
        Compiles what chunks will need. Raises CannotCompile if the target cannot run this scheme or
        problem, and UsageError if this machine lacks something; with here=False the chunks run
        elsewhere, and nothing is needed.
    chunk : (task, problem) -> Chunk
    size : (task, workers, fixed) -> int
        The paths of a chunk. If `fixed` (chunks are stored or reduced), it does not depend on the
        workers, so that results have the same bits.
    piece : int
        Paths × steps between two checks for Ctrl-C and for a chunk that is no longer needed:
        hundredths of a second.
    threads : bool
        True if chunks run side by side as threads of this process, False if they need processes of
        their own.
    recorded : bool
        True if it records a scheme's and a problem's functions, which then are immutable.
    packages : names of the packages whose versions must be the same on all machines
    """

    name: str
    prepare: Callable[[Scheme, Problem, int, bool, bool], None]
    chunk: Callable[[Task, Problem], Chunk]
    size: Callable[[Task, Any, bool], int]
    piece: int
    threads: bool
    recorded: bool
    packages: tuple[str, ...]
