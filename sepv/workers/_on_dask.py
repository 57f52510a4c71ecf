"""Tasks on Dask: chunks of paths as futures of a `distributed.Client`,
at most a few for each thread of the cluster.

If a worker dies, Dask gives its chunk to another worker; if a chunk raises, Dask tries the chunk
once more. A worker that is frozen (stopped, or without a network) keeps its chunks for ever in
Dask, so this file sends them elsewhere. A worker must have the versions of this process (this is
checked), because other versions may give other bits. A run does not hang but ends with a message if
the scheduler is lost or frozen, the cluster has no workers, or a chunk kills worker after worker.
"""

from __future__ import annotations

import asyncio
import platform
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from pickle import PickleError
from queue import Empty
from typing import Any, NamedTuple

from sepv._arguments import optional
from sepv._version import __version__
from sepv.errors import ClusterFailure, UsageError
from sepv.workers._pool import TASKS_PER_WORKER, Futures, TaskOutcome, cannot_travel

# Dask's retries of a chunk that raised. After them, the chunk runs once in this process, which
# shows the error.
RETRIES = 1
# Seconds to wait for a scheduler's answer, and for a first worker: a cluster that grows by itself
# starts without any.
CONNECT_SECONDS = 10.0
NO_WORKER = 120.0
# Seconds to wait for one result. After that, the cluster is checked, and the result is requested
# again.
FETCH_SECONDS = 60.0
# Seconds between two checks of the cluster while nothing arrives.
LOOK_SECONDS = 1.0
# A chunk is overdue if it takes longer than LATE_ROUNDS rounds of the longest chunk so far; a round
# is that of the TASKS_PER_WORKER chunks in a thread's queue, and this one. It goes to another
# worker only if its own has sent no sign of life (Dask's workers send one in a few seconds at most)
# for SILENT_SECONDS seconds: a chunk that is merely long is let alone. Without another worker, or a
# chunk to compare with, the silence must last FROZEN_SECONDS seconds, after which Dask gives a
# worker up.
LATE_ROUNDS, SILENT_SECONDS, FROZEN_SECONDS = 2.0, 20.0, 300.0
# The number of times that a chunk is sent to another worker.
RESENDS = 2


class TaskRaised(Exception):
    """The error of a task that raised on a worker, as text,
    because some exceptions cannot be sent to this process.
    """


class Done(NamedTuple):
    """A task's result, and the seconds that it took."""

    result: Any
    seconds: float


class Unfit(str):
    """A text in place of a task's result: how versions of packages on the worker differ from those
    of this process.
    """


@dataclass(frozen=True)
class OnWorker:
    """A callable to send to workers: it runs `function` on a task if the worker has the `wanted`
    versions.
    """

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
        begun = time.monotonic()
        try:
            return Done(self.function(task), time.monotonic() - begun)
        except Exception as error:
            raise TaskRaised(f"{type(error).__name__}: {error}") from None


@cache
def versions(alike: tuple[str, ...]) -> dict[str, str]:
    """The versions of sepv and of the packages `alike` ("none" if missing);
    the bits of results depend on them.
    """
    installed = {name: metadata.version(name) if find_spec(name) is not None else "none" for name in alike}
    return {"sepv": __version__, **installed}


def threads(client: Any) -> int:
    """The number of threads of a client's cluster; 0 if the scheduler does not say within
    CONNECT_SECONDS.
    """
    with suppress(Exception):  # Dask raises many kinds for a scheduler that is gone
        return sum(client.sync(client.scheduler.ncores, callback_timeout=CONNECT_SECONDS).values())
    return 0


