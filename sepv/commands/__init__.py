"""The commands of ``sepv``, one a file; `_cli` loads the one that is called, `_shared` has what several use.

`main` is the program: it runs `_cli.main` in a process of its own and watches it (`_watch`).
"""

from __future__ import annotations

import atexit
import signal
import sys


def main() -> None:
    """Run ``sepv`` with the arguments of this process; ends in SystemExit."""
    # Ctrl-C waits until a process can answer it.
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        # Nothing answers it while Python shuts down: all output is written by then.
        atexit.register(signal.pthread_sigmask, signal.SIG_BLOCK, [signal.SIGINT])
    from sepv.commands._watch import watched

    def work() -> None:
        from sepv.commands._cli import main as run  # under watch from its imports on

        run()

    try:
        sys.exit(watched(work))
    except KeyboardInterrupt:
        print("sepv: interrupted", file=sys.stderr)
        sys.exit(130)
