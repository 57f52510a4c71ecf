"""What there is to compute: jobs that run in any order and any process, and how large they are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

# Schemes for which the extra fast has compiled code: it takes a few per cent of NumPy's time, and its own loading.
COMPILED = frozenset(("energy-preserving", "midpoint", "euler-heun", "milstein"))


@dataclass(frozen=True)
class Job:
    """One call of a function of `runs`, with the seconds that NumPy is expected to take (for progress only)."""

    key: tuple[str, ...]
    function: Callable[..., Any]
    arguments: dict[str, Any]
    seconds: float

    def expected(self) -> float:
        """Seconds, with the engine that will serve: for the job's place in the queue and the time left."""
        compiled = self.arguments.get("engine") == "auto" and self.arguments.get("scheme") in COMPILED
        return 0.1 + 0.02 * self.seconds if compiled and find_spec("numba") else self.seconds


@dataclass(frozen=True)
class Size:
    """How much is computed: everything the paper has, or a share of it for a quick look; and by which engine."""

    share: float = 1.0
    seed: int = 0
    engine: str = "auto"

    @property
    def given(self) -> dict[str, Any]:
        """What every job of paths is told."""
        return {"seed": self.seed, "engine": self.engine}

    def steps(self, full: int) -> int:
        """The steps of a long run."""
        return max(128, round(full * self.share))

    def samples(self, full: int) -> int:
        """The samples of a convergence plot."""
        return max(128, round(full * self.share))


Results = dict[tuple[str, ...], Any]