@contextmanager
def dask_crew(workers: Any, function: Callable[[Any], Any], alike: tuple[str, ...]) -> Iterator[DaskCrew]:
    """A context with a crew: the workers of a Dask client, of a Dask cluster,
    or of the scheduler at an address.

    Raises a UsageError if Dask is not installed, no scheduler is at the address, or the client is
    asynchronous.
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
        client = Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError) as error:
        raise UsageError(
            expected="the address of a Dask scheduler, such as tcp://127.0.0.1:8786",
            received=f"{address}: {type(error).__name__}: {error}",
            remedy="start one with `dask scheduler`, and take the address that it prints",
        ) from error
    try:
        yield DaskCrew(client, function, alike)
    finally:
        client.close(timeout=CONNECT_SECONDS)


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
        self.name = f"sepv-{uuid.uuid4().hex[:8]}"
        self.threads, self.looked, self.alone = 0, -LOOK_SECONDS, time.monotonic()
        self.tasks: dict[int, Any] = {}
        self.sent: dict[int, list[float]] = {}  # for each unfinished chunk, when it was sent
        self.longest = 0.0  # seconds of a chunk
        self.heard: dict[
            str, tuple[float, float]
        ] = {}  # each worker's last sign of life, and when it came here
        self.scheduler = self._identity()["id"]

    def room(self) -> int:
        """The number of tasks that may be submitted, counted from the first unfinished one:
        four for each thread.
        """
        if time.monotonic() - self.looked > LOOK_SECONDS:
            self._look()
        return max(TASKS_PER_WORKER, TASKS_PER_WORKER * self.threads)

    def submit(self, numbered: Sequence[tuple[int, Any]]) -> None:
        """Submit tasks in one message, with names that no other run has:
        Dask identifies tasks by their names.
        """
        keys, awake = (
            [f"{self.name}-{number}" for number, _ in numbered],
            sorted(self.heard.keys() - self._silent(SILENT_SECONDS)),
        )
        where = {"workers": awake, "allow_other_workers": True} if 0 < len(awake) < len(self.heard) else {}
        try:
            futures = self.client.map(
                self.function, [task for _, task in numbered], key=keys, retries=RETRIES, **where
            )
        except (TypeError, AttributeError, PickleError) as error:
            raise cannot_travel(error) from error
        except Exception as error:
            raise self._gone(error) from error
        for (number, task), future in zip(numbered, futures, strict=True):
            self.tasks[number], self.sent[number] = task, [time.monotonic()]
            self.watch(number, future)

    def finished(self) -> list[TaskOutcome]:
        """Wait for at least one outcome, and return all that arrived;
        raise ClusterFailure if the cluster is lost.
        """
        outcomes: list[TaskOutcome] = []
        while not outcomes:
            try:
                done = [self.done.get(timeout=LOOK_SECONDS)]
            except Empty:
                self._look()
                continue
            while not self.done.empty():
                done.append(self.done.get())
            # A chunk that was sent twice is done once: by the worker to which it was sent last.
            numbers = [number for number, future in done if self.running.get(number) is future]
            fetched = self._fetched(numbers)
            outcomes = [outcome for number in numbers for outcome in self._outcomes(number, fetched)]
        return outcomes

    def _fetched(self, numbers: list[int]) -> dict[int, Any]:
        """Fetch the results of several tasks in one message; return {} if that fails:
        each is then fetched alone.
        """
        ready = [number for number in numbers if self.running[number].status == "finished"]
        if len(ready) < 2:
            return {}
        gathered = self.client.gather([self.running[number] for number in ready], asynchronous=True)
        waiting = asyncio.run_coroutine_threadsafe(gathered, self.client.loop.asyncio_loop)
        try:
            return dict(zip(ready, waiting.result(FETCH_SECONDS), strict=True))
        except Exception:  # a worker or the scheduler died meanwhile; each result is tried alone
            waiting.cancel()
            return {}

    def _outcomes(self, number: int, fetched: dict[int, Any]) -> list[TaskOutcome]:
        """A list with a finished task's outcome, from `fetched` or its worker;
        empty if the task is awaited again.
        """
        from distributed import KilledWorker

        future = self.running.pop(number)
        if future.status in ("lost", "pending"):
            # The worker died with the result, so the task is computed again.
            self.watch(number, future)
            return []
        if future.status == "error":
            error = future.exception(timeout=CONNECT_SECONDS)
            if isinstance(error, TaskRaised):
                return [TaskOutcome(number, False, error)]
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
            result = fetched[number] if number in fetched else future.result(timeout=FETCH_SECONDS)
        except TimeoutError:  # its worker has computed it, and gives it to nobody
            self._look()
            self._resend(number, future, self._holders(future.key))
            return []
        except Exception as error:
            raise self._gone(error) from error
        if isinstance(result, Unfit):
            raise ClusterFailure(
                f"A worker is not like this process: {result}. Other versions may give other bits.",
                "install the same versions everywhere (pip install numba); where no worker has numba, "
                "engine='numpy' with a process without it",
            )
        self.longest = max(self.longest, result.seconds)
        del self.tasks[number], self.sent[number]
        return [TaskOutcome(number, True, result.result)]

    def cancel(self) -> None:
        """Cancel unfinished tasks, unless the client is closed or has lost the cluster."""
        if self.running and self.client.status == "running":
            with suppress(TimeoutError):  # of a frozen scheduler
                self._asked(self.client._cancel, list(self.running.values()), force=True)
        self.running.clear()

    def _look(self) -> None:
        """Check that the cluster still knows this run, update its number of threads,
        and look for frozen workers.
        """
        self.looked = time.monotonic()
        if self.client.status != "running":
            raise self._gone(f"the client is {self.client.status}")
        known = self._identity()
        if known["id"] != self.scheduler:
            raise self._gone("another one answers")
        if any(future.status == "cancelled" for future in self.running.values()):
            raise self._gone("chunks are cancelled")
        self.threads = known["total_threads"]
        signs = {name: worker["last_seen"] for name, worker in known["workers"].items()}
        for name, sign in signs.items():
            if self.heard.get(name, (0.0, 0.0))[0] != sign:
                self.heard[name] = sign, self.looked
        self.heard = {name: self.heard[name] for name in signs}
        if self.threads:
            self.alone = self.looked
            self._relieve()
        elif self.looked - self.alone > NO_WORKER:
            raise ClusterFailure(
                f"The cluster at {self.address} has had no worker for {NO_WORKER:g} s.",
                "start workers, and call again",
            )

    def _asked(self, question: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
        """The scheduler's answer to a question, a coroutine of Dask;
        TimeoutError without one in CONNECT_SECONDS.
        """
        return self.client.sync(question, *arguments, callback_timeout=CONNECT_SECONDS, **options)

    def _identity(self) -> dict[str, Any]:
        try:
            known: dict[str, Any] = self._asked(self.client.scheduler.identity, n_workers=-1)
        except Exception as error:
            raise self._gone(error) from error
        return known

    def _silent(self, seconds: float) -> set[str]:
        """The workers that have sent no sign of life for so long."""
        return {name for name, (_, came) in self.heard.items() if self.looked - came > seconds}

    def _holders(self, key: str) -> set[str]:
        """The workers that compute a chunk, or hold its result."""
        try:
            queues = self._asked(self.client.scheduler.processing, workers=None)
            results = self._asked(self.client.scheduler.who_has, keys=[key])
        except Exception as error:
            raise self._gone(error) from error
        return {name for name, keys in queues.items() if key in keys} | set(results.get(key, ()))

    def _relieve(self) -> None:
        """Send overdue chunks of silent workers elsewhere."""
        silent, frozen = self._silent(SILENT_SECONDS), self._silent(FROZEN_SECONDS)
        late = (
            LATE_ROUNDS * (TASKS_PER_WORKER + 1) * self.longest
            if self.longest and len(self.heard) > len(silent)
            else FROZEN_SECONDS
        )
        overdue = (
            [n for n in self.running if self.looked - self.sent[n][-1] > max(late, SILENT_SECONDS)]
            if silent
            else []
        )
        for number in overdue:
            holders = self._holders(self.running[number].key)
            if holders and holders <= (silent if late < FROZEN_SECONDS else frozen):
                self._resend(number, self.running[number], holders)

    def _resend(self, number: int, future: Any, holders: set[str]) -> None:
        """Compute a chunk on workers other than `holders`, from which no result comes;
        its old future is forgotten.
        """
        others = sorted(set(self.heard) - holders - self._silent(SILENT_SECONDS))
        if len(self.sent[number]) > RESENDS or not others:
            names, count = ", ".join(sorted(holders)) or "a worker", len(self.sent[number])
            raise ClusterFailure(
                f"Chunk {number} was sent {count} times, and nothing came back: no sign of life from {names}, and "
                f"{len(others)} other workers.",
                "end the workers that are frozen, start others, and call again; with store= what is finished is not "
                "computed again",
            )
        self.sent[number].append(time.monotonic())
        key = f"{self.name}-{number}-{len(self.sent[number])}"
        again = self.client.submit(
            self.function, self.tasks[number], key=key, retries=RETRIES, workers=others, pure=False
        )
        self.watch(number, again)
        future.release()

    def _gone(self, why: Any) -> ClusterFailure:
        """The ClusterFailure for a scheduler that does not answer or has forgotten the tasks of
        this run.
        """
        text = why if isinstance(why, str) else f"{type(why).__name__}: {why}"
        return ClusterFailure(
            f"The scheduler at {self.address} is gone, or has forgotten this run ({text}).",
            "start it again and call again; with store= what is finished is not computed again",
        )
