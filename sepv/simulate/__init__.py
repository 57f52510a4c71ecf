"""Paths and ensembles: Wiener increments, the loop over steps, the compiled engine.

Read `_wiener` first (increments that depend on the path and the step alone), `_truncation` (Remark 2.1),
`_areas` (Lévy areas), `_paths` (one path), `_batch` (many in NumPy), then `_ensembles` (chunks of paths, on workers),
`_compiled` (code made for a problem and a scheme) and `_results` (records of many paths).

The engine is loaded when it is first used: laws and exact solutions need increments and batches alone.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from sepv.simulate._areas import drawn as drawn
from sepv.simulate._batch import Ensemble as Ensemble
from sepv.simulate._truncation import truncate as truncate
from sepv.simulate._truncation import truncation_bound as truncation_bound
from sepv.simulate._wiener import increments as increments

if TYPE_CHECKING:
    from sepv.simulate._ensembles.ensemble import ensemble as ensemble
    from sepv.simulate._ensembles.long_path import LongPath as LongPath
    from sepv.simulate._ensembles.long_path import long_path as long_path
    from sepv.simulate._paths import Trajectory as Trajectory
    from sepv.simulate._paths import integrate as integrate

_HOME = {
    "ensemble": "_ensembles.ensemble", "LongPath": "_ensembles.long_path", "long_path": "_ensembles.long_path",
    "Trajectory": "_paths", "integrate": "_paths",
}  # fmt: skip


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"sepv.simulate.{_HOME[name]}"), name)
    raise AttributeError(f"module 'sepv.simulate' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted((*globals(), *_HOME))
