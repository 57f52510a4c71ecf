"""Dask: the same bits on any workers, whatever dies, and a clear word where nothing can be done.

Real processes on the loopback interface; everything that waits has a limit.
"""

import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sepv
from sepv import Interrupted, problems, schemes
from sepv.simulate import _wiener as wiener
from sepv.simulate._batch import AXES
from sepv.simulate.targets.cuda import devices
from sepv.workers import _on_dask as on_dask
from sepv.workers import count, run_all
from sepv.workers._pool import TASKS_PER_WORKER

distributed = pytest.importorskip("distributed")

EP = schemes.energy_preserving
PENDULUM = problems.pendulum()
SMALL: dict[str, Any] = {"h": 1 / 16, "T": 0.5, "paths": 600, "chunk": 100, "engine": "numpy"}
# The first increment of path 450, which is in chunk 4: a scheme knows it by that.
MARK = float(wiener.increments(0, T=0.5, steps=8, noises=2, paths=range(450, 451))[0, 0, 0])
ELSEWHERE = multiprocessing.parent_process() is not None


def same(one: Any, other: Any) -> bool:
    return all(np.array_equal(getattr(one, key), getattr(other, key)) for key in AXES)


def step_that(problem, y, h, dW, does):
    """(2.1), which is slow, or on the marked path raises, or kills its worker."""
    time.sleep(0.01 * (does == "is slow"))
    if np.any(dW[0] == MARK):
        if does == "raises" or (does == "raises elsewhere" and ELSEWHERE):
            raise RuntimeError("never on this path")
        if does == "kills" and ELSEWHERE:
            os.kill(os.getpid(), signal.SIGKILL)
    return EP.step(problem, y, h, dW)


def scheme(does: str) -> sepv.Scheme:
    return sepv.Scheme(does, partial(step_that, does=does), batched=True)


