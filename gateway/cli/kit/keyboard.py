"""Keys of a terminal, by name; and a terminal that is ours for some time, and is as before afterwards."""

import os
import re
import select
import signal
import socket
import sys
import termios
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from typing import Any, Final

from gateway.cli.kit.terminal import write_codes

#: The other screen, which has no scroll-back, without a cursor; long lines are cut. And back again.
_ENTER: Final = "\x1b[?1049h\x1b[?25l\x1b[?7l"
_LEAVE: Final = "\x1b[?7h\x1b[?25h\x1b[?1049l"

_KEY: Final = re.compile(r"\x1b[\[O][0-9;]*[A-Za-z~]|[\s\S]")
_NAMES: Final[Mapping[str, str]] = {
    **{f"\x1b{kind}{letter}": name for kind in "[O" for letter, name in zip("ABCDHF", (
        "up", "down", "right", "left", "home", "end"), strict=True)},
    "\x1b[1~": "home", "\x1b[7~": "home", "\x1b[4~": "end", "\x1b[8~": "end",
    "\x1b[5~": "page up", "\x1b[6~": "page down",
    "\r": "enter", "\n": "enter", "\x1b": "escape", "\x7f": "escape", "\b": "escape", " ": "page down",
}  # fmt: skip
#: The bytes of one key come within this time, in seconds, even over a slow line.
_ONE_KEY: Final = 0.05


def keys_in(text: str) -> list[str]:
    """Name the keys that a terminal has sent; those of no name are empty."""
    return [_NAMES.get(key, key if len(key) == 1 else "") for key in _KEY.findall(text)]


class Keyboard:
    """The keys, and what else ends the waiting for them: `wake`, and another size of the terminal."""

    def __init__(self) -> None:
        self._ear, self._mouth = socket.socketpair()
        self._mouth.setblocking(False)
        is_there = sys.stdin is not None and sys.stdin.isatty()
        self.keys: int | None = sys.stdin.fileno() if is_there else None

    def wake(self, *_: Any) -> None:
        """End the waiting, from any thread or signal handler."""
        with suppress(OSError):  # it is full, or closed: the waiting has ended
            self._mouth.send(b"\0")

    def wait(self) -> list[str]:
        """Wait until something happens, and return the keys that were pressed."""
        waited_for: list[Any] = [self._ear] if self.keys is None else [self._ear, self.keys]
        ready = select.select(waited_for, [], [])[0]
        if self._ear in ready:
            self._ear.recv(4096)
        return self._read() if self.keys in ready else []

    def _read(self) -> list[str]:
        assert self.keys is not None  # noqa: S101 - it was waited for
        data = os.read(self.keys, 4096)
        if not data:  # the terminal has gone
            return ["q"]
        if data.endswith((b"\x1b", b"\x1b[", b"\x1bO")) and select.select([self.keys], [], [], _ONE_KEY)[0]:
            data += os.read(self.keys, 4096)
        return keys_in(data.decode(errors="replace"))

    def close(self) -> None:
        """Close what only this has."""
        self._ear.close()
        self._mouth.close()


@contextmanager
def whole_screen() -> Iterator[Keyboard]:
    """Provide the keys of a terminal whose whole screen is drawn on; however the context ends, it is as before.

    Raises:
        SystemExit: the process is told to end.
    """
    with ExitStack() as stack:
        keyboard = Keyboard()
        stack.callback(keyboard.close)
        for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT):
            stack.callback(signal.signal, number, signal.signal(number, _end))
        stack.callback(signal.signal, signal.SIGWINCH, signal.signal(signal.SIGWINCH, keyboard.wake))
        stack.callback(_leave, keyboard, _set_keys(keyboard.keys))
        write_codes(sys.stdout, _ENTER)
        yield keyboard


def _end(number: int, _frame: object) -> None:
    sys.exit(128 + number)


def _set_keys(keys: int | None) -> list[Any] | None:
    """Have each key at once and not shown, and none that stops the process; return the settings before."""
    if keys is None:
        return None
    before = termios.tcgetattr(keys)
    now = termios.tcgetattr(keys)
    now[3] &= ~(termios.ICANON | termios.ECHO)
    now[6][termios.VSUSP] = b"\0"
    now[6][termios.VMIN], now[6][termios.VTIME] = 1, 0
    termios.tcsetattr(keys, termios.TCSADRAIN, now)
    return before


def _leave(keyboard: Keyboard, before: list[Any] | None) -> None:
    with suppress(OSError, termios.error):  # it has gone
        if keyboard.keys is not None and before is not None:
            termios.tcsetattr(keyboard.keys, termios.TCSAFLUSH, before)
        write_codes(sys.stdout, _LEAVE)
