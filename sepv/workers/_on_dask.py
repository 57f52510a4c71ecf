"""Tasks on Dask: chunks of paths as futures of a `distributed.Client`, at most a few for each thread of the cluster.

If a worker dies, Dask gives its chunk to another worker; if a chunk raises, Dask tries the chunk once more. A worker
must have the versions of this process (this is checked), because other versions may give other bits. A run does not
hang but ends with a message if the scheduler is lost, the cluster has no workers, or a chunk kills worker after worker.
"""

from __future__ import annotations

import asyncio
import platform
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from pickle import PickleError
from queue import Empty
from typing import Any

from sepv._arguments import optional
from sepv._version import __version__
from sepv.errors import ClusterFailure, UsageError
from sepv.workers._pool import AHEAD, Futures, Outcome, cannot_travel

# Dask's retries of a chunk that raised. After them, the chunk runs once in this process, which shows the error.
RETRIES = 1
# Seconds to wait for a scheduler's answer, and for a first worker: a cluster that grows by itself starts without any.
CONNECT = 10.0
NO_WORKER = 120.0
# Seconds to wait for one result. After that, the cluster is checked, and the result is requested again.
FETCH = 60.0
# Seconds between two checks of the cluster while nothing arrives.
LOOK = 1.0


class TaskRaised(Exception):
    """The error of a task that raised on a worker, as text, because some exceptions cannot be sent to this process."""


class Unfit(str):
    """A text in place of a task's result: how versions of packages on the worker differ from those of this process."""


@dataclass(frozen=True)
class OnWorker:
    """A callable to send to workers: it runs `function` on a task if the worker has the `wanted` versions."""

    function: Callable[[Any], Any]
    wanted: dict[str, str]

    def __call__(self, task: Any) -> Any:
        installed = versions(tuple(k for k in self.wanted if k != "sepv"))
        if installed != self.wanted:
            return Unfit(
                ", ".join(
                    f"{k} {installed[k]} and not {v}" for k, v in self.wanted.items() if installed[k] != v
                )
                + f" on {platform.node()}"
            )
        try:
            return self.function(task)
        except Exception as error:
            raise TaskRaised(f"{type(error).__name__}: {error}") from None


@cache
def versions(alike: tuple[str, ...]) -> dict[str, str]:
    """The versions of sepv and of the packages `alike` ("none" if missing); the bits of results depend on them."""
    installed = {name: metadata.version(name) if find_spec(name) is not None else "none" for name in alike}
    return {"sepv": __version__, **installed}


