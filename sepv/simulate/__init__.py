"""Paths and ensembles of paths: Wiener increments, the loop over the time steps,
and the engine of compiled code.

Read `_wiener` first: the increments depend only on the seed, the number of the path and the step.
Next come `_truncation` (Remark 2.1 of the paper), `_areas` (Lévy areas), `_paths` (one path),
`_batch` (many paths in NumPy), `_ensembles` (chunks of paths, run by workers), `_compiled` (code
made for a problem and a scheme) and `_results` (records of many paths). The compiled engine is
loaded at its first use, because exact solutions and tests of laws need only increments and batches.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sepv._lazy import lazily
from sepv.simulate import _areas as areas
from sepv.simulate import _truncation as truncation
from sepv.simulate import _wiener as wiener
from sepv.simulate._areas import RoughPath
from sepv.simulate._areas import drawn as drawn
from sepv.simulate._batch import CHUNK, Carried, Watch, advance, batch_step, judged, run_chunk
from sepv.simulate._batch import Ensemble as Ensemble
from sepv.simulate._run_arguments import checked as run_arguments
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
