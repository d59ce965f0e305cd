"""What SIGHUP means: the terminal was closed, or the config is to be read again."""

import os
import signal
import sys


class HangUp:
    """Made at the start: after a terminal was closed, nothing tells any more that there was one."""

    def __init__(self) -> None:
        outlives = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN  # nohup
        self._logs_to_terminal = not outlives and sys.stderr is not None and sys.stderr.isatty()
        self._had_terminal = not outlives and _has_terminal()

    @property
    def is_end(self) -> bool:
        """Whether a SIGHUP that came now ends the gateway: its log is on a terminal, or its terminal is gone."""
        return self._logs_to_terminal or (self._had_terminal and not _has_terminal())


def _has_terminal() -> bool:
    """Whether a terminal controls this process: when it is closed, SIGHUP is sent."""
    try:
        os.close(os.open("/dev/tty", os.O_RDONLY | os.O_NOCTTY))
    except OSError:
        return False
    return True