@contextmanager
def dask_crew(workers: Any, function: Callable[[Any], Any], alike: tuple[str, ...]) -> Iterator[DaskCrew]:
    """A context with a crew: the workers of a Dask client, of a Dask cluster, or of the scheduler at an address.

    Raises a UsageError if Dask is not installed, no scheduler is at the address, or the client is asynchronous.
    """
    needed = "Dask, for workers that are a scheduler's address"
    Client = optional("distributed", needed, "pip install dask distributed").Client
    if isinstance(workers, Client):
        if workers.asynchronous:
            raise UsageError(
                expected="a client that waits",
                received="Client(asynchronous=True)",
                remedy="Client(address), in a thread of its own where the loop must go on",
            )
        yield DaskCrew(workers, function, alike)
        return
    address = workers if isinstance(workers, str) else workers.scheduler_address
    if address.startswith("tls://"):
        _require_certificates(address)
    try:
        client = Client(address, timeout=CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise UsageError(
            expected="the address of a Dask scheduler, such as tcp://127.0.0.1:8786",
            received=f"{address}: {type(error).__name__}: {error}",
            remedy="start one with `dask scheduler`, and take the address that it prints",
        ) from error
    try:
        yield DaskCrew(client, function, alike)
    finally:
        client.close(timeout=CONNECT)


def _require_certificates(address: str) -> None:
    """Raise a UsageError for a TLS address if Dask's configuration names no certificates."""
    from distributed.security import Security

    if Security().get_connection_args("client").get("ssl_context") is None:
        raise UsageError(
            expected="certificates for a scheduler that uses TLS",
            received=f"{address}, and none in the configuration of Dask",
            remedy="workers=Client(address, security=Security(tls_ca_file=…, tls_client_cert=…, tls_client_key=…)), or "
            "distributed.comm.tls in ~/.config/dask (docs/clusters.md)",
        )


class DaskCrew(Futures):
    """A crew that computes tasks on the cluster of a Dask client."""

    def __init__(self, client: Any, function: Callable[[Any], Any], alike: tuple[str, ...]) -> None:
        super().__init__(None, OnWorker(function, versions(alike)))
        self.client = client
        self.address = client.scheduler.address if client.scheduler is not None else "its address"
        self.scheduler = client.scheduler_info()["id"]
        self.name = f"sepv-{uuid.uuid4().hex[:8]}"
        self.threads, self.looked, self.alone = 0, -LOOK, time.monotonic()

    def room(self) -> int:
        """The number of tasks that may be submitted, counted from the first unfinished one: four for each thread."""
        if time.monotonic() - self.looked > LOOK:
            self._look()
        return max(AHEAD, AHEAD * self.threads)

    def submit(self, numbered: Sequence[tuple[int, Any]]) -> None:
        """Submit tasks in one message, with names that no other run has: Dask identifies tasks by their names."""
        keys = [f"{self.name}-{number}" for number, _ in numbered]
        try:
            futures = self.client.map(
                self.function, [task for _, task in numbered], key=keys, retries=RETRIES
            )
        except (TypeError, AttributeError, PickleError) as error:
            raise cannot_travel(error) from error
        except Exception as error:
            raise self._gone(error) from error
        for (number, _), future in zip(numbered, futures, strict=True):
            self.watch(number, future)

    def finished(self) -> list[Outcome]:
        """Wait for at least one outcome, and return all that arrived; raise ClusterFailure if the cluster is lost."""
        outcomes: list[Outcome] = []
        while not outcomes:
            try:
                numbers = [self.done.get(timeout=LOOK)]
            except Empty:
                self._look()
                continue
            while not self.done.empty():
                numbers.append(self.done.get())
            fetched = self._fetched(numbers)
            outcomes = [outcome for number in numbers for outcome in self._outcomes(number, fetched)]
        return outcomes

    def _fetched(self, numbers: list[int]) -> dict[int, Any]:
        """Fetch the results of several tasks in one message; return {} if that fails: each is then fetched alone."""
        ready = [number for number in numbers if self.running[number].status == "finished"]
        if len(ready) < 2:
            return {}
        gathered = self.client.gather([self.running[number] for number in ready], asynchronous=True)
        waiting = asyncio.run_coroutine_threadsafe(gathered, self.client.loop.asyncio_loop)
        try:
            return dict(zip(ready, waiting.result(FETCH), strict=True))
        except Exception:  # a worker or the scheduler died meanwhile; each result is tried alone
            waiting.cancel()
            return {}

    def _outcomes(self, number: int, fetched: dict[int, Any]) -> list[Outcome]:
        """A list with a finished task's outcome, from `fetched` or its worker; empty if the task is awaited again."""
        from distributed import KilledWorker

        future = self.running.pop(number)
        if future.status in ("lost", "pending"):
            # The worker died with the result, so the task is computed again.
            self.watch(number, future)
            return []
        if future.status == "error":
            error = future.exception(timeout=CONNECT)
            if isinstance(error, TaskRaised):
                return [Outcome(number, False, error)]
            if isinstance(error, KilledWorker):
                raise ClusterFailure(
                    f"Chunk {number} was computed on {error.allowed_failures + 1} workers, and each of them died.",
                    "look at the memory of a worker, or for code that ends the process; a smaller `chunk=` needs less",
                )
            root = error  # the first error: Dask wraps it
            while root.__cause__ is not None:
                root = root.__cause__
            text = f"{root}".rstrip(".")
            raise ClusterFailure(
                f"The cluster could not load chunk {number}: {type(error).__name__}: {text}.",
                "install sepv and the scheme's module on every worker and for the scheduler, or send the module with "
                "client.upload_file",
            )
        if future.status != "finished":
            raise self._gone(future.status)
        try:
            result = fetched[number] if number in fetched else future.result(timeout=FETCH)
        except TimeoutError:
            self._look()
            self.watch(number, future)
            return []
        except Exception as error:
            raise self._gone(error) from error
        if isinstance(result, Unfit):
            raise ClusterFailure(
                f"A worker is not like this process: {result}. Other versions may give other bits.",
                "install the same versions everywhere (pip install numba); where no worker has numba, "
                "engine='numpy' with a process without it",
            )
        return [Outcome(number, True, result)]

    def cancel(self) -> None:
        """Cancel unfinished tasks, unless the client is closed or has lost the cluster."""
        if self.running and self.client.status == "running":
            self.client.cancel(list(self.running.values()), force=True)
        self.running.clear()

    def _look(self) -> None:
        """Check that the cluster still knows this run, and update the number of the cluster's threads."""
        self.looked = time.monotonic()
        if self.client.status != "running":
            raise self._gone(f"the client is {self.client.status}")
        if self.client.scheduler_info()["id"] != self.scheduler:
            raise self._gone("another one answers")
        if any(future.status == "cancelled" for future in self.running.values()):
            raise self._gone("chunks are cancelled")
        try:
            self.threads = sum(self.client.nthreads().values())
        except Exception as error:
            raise self._gone(error) from error
        if self.threads:
            self.alone = self.looked
        elif self.looked - self.alone > NO_WORKER:
            raise ClusterFailure(
                f"The cluster at {self.address} has had no worker for {NO_WORKER:g} s.",
                "start workers, and call again",
            )

    def _gone(self, why: Any) -> ClusterFailure:
        """The ClusterFailure for a scheduler that does not answer or has forgotten the tasks of this run."""
        text = why if isinstance(why, str) else f"{type(why).__name__}: {why}"
        return ClusterFailure(
            f"The scheduler at {self.address} is gone, or has forgotten this run ({text}).",
            "start it again and call again; with store= what is finished is not computed again",
        )
