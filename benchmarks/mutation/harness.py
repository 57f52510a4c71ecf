"""One warm interpreter with every test collected; for each mutant a fork of it.

pytest collects once. A first fork runs every test and traces which lines of the modules under test it executes, and its
processor time. Then each mutant has a fork of its own, where the code of the changed function is put into
the function objects that exist, caches being empty, and those tests run that execute the changed statement,
the likeliest killer for its price first, until one fails.
"""

from __future__ import annotations

import functools
import gc
import itertools
import os
import pickle
import resource
import signal
import sys
import time
import types
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import pytest

from benchmarks.mutation.mutants import Mutant, path_of

# A test that takes so many times its usual processor time, and a little more, does not end.
PATIENCE, GRACE = 10.0, 2.0
MEMORY = 4 << 30
# The tests asked about a mutant take no more than this together, in traced processor seconds.
BUDGET = 5.0


@dataclass(frozen=True)
class Outcome:
    """`by`: the test that killed the mutant or did not end; `seconds` of processor time; `tests` that were run."""

    mutant: Mutant
    status: str  # "killed", "survived", "time-out"
    by: str = ""
    seconds: float = 0.0
    tests: int = 0


@dataclass
class Known:
    """A test and what the first run showed: its processor time and the lines it executes, file by file."""

    item: pytest.Item
    seconds: float
    lines: dict[str, set[int]]


