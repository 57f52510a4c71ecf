"""Paths and ensembles: Wiener increments, the loop over steps, the compiled engine.

Read `_wiener` first (increments that depend on the path and the step alone), `_truncation` (Remark 2.1),
`_areas` (Lévy areas), `_paths` (one path), `_batch` (many in NumPy), then `_ensembles` (chunks of paths, on workers),
`_compiled` (code made for a problem and a scheme) and `_results` (records of many paths).

The engine is loaded when it is first used: laws and exact solutions need increments and batches alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sepv._lazy import lazily
from sepv.simulate import _areas as areas
from sepv.simulate import _truncation as truncation
from sepv.simulate import _wiener as wiener
from sepv.simulate._areas import RoughPath
from sepv.simulate._areas import drawn as drawn
from sepv.simulate._batch import CHUNK, Carried, advance, batch_step, judged, run_chunk
from sepv.simulate._batch import Ensemble as Ensemble
from sepv.simulate._run_arguments import initial_state, step_count
from sepv.simulate._truncation import seen
from sepv.simulate._truncation import truncate as truncate
from sepv.simulate._truncation import truncation_bound as truncation_bound
from sepv.simulate._wiener import increments as increments

if TYPE_CHECKING:
    from sepv.simulate._ensembles.collectors import run as run_task
    from sepv.simulate._ensembles.ensemble import choose as choose_engine
    from sepv.simulate._ensembles.ensemble import ensemble as ensemble
    from sepv.simulate._ensembles.long_path import LongPath as LongPath
    from sepv.simulate._ensembles.long_path import long_path as long_path
    from sepv.simulate._ensembles.task import Task
    from sepv.simulate._paths import Trajectory as Trajectory
    from sepv.simulate._paths import integrate as integrate

__getattr__, __dir__ = lazily(
    __name__,
    {
        "_ensembles.collectors": "run_task=run",
        "_ensembles.ensemble": "choose_engine=choose ensemble",
        "_ensembles.long_path": "LongPath long_path",
        "_ensembles.task": "Task",
        "_paths": "Trajectory integrate",
    },
)