def local(workers: int) -> Any:
    where = {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0", "silence_logs": 50}
    return distributed.LocalCluster(n_workers=workers, threads_per_worker=1, **where)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    with local(2) as found:
        yield found


@pytest.fixture(scope="module")
def client(cluster: Any) -> Iterator[Any]:
    with distributed.Client(cluster, set_as_default=False, timeout=20) as found:
        yield found


def test_the_bits_are_those_of_one_process(client: Any, cluster: Any) -> None:
    arguments: dict[str, Any] = {"h": 1 / 64, "T": 1.0, "paths": 3000, "times": [0.5, 1.0], "seed": 7}
    here = sepv.ensemble(EP, PENDULUM, **arguments)
    assert here.engine == "compiled"
    for workers in (2, client, cluster.scheduler_address, cluster, client.get_executor()):
        there = sepv.ensemble(EP, PENDULUM, workers=workers, chunk=500, **arguments)
        assert same(here, there)
        assert there.repeated == 0
        assert there.gradient_evaluations == here.gradient_evaluations


@pytest.mark.skipif(
    devices.compiler() is None, reason="no C compiler: the text of a card's kernel cannot run"
)
def test_workers_run_the_kernels_of_a_card(client: Any) -> None:
    """The text of a card's kernel, compiled for the host, gives the same bits on workers, ends and
    functionals.
    """
    run = partial(
        sepv.ensemble,
        "energy-preserving",
        "pendulum",
        h=1 / 8,
        T=1.0,
        paths=100,
        chunk=16,
        engine="cuda-on-host",
    )
    here, there = run(), run(workers=client)
    assert (there.engine, there.repeated, same(here, there)) == ("cuda-on-host", 0, True)
    sums = [run(workers=w, reduce={"q": lambda ends: ends.y[1]}).reduced["q"] for w in (1, client)]
    assert sums[0].mean == sums[1].mean == pytest.approx(here.y[1].mean(), rel=1e-14)


def test_a_worker_killed_in_mid_run_changes_no_bit(client: Any) -> None:
    slow, arguments = scheme("is slow"), SMALL | {"paths": 1200}
    here = sepv.ensemble(slow, PENDULUM, **arguments)
    victim = next(iter(client.run(os.getpid).values()))

    def kill(done: int, _all: int) -> None:
        if done == 300:
            os.kill(victim, signal.SIGKILL)

    there = sepv.ensemble(slow, PENDULUM, workers=client, progress=kill, **arguments)
    assert victim not in client.run(os.getpid).values()
    assert same(here, there)


def test_a_chunk_that_raises_on_every_worker_is_computed_here(client: Any) -> None:
    there = sepv.ensemble(scheme("raises elsewhere"), PENDULUM, workers=client, **SMALL)
    assert there.repeated == 1
    assert same(there, sepv.ensemble(EP, PENDULUM, **SMALL))


def test_a_chunk_that_raises_here_too_is_said_and_the_others_are_kept(client: Any) -> None:
    with pytest.raises(sepv.ChunkFailure, match="RuntimeError: never on this path") as failure:
        sepv.ensemble(scheme("raises"), PENDULUM, workers=client, **SMALL)
    kept, whole = failure.value, sepv.ensemble(EP, PENDULUM, **SMALL)
    assert 0 < len(kept.paths) <= 500
    assert 450 not in kept.paths
    assert np.array_equal(kept.ensemble.y, whole.y[:, kept.paths])


def test_a_chunk_that_kills_its_workers_does_not_come_here(client, cluster, monkeypatch):
    monkeypatch.setattr(cluster.scheduler, "allowed_failures", 0)
    with pytest.raises(sepv.ChunkFailure, match=r"on 1 workers, and each of them died") as failure:
        sepv.ensemble(scheme("kills"), PENDULUM, workers=client, **SMALL)
    assert isinstance(failure.value.__cause__, sepv.ClusterFailure)
    client.wait_for_workers(2, timeout=30)


def hide_numba() -> None:
    sys.modules["numba"] = None


def test_a_worker_without_numba_is_named(client: Any, cluster: Any) -> None:
    before = set(client.nthreads())
    cluster.scale(3)
    client.wait_for_workers(3, timeout=30)
    (new,) = set(client.nthreads()) - before
    client.run(hide_numba, workers=[new])
    try:
        words = r"not like this process: numba none and not [\d.]+ on "
        with pytest.raises(sepv.ChunkFailure, match=words) as failure:
            sepv.ensemble(EP, PENDULUM, h=1 / 64, T=1.0, paths=6400, chunk=128, workers=client)
        assert "pip install numba" in str(failure.value)
        # The plain engine needs none, and the worker takes part.
        assert same(*(sepv.ensemble(EP, PENDULUM, workers=w, **SMALL) for w in (client, 1)))
    finally:
        client.retire_workers([new])
        cluster.scale(2)


def test_ctrl_c_keeps_what_was_done(client: Any) -> None:
    def interrupt(done: int, _all: int) -> None:
        if done >= 300:
            raise KeyboardInterrupt

    whole = sepv.ensemble(EP, PENDULUM, **SMALL)
    for workers in (1, 2, client):
        with pytest.raises(Interrupted, match="300 paths are finished") as kept:
            sepv.ensemble(EP, PENDULUM, workers=workers, progress=interrupt, **SMALL)
        assert np.array_equal(kept.value.ensemble.y, whole.y[:, kept.value.paths])


INTERRUPTED = """
import os, signal, sys, sepv
# A shell that starts jobs in the background has them ignore SIGINT.
signal.signal(signal.SIGINT, signal.default_int_handler)
def interrupt(done, paths):
    os.kill(os.getpid(), signal.SIGINT)
try:
    sepv.ensemble("energy-preserving", "pendulum", h=2.0**-9, steps=int(sys.argv[2]), paths=10**6, chunk=128,
                  workers=2, engine=sys.argv[1], progress=interrupt)
except sepv.Interrupted as kept:
    print(len(kept.paths))
"""


@pytest.mark.parametrize("engine", ["compiled", "numpy"])
def test_a_real_ctrl_c_ends_threads_and_processes(engine: str) -> None:
    """Hours of work: what ends before the limit was ended."""
    few = [sys.executable, "-c", INTERRUPTED, engine, str(2**14 if engine == "compiled" else 64)]
    done = subprocess.run(few, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert int(done.stdout) % 128 == 0


def test_results_never_pile_up_behind_a_slow_chunk() -> None:
    """Four tasks a worker beyond the first that is unfinished, and no more until it is."""
    others, begun = threading.Semaphore(0), []

    def task(number: int) -> int:
        begun.append(number)
        if number == 0:
            for _ in range(2 * TASKS_PER_WORKER - 1):
                assert others.acquire(timeout=20)
            time.sleep(0.2)  # any more would begin now
            assert max(begun) == 2 * TASKS_PER_WORKER - 1
        else:
            others.release()
        return number

    got: list[int] = []
    with ThreadPoolExecutor(2) as pool:
        assert run_all(task, range(40), pool, threads=True, receive=lambda n, r: got.append(r)) == 0
    assert sorted(got) == list(range(40))
    assert got.index(0) == 2 * TASKS_PER_WORKER - 1


def test_nobody_at_an_address_is_said(monkeypatch: Any) -> None:
    monkeypatch.setattr(on_dask, "CONNECT_SECONDS", 1.0)
    with pytest.raises(sepv.UsageError, match=r"the address of a Dask scheduler"):
        sepv.ensemble(EP, PENDULUM, workers="tcp://127.0.0.1:9", **SMALL)


def test_a_cluster_without_workers_is_not_waited_for_without_end(monkeypatch: Any) -> None:
    monkeypatch.setattr(on_dask, "NO_WORKER", 0.5)
    monkeypatch.setattr(on_dask, "LOOK_SECONDS", 0.1)
    with local(0) as empty, pytest.raises(sepv.ChunkFailure, match=r"has had no worker for 0\.5 s"):
        sepv.ensemble(EP, PENDULUM, workers=empty, **SMALL)


@pytest.mark.parametrize("how", ["gone", "another at its address", "frozen"])
def test_a_scheduler_that_is_gone_leaves_what_was_finished(
    tmp_path: Path, how: str, monkeypatch: Any
) -> None:
    """Scheduler and worker are processes of their own; the scheduler is killed, or stopped,
    after three chunks.

    One that takes its place at the same address knows nothing of the run, though the client
    connects to it.
    """
    monkeypatch.setattr(on_dask, "CONNECT_SECONDS", 10.0 if how != "frozen" else 5.0)
    file = tmp_path / "scheduler.json"
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    path = os.environ | {"DASK_LOGGING__DISTRIBUTED": "critical", "PYTHONPATH": str(Path(__file__).parent)}
    common = ["--scheduler-file", str(file), "--no-dashboard", "--dashboard-address", "127.0.0.1:0"]
    dask = [sys.executable, "-m", "dask"]
    begin = [*dask, "scheduler", "--host", "127.0.0.1", "--port", port, *common]
    worker = [*dask, "worker", "--host", "127.0.0.1", "--nthreads", "1", "--no-nanny", *common]
    processes = [subprocess.Popen(words, env=path) for words in (begin, worker)]

    def at_half(done: int, _: int) -> None:
        if done == 300:
            if how == "frozen":
                processes[0].send_signal(signal.SIGSTOP)
                return
            processes[0].kill()
            processes[0].wait(10)
            if how == "another at its address":
                processes.append(subprocess.Popen(begin, env=path))

    try:
        limit = time.monotonic() + 30
        while not file.exists() and time.monotonic() < limit:
            time.sleep(0.1)
        words = rf"The scheduler at tcp://127\.0\.0\.1:{port} is gone"
        with distributed.Client(scheduler_file=str(file), set_as_default=False, timeout=20) as client:
            with pytest.raises(sepv.ChunkFailure, match=words) as failure:
                sepv.ensemble(scheme("is slow"), PENDULUM, workers=client, progress=at_half, **SMALL)
            # `sepv reproduce` asks last of all, and waited for the answer without end.
            assert count(client) == 0 or how == "another at its address"
        kept, whole = failure.value, sepv.ensemble(EP, PENDULUM, **SMALL)
        assert 300 <= len(kept.paths) < 600
        assert np.array_equal(kept.ensemble.y, whole.y[:, kept.paths])
    finally:
        for process in processes:
            process.kill()
            process.wait(10)


def test_frozen_processes_of_this_machine_hold_no_interruption_up() -> None:
    """SIGTERM does not end a stopped process, and the pool waited for it."""
    from doors import ended  # a cluster's workers import this file, and not the folder's others

    others, stopped = set(multiprocessing.active_children()), []

    def receive(_number: int, _result: None) -> None:
        stopped.extend(child.pid for child in set(multiprocessing.active_children()) - others)
        for pid in stopped:
            os.kill(pid, signal.SIGSTOP)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_all(time.sleep, [0.01, 300, 300], 2, threads=False, receive=receive)
    assert len(stopped) == 2
    assert ended(stopped)


def test_a_scheduler_with_tls_needs_certificates() -> None:
    """It was a ChunkFailure, as if a cluster had been lost."""
    with pytest.raises(sepv.UsageError, match=r"tls://127\.0\.0\.1:1, and none in the configuration of Dask"):
        sepv.ensemble(EP, PENDULUM, workers="tls://127.0.0.1:1", **SMALL)


def test_the_chunks_of_a_frozen_worker_go_to_the_other(monkeypatch: Any) -> None:
    """Dask itself waits for it, and the other worker was idle without end."""
    monkeypatch.setattr(on_dask, "SILENT_SECONDS", 3.0)
    slow, arguments = scheme("is slow"), SMALL | {"paths": 1200}
    here = sepv.ensemble(EP, PENDULUM, **arguments)
    with local(2) as found, distributed.Client(found, set_as_default=False, timeout=20) as client:
        victim = next(iter(client.run(os.getpid).values()))

        def freeze(done: int, _all: int) -> None:
            if done == 300:
                os.kill(victim, signal.SIGSTOP)

        try:
            there = sepv.ensemble(slow, PENDULUM, workers=client, progress=freeze, **arguments)
        finally:
            os.kill(victim, signal.SIGKILL)
    assert same(here, there)
    assert there.repeated == 0


def test_two_frozen_workers_end_a_run_that_keeps_what_was_finished(monkeypatch: Any) -> None:
    for name, seconds in (("SILENT_SECONDS", 5.0), ("FROZEN_SECONDS", 10.0)):
        monkeypatch.setattr(on_dask, name, seconds)
    with local(2) as found, distributed.Client(found, set_as_default=False, timeout=20) as client:
        victims = list(client.run(os.getpid).values())

        def freeze(done: int, _all: int) -> None:
            if done >= 300:
                for victim in victims:
                    os.kill(victim, signal.SIGSTOP)

        try:
            with pytest.raises(sepv.ChunkFailure, match="no sign of life from tcp") as failure:
                sepv.ensemble(
                    scheme("is slow"), PENDULUM, workers=client, progress=freeze, **SMALL | {"paths": 1200}
                )
        finally:
            for victim in victims:
                os.kill(victim, signal.SIGKILL)
    assert len(failure.value.paths) >= 300


LAWS = ("identity", "energy")
LITTLE = sepv.Effort(examples=5, paths=64)


def test_verify_measures_laws_on_the_cluster(client: Any) -> None:
    here, there = (sepv.verify(EP, laws=LAWS, effort=LITTLE, workers=w) for w in (None, client))
    seen = [[(f.law, f.verdict, f.defect, f.witness) for f in found.findings] for found in (here, there)]
    assert seen[0] == seen[1]
    assert not there.interrupted


def test_laws_that_a_lost_cluster_did_not_decide_are_not_measured(monkeypatch: Any) -> None:
    monkeypatch.setattr(on_dask, "NO_WORKER", 0.5)
    monkeypatch.setattr(on_dask, "LOOK_SECONDS", 0.1)
    with local(0) as empty:
        report = sepv.verify(EP, laws=LAWS, effort=LITTLE, workers=empty)
    assert report.interrupted
    assert all("has had no worker" in f.message for f in report.findings)
    assert report.counts["not_measured"] == len(LAWS)
    assert report.exit_code == 3
    assert "has had no worker" in report.lost


def test_errors_of_a_comparison_are_those_of_one_process(client: Any) -> None:
    from sepv.studies._compare.method import from_scheme
    from sepv.studies._compare.run import compare

    def table(workers: Any) -> Any:
        methods = [from_scheme(s, PENDULUM) for s in (EP, schemes.midpoint)]
        found = compare(methods, PENDULUM, steps=(4,), paths=32, repeats=1, workers=workers)
        return [(p.method, p.steps, p.strong, p.weak, p.energy_defect) for p in found.points]

    assert table(1) == table(client)


def test_a_figure_is_the_same_from_the_cluster(client: Any) -> None:
    from sepv.paper.record import Size
    from sepv.paper.suite import reproduce

    size = Size(share=0.001, engine="numpy")  # compiled, each process would compile for ten seconds
    here, there = (reproduce(["4.1"], size=size, workers=w) for w in (1, client))
    assert there.workers == 2
    assert [vars(s) for s in here.statements] == [vars(s) for s in there.statements]