class Harness:
    """A pytest plugin whose run loop is `work`."""

    def __init__(self, modules: Iterable[str], work: Callable[[Harness], None]) -> None:
        self.files = {str(path_of(module)): module for module in modules}
        self.work = work
        self.failures: list[str] = []
        self.known: list[Known] = []
        self.functions: dict[tuple[str, str], list[types.FunctionType]] = defaultdict(list)
        self.caches: list[Any] = []
        self.kills: dict[tuple[str, str], Counter[str]] = defaultdict(Counter)
        self.tries: dict[tuple[str, str], Counter[str]] = defaultdict(Counter)

    @pytest.hookimpl(tryfirst=True)
    def pytest_configure(self) -> None:
        from hypothesis import HealthCheck, Phase, settings

        # One example that fails is enough: nothing is shrunk, nothing explained.
        settings.register_profile(
            "mutation",
            derandomize=True, deadline=None, database=None, max_examples=25,
            phases=(Phase.explicit, Phase.generate), suppress_health_check=[HealthCheck.too_slow],
        )  # fmt: skip

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        if session.testsfailed:
            raise pytest.UsageError("the tests could not be collected")
        self._look_around()
        self._first_run(session.items)
        self.work(self)
        return True

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self.failures.append(f"{report.nodeid}\n{report.longreprtext}")

    def _look_around(self) -> None:
        """The function objects of the modules under test, and every cache of a function of ours, emptied."""
        gc.collect()
        for found in gc.get_objects():
            if isinstance(found, types.FunctionType) and found.__code__.co_filename in self.files:
                self.functions[found.__code__.co_filename, found.__code__.co_qualname].append(found)
            elif isinstance(found, functools._lru_cache_wrapper) and found.__module__.startswith("sepv"):
                self.caches.append(found)
        cached = {
            cls: [name for name, value in vars(cls).items() if isinstance(value, functools.cached_property)]
            for cls in {type(found) for found in gc.get_objects()}
            if str(getattr(cls, "__module__", "")).startswith("sepv")
        }
        for found in gc.get_objects():
            for name in cached.get(type(found), ()):
                vars(found).pop(name, None)
        self._forget()

    def _forget(self) -> None:
        for cache in self.caches:
            cache.cache_clear()

    def _first_run(self, items: list[pytest.Item]) -> None:
        def run() -> list[tuple[float, dict[str, set[int]]]]:
            rows = []
            for item in items:
                self._forget()
                lines: dict[str, set[int]] = defaultdict(set)
                start = time.process_time()
                sys.settrace(_tracer(self.files, lines))
                try:
                    self._run(item)
                finally:
                    sys.settrace(None)
                rows.append((time.process_time() - start, dict(lines)))
                if self.failures:
                    raise RuntimeError(f"fails without a mutant: {self.failures[0]}")
            return rows

        rows = _in_fork(run)
        self.known = [Known(item, *row) for item, row in zip(items, rows, strict=True)]
        gc.collect()
        gc.freeze()

    def _run(self, item: pytest.Item) -> None:
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=None)

    def tests(self, mutant: Mutant, files: tuple[str, ...]) -> list[Known]:
        """The tests of these files that execute the changed statement, by price over chance of killing."""
        path, at = str(path_of(mutant.module)), (mutant.module, mutant.function)
        kills, tries = self.kills[at], self.tries[at]

        def price(known: Known) -> float:
            name = known.item.nodeid
            return (known.seconds + 0.002) * (tries[name] + 1) / (kills[name] + 0.5)

        reached = [
            known
            for known in self.known
            if known.item.nodeid.startswith(files)
            and not known.lines.get(path, set()).isdisjoint(mutant.lines)
        ]
        reached.sort(key=price)
        spent = itertools.accumulate(known.seconds for known in reached)
        return [known for known, seconds in zip(reached, spent, strict=True) if seconds <= BUDGET]

    def outcomes(self, mutants: Iterable[tuple[Mutant, tuple[str, ...]]], jobs: int) -> Iterator[Outcome]:
        """The fate of each mutant, in the order in which they end."""
        waiting = iter(mutants)
        running: dict[int, tuple[Mutant, int]] = {}
        while True:
            for mutant, files in waiting:
                pid, pipe = self._start(mutant, self.tests(mutant, files))
                running[pid] = mutant, pipe
                if len(running) >= jobs:
                    break
            if not running:
                return
            pid, status, usage = os.wait4(-1, 0)
            mutant, pipe = running.pop(pid)
            with os.fdopen(pipe, "rb") as reader:
                ran = reader.read().decode().split("\n")[:-1]
            seconds = usage.ru_utime + usage.ru_stime
            at = (mutant.module, mutant.function)
            self.tries[at].update(ran)
            code = os.waitstatus_to_exitcode(status)
            if code == 0:
                yield Outcome(mutant, "survived", "", seconds, len(ran))
                continue
            self.kills[at].update(ran[-1:])
            late = code in (-signal.SIGPROF, -signal.SIGALRM)
            yield Outcome(mutant, "time-out" if late else "killed", ran[-1] if ran else "", seconds, len(ran))

    def _start(self, mutant: Mutant, tests: list[Known]) -> tuple[int, int]:
        reader, writer = os.pipe()
        pid = os.fork()
        if pid:
            os.close(writer)
            return pid, reader
        code = 3
        try:
            os.close(reader)
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
            signal.signal(signal.SIGPROF, signal.SIG_DFL)
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            self.apply(mutant)
            code = 0
            for known in tests:
                os.write(writer, (known.item.nodeid + "\n").encode())
                limit = PATIENCE * known.seconds + GRACE
                signal.setitimer(signal.ITIMER_PROF, limit)
                signal.setitimer(signal.ITIMER_REAL, 30 * limit)  # for what sleeps
                self._run(known.item)
                if self.failures:
                    code = 1
                    break
        finally:
            os._exit(code)

    def apply(self, mutant: Mutant) -> None:
        """Put the changed code into the functions that exist, closures that were made at import included."""
        path, module = str(path_of(mutant.module)), sys.modules[mutant.module]
        scope = dict(vars(module))
        source = "from __future__ import annotations\n" + mutant.source
        exec(compile(source, path, "exec", dont_inherit=True), scope)
        fresh = scope[mutant.function.rpartition(".")[2]]
        for function in self.functions[path, mutant.function]:
            function.__code__ = fresh.__code__
            function.__defaults__, function.__kwdefaults__ = fresh.__defaults__, fresh.__kwdefaults__
        for code in _inner(fresh.__code__):
            name = code.co_qualname.removeprefix(fresh.__code__.co_qualname)
            for function in self.functions.get((path, mutant.function + name), []):
                if function.__code__.co_freevars == code.co_freevars:
                    function.__code__ = code


def _inner(code: types.CodeType) -> Iterator[types.CodeType]:
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield constant
            yield from _inner(constant)


def _tracer(files: dict[str, str], lines: dict[str, set[int]]) -> Callable[..., Any]:
    def trace(frame: types.FrameType, event: str, argument: object) -> Any:
        name = frame.f_code.co_filename
        if name not in files:
            return None
        seen = lines[name]

        def local(frame: types.FrameType, event: str, argument: object) -> Any:
            seen.add(frame.f_lineno)
            return local

        seen.add(frame.f_lineno)
        return local

    return trace


def _in_fork(function: Callable[[], Any]) -> Any:
    """What a function returns, computed in a fork: no cache here is warmer for it."""
    reader, writer = os.pipe()
    pid = os.fork()
    if not pid:
        os.close(reader)
        try:
            answer = (True, function())
        except BaseException as error:
            answer = (False, str(error))
        with os.fdopen(writer, "wb") as stream:
            pickle.dump(answer, stream)
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader, "rb") as stream:
        fine, answer = pickle.load(stream)
    os.waitpid(pid, 0)
    if not fine:
        raise pytest.UsageError(answer)
    return answer
