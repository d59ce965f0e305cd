"""A terminal for tests: a command runs in it, and what is on its screen can be read."""

import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Sequence
from typing import Self
from unicodedata import east_asian_width

from kit.process import PATIENCE

_CODE = re.compile(r"\x1b\[(\??)([0-9;]*)([A-Za-z])|([\s\S])")
#: What may come in the middle of a code.
_BEGUN = re.compile(r"\x1b(\[[?0-9;]*)?$")


class Screen:
    """The rows of a terminal that knows just the codes which the commands use; another one is an error."""

    def __init__(self, columns: int, rows: int) -> None:
        self.is_other = False
        self.has_cursor = True
        self.wraps = True
        self.resize(columns, rows)
        self._rest = ""

    def resize(self, columns: int, rows: int) -> None:
        self.columns, self.height = columns, rows
        self._clear()

    @property
    def rows(self) -> list[str]:
        """What is seen."""
        return ["".join(row).rstrip() for row in self._cells]

    @property
    def text(self) -> str:
        return "\n".join(self.rows)

    def colours(self, text: str) -> set[str]:
        """The colours in which this text is seen."""
        found = set()
        for cells, colours in zip(self._cells, self._colours, strict=True):
            at = "".join(cells).find(text)
            found |= set(colours[at : at + len(text)]) if at >= 0 else set()
        return found

    def feed(self, text: str) -> None:
        text = self._rest + text
        begun = _BEGUN.search(text)
        self._rest = text[begun.start() :] if begun else ""
        for private, numbers, code, character in _CODE.findall(text.removesuffix(self._rest) if begun else text):
            if character:
                self._write(character)
            else:
                self._obey(private + code, numbers)

    def _clear(self) -> None:
        self._cells = [[" "] * self.columns for _ in range(self.height)]
        self._colours = [[""] * self.columns for _ in range(self.height)]
        self._row = self._column = 0
        self._colour = ""

    def _obey(self, code: str, numbers: str) -> None:
        match code, numbers:
            case "H", _:
                self._row, self._column = (int(each) - 1 for each in numbers.split(";")) if numbers else (0, 0)
            case "K", "":
                self._cells[self._row][self._column :] = [" "] * (self.columns - self._column)
                self._colours[self._row][self._column :] = [""] * (self.columns - self._column)
            case "J", "2":
                self._clear()
            case "m", _:
                self._colour = "" if numbers == "0" else numbers
            case "?h" | "?l", "1049":
                self.is_other = code == "?h"
                self._clear()
            case "?h" | "?l", "25":
                self.has_cursor = code == "?h"
            case "?h" | "?l", "7":
                self.wraps = code == "?h"
            case _:
                raise AssertionError(f"a terminal has got {code} {numbers}")

    def _write(self, character: str) -> None:
        if character == "\r":
            self._column = 0
        elif character == "\n":
            self._row += 1
            if self._row == self.height:
                self._cells = [*self._cells[1:], [" "] * self.columns]
                self._colours = [*self._colours[1:], [""] * self.columns]
                self._row -= 1
        else:
            assert character.isprintable(), f"a terminal has got {character!r}"
            width = 2 if east_asian_width(character) in "WF" else 1
            if self._column + width > self.columns and self.wraps:
                self._write("\r")
                self._write("\n")
            self._column = min(self._column, self.columns - width)
            self._cells[self._row][self._column : self._column + width] = [character, ""][:width]
            self._colours[self._row][self._column : self._column + width] = [self._colour] * width
            self._column += width


class Terminal:
    """A command in a terminal of its own."""

    def __init__(self, command: Sequence[str], columns: int = 80, rows: int = 24, **environment: str) -> None:
        self.screen = Screen(columns, rows)
        self._ours, theirs = pty.openpty()
        self._resize(columns, rows)
        self.settings = termios.tcgetattr(theirs)
        variables = {key: value for key, value in os.environ.items() if key not in ("COLUMNS", "LINES", "NO_COLOR")}
        self.process = subprocess.Popen(
            [sys.executable, *command],
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            env=variables | {"TERM": "xterm"} | environment,
            start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),  # noqa: PLW1509 - it takes no lock
        )
        self._theirs = theirs

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()
        os.close(self._ours)
        os.close(self._theirs)

    def press(self, keys: str) -> None:
        os.write(self._ours, keys.encode())

    def resize(self, columns: int, rows: int) -> None:
        self.screen.resize(columns, rows)
        self._resize(columns, rows)

    def _resize(self, columns: int, rows: int) -> None:
        fcntl.ioctl(self._ours, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))

    def end(self, number: int = signal.SIGTERM) -> None:
        self.process.send_signal(number)

    @property
    def is_as_before(self) -> bool:
        """Whether the terminal is as the command found it."""
        is_shown = self.screen.has_cursor and self.screen.wraps and not self.screen.is_other
        return is_shown and termios.tcgetattr(self._theirs) == self.settings

    def wait_for(self, text: str) -> str:
        """Wait until this text is seen, and return all that is seen then."""
        end = time.monotonic() + PATIENCE
        while text not in self.screen.text:
            assert time.monotonic() < end, f"{text!r} is not there:\n{self.screen.text}"
            self._read(0.1)
        self._read(0.05)
        return self.screen.text

    def wait_for_end(self) -> int:
        """Wait until the command ends, and return its code."""
        end = time.monotonic() + PATIENCE
        while self.process.poll() is None:
            assert time.monotonic() < end, f"it does not end:\n{self.screen.text}"
            self._read(0.05)
        self._read(0.05)
        return self.process.returncode

    def _read(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while select.select([self._ours], [], [], max(0.0, end - time.monotonic()))[0]:
            self.screen.feed(os.read(self._ours, 65536).decode())
            if time.monotonic() > end:
                return
