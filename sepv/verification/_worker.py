"""A worker process of `sepv.verification._side_by_side`:
it reads laws from stdin and writes findings to stdout.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
import threading
import traceback
from collections.abc import Callable
from functools import partial
from queue import SimpleQueue
from typing import Any

from sepv.children import Journal, Notes, attempted, collect_seldom, open_journal, packed, unpacked
from sepv.errors import UsageError


def main() -> None:
    """Measure groups of laws until stdin ends. The process's argument is the number of an open file
    for its notes.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    collect_seldom()
    # Output of the scheme goes to stderr: stdout is for findings.
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)

    def say(*word: Any) -> None:
        out.write(packed(word))
        out.flush()

    try:
        answer(say)
    except EOFError:
        return
    except UsageError as error:
        say("usage", {"expected": error.expected, "received": error.received, "remedy": error.remedy})
    except Exception:
        say("defect", traceback.format_exc())


def answer(say: Any) -> None:
    """Load the scheme once, then measure the groups of laws from stdin;
    `say` sends a message to the parent.
    """
    from sepv._kept import save_all
    from sepv.law import Run
    from sepv.law.fresh import FreshQuestion, answers, words_of
    from sepv.properties import load_laws
    from sepv.verification._side_by_side import WORKER
    from sepv.verification._verify import load_candidate, measure, replay

    # The first part of the task is the module path, which may be needed to unpickle the second
    # part, with the scheme.
    path, folder, rest = _next()
    sys.path[:] = path
    os.chdir(folder)
    task = pickle.loads(rest)
    if isinstance(task, FreshQuestion):
        say("answers", answers(task, load_candidate, replay))
        return
    scheme = load_candidate(task.scheme, task.claims, task.problems, task.twin)
    groups: SimpleQueue[list[str]] = SimpleQueue()
    end, run = (
        partial(_end_with_children, scheme),
        Run(task.effort, **words_of(task.scheme, task.problems, WORKER)),
    )
    signal.signal(signal.SIGTERM, end)
    threading.Thread(target=_read, args=(groups, end), daemon=True).start()
    open_journal(Journal(lambda *_: None, Notes(int(sys.argv[1]))))
    while True:
        for law in load_laws(groups.get()):
            say("law", law.name, None)
            work = partial(measure, law, scheme, run, task.timeout, task.failures.get(law.name))
            say("law", law.name, attempted(law.name, work, kept=False))
        save_all()


def _next() -> Any:
    """The next message; EOFError at the end of stdin."""
    message = None
    while message is None:
        line = sys.stdin.buffer.readline()
        if not line.endswith(b"\n"):
            raise EOFError
        message = unpacked(line[:-1])
    return message


def _read(groups: SimpleQueue[list[str]], end: Callable[[], None]) -> None:
    """Read groups of laws from stdin. When stdin ends, the parent has ended,
    and this process ends too.
    """
    try:
        while True:
            groups.put(_next())
    except EOFError:
        end()


def _end_with_children(scheme: Any, *_: Any) -> None:
    """End the external programs of a scheme and its twin, then this process,
    at once and without exit handlers.
    """
    for each in (scheme, scheme.twin and scheme.twin.scheme):
        owner: Any = getattr(getattr(each, "step", None), "__self__", None)
        if hasattr(owner, "abandon"):
            owner.abandon()
    os._exit(143)


if __name__ == "__main__":
    main()
