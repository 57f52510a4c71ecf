"""The commands of ``sepv``, one in each file. `_cli` loads the command that is called; `_shared` has common parts.

`main` is the program: it runs `_cli.main` in a child process and watches this process (`_watch`).
"""

from __future__ import annotations

import atexit
import signal
import sys


def main() -> None:
    """Run ``sepv`` with the arguments of this process; ends in SystemExit."""
    # Ctrl-C is held back until a process can answer it.
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        # Nothing answers Ctrl-C while Python shuts down, so it is held back; all output is written by then.
        atexit.register(signal.pthread_sigmask, signal.SIG_BLOCK, [signal.SIGINT])
    from sepv.commands._watch import watched

    def work() -> None:
        from sepv.commands._cli import main as run  # imported by the child, so that imports are watched

        run()

    try:
        sys.exit(watched(work))
    except KeyboardInterrupt:
        print("sepv: interrupted", file=sys.stderr)
        sys.exit(130)
