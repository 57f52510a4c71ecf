"""A worker of `sepv.verification._side_by_side`: laws by name on stdin, findings on stdout, all pickled."""

from __future__ import annotations

import os
import pickle
import signal
import sys
import traceback
from typing import Any

from sepv.errors import UsageError


def main() -> None:
    """Answer until stdin ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # What the scheme prints goes to stderr: stdout is for findings.
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)

    def say(*word: Any) -> None:
        out.write(pickle.dumps(word))
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
    """Load the scheme once, then measure group after group."""
    from sepv.verification._law import Run
    from sepv.verification._laws import load_laws
    from sepv.verification._verify import load_candidate, measure

    # The first half of the task says where modules are found, which the second, with the scheme, may need.
    path, folder, rest = pickle.load(sys.stdin.buffer)
    sys.path[:] = path
    os.chdir(folder)
    task = pickle.loads(rest)
    scheme = load_candidate(task.scheme, task.claims, task.problems)
    _end_children_first(scheme)
    run = Run(task.effort)
    while True:
        for law in load_laws(pickle.load(sys.stdin.buffer)):
            say("law", law.name, None)
            say("law", law.name, measure(law, scheme, run, task.timeout, task.failures.get(law.name)))


def _end_children_first(scheme: Any) -> None:
    """SIGTERM ends the program of another language before this process, at once and through every handler."""
    owner: Any = getattr(scheme.step, "__self__", None)

    def end(*_: Any) -> None:
        if hasattr(owner, "abandon"):
            owner.abandon()
        os._exit(143)

    signal.signal(signal.SIGTERM, end)


if __name__ == "__main__":
    main()
