"""A program as a child process: what each kind of silence, end and noise means, in words."""

from __future__ import annotations

import shlex

from sepv.children import Child, NoLine
from sepv.external import _errors as errors
from sepv.external._errors import shown

# The largest answer in bytes, twice that of 1000 steps in 20 dimensions. A child that prints more
# is ended.
LINE_LIMIT = 1 << 20
# Seconds between "stop" and SIGKILL, enough for a program to write a log.
STOP_GRACE = 2.0


class ProgramChild(Child):
    """A `Child` whose faults are errors of the protocol. `count` is the number of messages sent."""

    def __init__(self, argv: list[str], limit: int) -> None:
        self.count = 0
        try:
            super().__init__(argv, limit=limit, log=True)
        except (OSError, ValueError) as error:
            raise errors.StartFailure(
                expected=f"a program that can be started: {shlex.join(argv)}",
                received=f"{type(error).__name__}: {error}",
                remedy="give its path (./program), make it executable, and start it once by hand",
            ) from error

    def exchange(self, message: bytes, seconds: float) -> bytes:
        """Send `message` and return the line that answers it, both within `seconds`."""
        try:
            return super().exchange(message, seconds)
        except NoLine as silence:
            if silence.why == "gone":
                raise self._ended() from None
            raise self._too_long() if silence.why == "long" else self._late(seconds) from None

    def _too_long(self) -> errors.ProgramError:
        return self.fault(
            errors.LineTooLong,
            f"a line of at most {self.limit} bytes",
            f"{len(self.received)} bytes and more: {shown(bytes(self.received[:60]))}…",
            "one answer a line, nothing else on stdout; give hello a smaller max_steps",
        )

    def _ended(self) -> errors.ProgramError:
        status = self.status(0.5)
        return self.fault(
            errors.ProgramExit,
            "a program that runs until it is told to stop",
            f"the end of the program with {status}" if status else f"a running program that {self.gone}",
            "answer every line of stdin, an unknown one with error; end at stop or at the end of stdin only",
        )

    def _late(self, seconds: float) -> errors.ProgramError:
        unread = len(self.unsent) + _unread(self.stdin)
        if self.status(0):
            return self._ended()
        if unread:
            return self.fault(
                errors.NeverReads,
                f"a program that reads its stdin within {seconds:g} s",
                f"a message of which {unread} bytes were not read",
                "read stdin line by line, to the end of each line, in a loop",
            )
        part = f"{len(self.received)} bytes without a line end" if self.received else "nothing"
        return self.fault(
            errors.CallTimeout,
            f"a line of answer within {seconds:g} s",
            f"{part}, from a program that read the whole message",
            "end the answer with a newline and flush stdout; a slow program takes fewer steps a message "
            "(max_steps) or is given more time",
        )

    def fault(
        self, kind: type[errors.ProgramError], expected: str, received: str, remedy: str
    ) -> errors.ProgramError:
        """Return an error of class `kind` with these words and the end of the program's stderr."""
        if self.stderr in self.selector.get_map():
            self.drain()
        log = "\n".join(shown(line) for line in bytes(self.log).splitlines())
        return kind(expected=expected, received=received, remedy=remedy, log=log)


def _unread(fd: int) -> int:
    """Return the number of bytes in a pipe that the child has not read,
    or 0 if the system does not tell.
    """
    import fcntl
    import termios

    try:
        return int.from_bytes(fcntl.ioctl(fd, termios.FIONREAD, bytes(4)), "little")
    except OSError:
        return 0
