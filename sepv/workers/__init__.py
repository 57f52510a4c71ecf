"""Workers: numbered tasks on threads, processes, an executor, a map or a Dask cluster.

Read `_run_all` first (the kinds of workers, and tasks that are computed again), then `_pool` (threads, processes,
futures) and `_on_dask`.
"""

from __future__ import annotations

from sepv.workers._pool import Halted, ended_at_once, halted
from sepv.workers._run_all import check, count, run_all
