"""`run` on a terminal that is closed: it ends, unless it was started to outlive the terminal."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from kit.process import COMMAND, PATIENCE

CONFIG = '[[listen]]\nbind = "tcp://127.0.0.1:0"\n[[image]]\nunit = 1\nholding = 1\n'
#: Makes its standard input the terminal of a new session, as a terminal program does, and becomes a shell there.
ON_TERMINAL = [sys.executable, "-c", "import os, sys; os.login_tty(0); os.execvp('sh', ['sh', '-c', *sys.argv[1:]])"]
#: What a shell does with the words behind it.
IN_FRONT, LOG_IN_FILE, NOHUP = 'exec "$@"', 'exec "$@" 2>"$LOG"', 'exec nohup "$@" >"$LOG" 2>&1'

Gateway = subprocess.Popen[bytes]


class Terminal:
    """A terminal on which the gateway runs, and its log: a file, or the terminal itself."""

    def __init__(self, folder: Path, shell: str) -> None:
        (folder / "gateway.toml").write_text(CONFIG)
        own = {"STATE_DIRECTORY": str(folder), "RUNTIME_DIRECTORY": str(folder), "LOG": str(folder / "log")}
        self._ours, theirs = os.openpty()
        os.set_blocking(self._ours, False)
        words = [*ON_TERMINAL, shell, "sh", *COMMAND, "run", str(folder / "gateway.toml")]
        self.gateway = subprocess.Popen(words, stdin=theirs, stdout=theirs, stderr=theirs, env={**os.environ, **own})
        os.close(theirs)
        self._log = folder / "log"
        self._seen = b""

    def close(self) -> None:
        os.close(self._ours)

    def wait_for(self, word: str) -> None:
        """Wait until the log has this word."""
        deadline = time.monotonic() + PATIENCE
        while word.encode() not in self._said():
            assert time.monotonic() < deadline, self._said()
            time.sleep(0.01)

    def _said(self) -> bytes:
        if self._log.exists():
            return self._log.read_bytes()
        with suppress(BlockingIOError):
            self._seen += os.read(self._ours, 65536)
        return self._seen


@contextmanager
def terminal(folder: Path, shell: str) -> Iterator[Terminal]:
    it = Terminal(folder, shell)
    try:
        it.wait_for("ready")
        yield it
    finally:
        it.gateway.kill()
        it.gateway.wait()


@pytest.mark.parametrize("shell", [IN_FRONT, LOG_IN_FILE])
def test_closing_the_terminal_ends_it(tmp_path: Path, shell: str) -> None:
    with terminal(tmp_path, shell) as it:
        it.close()
        assert it.gateway.wait(PATIENCE) == 0


def test_with_nohup_it_goes_on(tmp_path: Path) -> None:
    with terminal(tmp_path, NOHUP) as it:
        it.close()
        it.wait_for("config_applied")
        it.gateway.terminate()
        assert it.gateway.wait(PATIENCE) == 0


def test_a_hang_up_from_elsewhere_is_a_reload_while_the_terminal_is_there(tmp_path: Path) -> None:
    with terminal(tmp_path, LOG_IN_FILE) as it:
        it.gateway.send_signal(signal.SIGHUP)
        it.wait_for("config_applied")
        it.close()
        assert it.gateway.wait(PATIENCE) == 0
