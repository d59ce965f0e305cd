"""The meaning of SIGHUP: the terminal was closed, or the config must be read again."""

import os
import signal
import sys


class HangUp:
    """The terminal of this process as found at its start: once it is closed, nothing shows that there was one."""

    def __init__(self) -> None:
        outlives = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN  # nohup
        self._logs_to_terminal = not outlives and sys.stderr is not None and sys.stderr.isatty()
        self._had_terminal = not outlives and _has_terminal()

    @property
    def is_end(self) -> bool:
        """Whether a SIGHUP now ends the gateway: it logs to a terminal, or its terminal is gone."""
        return self._logs_to_terminal or (self._had_terminal and not _has_terminal())


def _has_terminal() -> bool:
    """Tell whether a terminal controls this process; closing it sends SIGHUP."""
    try:
        os.close(os.open("/dev/tty", os.O_RDONLY | os.O_NOCTTY))
    except OSError:
        return False
    return True
