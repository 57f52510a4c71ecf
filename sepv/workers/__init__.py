"""Workers, which compute numbered tasks: threads, processes, an executor, a map or a Dask cluster.

Read `_run_all` first (the kinds of workers, and tasks that are computed again), then `_pool`
(threads, processes, futures) and `_on_dask`.
"""

from __future__ import annotations

from sepv.workers._pool import Halted as Halted
from sepv.workers._pool import ended_at_once as ended_at_once
from sepv.workers._pool import halted as halted
from sepv.workers._run_all import check as check
from sepv.workers._run_all import count as count
from sepv.workers._run_all import run_all as run_all
