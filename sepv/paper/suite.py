"""Compute all figures of the paper: run their jobs in processes,
and collect the results in one object.
"""

from __future__ import annotations

import math
import platform
import time
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from dataclasses import dataclass, replace
from typing import Any

from sepv._version import __version__
from sepv.errors import UsageError
from sepv.files import finite
from sepv.workers import check, count, ended_at_once, run_all

from . import (
    deterministic,
    errata,
    extensions,
    figure_4_3,
    figure_4_6,
    figures_4_1_and_4_2,
    figures_4_4_and_4_5,
    lemma,
    local,
    remarks,
)
from .record import Job, Panel, Results, Size, Statement, counts

FIGURES = ("4.1", "4.2", "4.3", "4.4", "4.5", "4.6")
# Panels about §2, §3 and the remarks.
THEORY = "theory"
# The modules with the jobs of the paper's sections, and the functions that make their panels, by
# figure.
SECTIONS: tuple[tuple[Any, dict[str, Callable[[Results], list[Panel]]]], ...] = (
    (figures_4_1_and_4_2, {"4.1": figures_4_1_and_4_2.long_time, "4.2": figures_4_1_and_4_2.convergence}),
    (figure_4_3, {"4.3": figure_4_3.panels}),
    (figures_4_4_and_4_5, {"4.4": figures_4_4_and_4_5.long_time, "4.5": figures_4_4_and_4_5.convergence}),
    (figure_4_6, {"4.6": figure_4_6.panels}),
    *((section, {THEORY: section.panels}) for section in (deterministic, lemma, local, remarks, extensions)),
)  # fmt: skip
# Formulas and arguments of the text, which need no run.
TEXT_ONLY = "text"

# A callback with the estimated seconds of work done, and the estimated seconds of all work.
ShareProgress = Callable[[float, float], None]


@dataclass(frozen=True)
class Reproduction:
    """The result of a reproduction: panels, statements,
    and the seconds by the clock and of processor time.
    """

    panels: tuple[Panel, ...]
    text: tuple[Statement, ...]
    size: Size
    seconds: float
    processor_seconds: float
    workers: int

    @property
    def statements(self) -> tuple[Statement, ...]:
        """The statements about the panels, and then those about formulas and arguments in the
        text.
        """
        return (*(s for p in self.panels for s in p.statements), *self.text)

    def to_json(self) -> dict[str, Any]:
        """The reproduction as JSON, in the form that sepv/schemas/reproduction.schema.json
        describes.
        """
        import numpy
        import scipy

        return {
            "reproduction": {
                "name": "sepv",
                "version": __version__,
                **vars(self.size),
                "seconds": round(self.seconds, 1),
                "processor_seconds": round(self.processor_seconds, 1),
                "workers": self.workers,
                "python": platform.python_version(),
                "numpy": numpy.__version__,
                "scipy": scipy.__version__,
                "of": "D. Cohen and G. Dujardin, Energy-preserving integrators for stochastic Poisson systems (2014)",
            },
            "counts": counts(self.statements),
            "panels": [p.to_json() for p in self.panels],
            "text": [finite(vars(s)) for s in self.text],
        }


def reproduce(
    figures: Iterable[str] = (),
    *,
    size: Size | None = None,
    workers: Any = 2,
    progress: ShareProgress = lambda _done, _all: None,
) -> Reproduction:
    """Compute the panels of figures of the paper, with a verdict on each statement.

    Parameters
    ----------
    figures : names such as "4.3", "theory" or "text"; all of them by default.
    workers : int, executor, map-like callable, Dask client or its address
        The number of processes, or any `workers` of `sepv.ensemble`. The results do not depend on
        the workers.

    Raises
    ------
    UsageError
        If the paper has no figure of this name.
    """
    wanted = tuple(dict.fromkeys(figures)) or (*FIGURES, THEORY, TEXT_ONLY)
    unknown = [f for f in wanted if f not in (*FIGURES, THEORY, TEXT_ONLY)]
    if unknown:
        raise UsageError(
            expected=f"figures among {', '.join((*FIGURES, THEORY, TEXT_ONLY))}",
            received=", ".join(map(repr, unknown)),
            remedy="sepv reproduce 4.3, or no argument for all of them",
        )
    check(workers)
    size, started = size or Size(), time.perf_counter()
    jobs = [job for section, _ in SECTIONS for job in section.jobs(size) if job.key[0] in wanted]
    results = _run([replace(job, seconds=job.expected()) for job in jobs], workers, progress)
    panels = [p for _, by_figure in SECTIONS for p in _panels(by_figure, results, wanted)]
    return Reproduction(
        panels=tuple(panels),
        text=tuple(errata.statements()) if TEXT_ONLY in wanted else (),
        size=size,
        seconds=time.perf_counter() - started,
        processor_seconds=sum(results[("seconds",)].values()),
        workers=count(workers),
    )


def _panels(
    by_figure: dict[str, Callable[[Results], list[Panel]]], results: Results, wanted: tuple[str, ...]
) -> list[Panel]:
    made = []
    for figure, make in by_figure.items():
        if figure in wanted:
            panels = make(results)
            seconds = sum(t for key, t in results[("seconds",)].items() if key[0] == figure)
            made += [replace(p, seconds=round(seconds / len(panels), 2)) for p in panels]
    return made


def _run(jobs: list[Job], workers: Any, progress: ShareProgress) -> Results:
    """Compute all jobs; return results by the jobs' keys. Long jobs start first,
    so that none runs alone at the end.
    """
    jobs = sorted(jobs, key=lambda j: -j.seconds)
    done, total = 0.0, sum(j.seconds for j in jobs)
    results: Results = {("seconds",): {}}

    def take(number: int, result: tuple[Any, float]) -> None:
        nonlocal done
        job = jobs[number]
        results[job.key], results[("seconds",)][job.key] = result
        done += job.seconds
        progress(done, total)

    progress(done, total)
    # On a cluster a job's progress cannot be seen; in processes of this machine it can be
    # estimated.
    if not isinstance(workers, int) or workers == 1 or len(jobs) < 2:
        run_all(_timed, jobs, workers, threads=False, receive=take)
        return results
    with ended_at_once(ProcessPoolExecutor(workers)) as pool:
        running = {pool.submit(_timed, job): number for number, job in enumerate(jobs)}
        since: dict[int, float] = {}
        while running:
            finished, _ = wait(running, timeout=0.5, return_when=FIRST_COMPLETED)
            for future in finished:
                take(running.pop(future), future.result())
            now = time.perf_counter()
            active = [(jobs[n], now - since.setdefault(n, now)) for n in list(running.values())[:workers]]
            # The estimated progress of a running job approaches its end and never reaches it.
            parts = (job.seconds * (1 - math.exp(-elapsed / job.seconds)) for job, elapsed in active)
            progress(done + sum(parts), total)
    return results


def _timed(job: Job) -> tuple[Any, float]:
    """The result of one job, and the processor time that it took."""
    started = time.process_time()
    return job.function(**job.arguments), time.process_time() - started
