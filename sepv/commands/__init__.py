"""The commands of ``sepv``, one in each file. `_cli` loads the command that is called;
`_shared` has common parts.

`main` is the program: it runs `_cli.main` in a child process and watches this process (`_watch`).
"""

from __future__ import annotations

import atexit
import os
import signal
import sys
from contextlib import suppress

from sepv._lazy import lazily

__getattr__, __dir__ = lazily(__name__, {"_shared": "*shared"})


def main() -> None:
    """Run ``sepv`` with the arguments of this process; ends in SystemExit."""
    # Ctrl-C is held back until a process can answer it.
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        # Nothing answers Ctrl-C while Python shuts down, so it is held back; all output is written
        # by then.
        atexit.register(signal.pthread_sigmask, signal.SIG_BLOCK, [signal.SIGINT])
    from sepv.children import command_started
    from sepv.commands._watch import EXIT_DEFECT, defect, watched

    def work() -> None:
        from sepv.commands._cli import main as run  # imported by the child, so that imports are watched

        command_started()
        run()

    try:
        _require_streams()
        code = watched(work)
    except KeyboardInterrupt:
        print("sepv: interrupted", file=sys.stderr)
        code = 130
    except (OSError, MemoryError) as error:  # no process, descriptor or memory for the watch itself
        with suppress(OSError):
            os.write(2, f"{defect(error)}\n".encode(errors="replace"))
        code = EXIT_DEFECT
    sys.exit(code)


def _require_streams() -> None:
    """Raise an OSError if stdout or stderr is closed, because nobody reads the verdict.
    A closed stdin is empty.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            if number == 0:
                os.open(os.devnull, os.O_RDONLY)  # the lowest free number is 0
                continue
            os.dup2(os.open(os.devnull, os.O_WRONLY) if number == 1 else 1, number)
            raise OSError(f"{name} is closed") from None
