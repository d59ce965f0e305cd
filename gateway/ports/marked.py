"""What a terminal says that marks damaged characters: termios(3), PARMRK. See docs/adr/0013-damaged-characters.md."""

import re
from typing import Final

from gateway.ports.port import Received

_FF: Final = b"\xff"
#: Twice FF is one FF; FF, NUL and a character are one that came with a parity error, a framing error, or in a break.
_MARK: Final = re.compile(rb"\xff(?:\xff|(\x00.))", re.DOTALL)
_BEGUN: Final = (_FF, b"\xff\x00")


class MarkedInput:
    """Takes the marks out and hands the rest to `received`; a NUL stands for each damaged character."""

    def __init__(self, received: Received) -> None:
        self._received = received
        self._begun = b""

    def received(self, marked: bytes) -> None:
        """Take what was read. What stands between two damaged characters of it counts as damaged too."""
        if self._begun or _FF in marked:
            self._take_apart(self._begun + marked)
        else:
            self._received(marked)

    def _take_apart(self, marked: bytes) -> None:
        data, damaged, at = bytearray(), [], 0
        for mark in _MARK.finditer(marked):
            data += marked[at : mark.start()]
            at = mark.end()
            if mark[1]:
                damaged.append(len(data))
            data += b"\0" if mark[1] else _FF
        data += marked[at:]
        self._begun = next((begun for begun in _BEGUN if marked.endswith(begun, at)), b"")
        self._hand_over(bytes(data.removesuffix(self._begun)), damaged)

    def _hand_over(self, data: bytes, damaged: list[int]) -> None:
        first, end = (damaged[0], damaged[-1] + 1) if damaged else (len(data), len(data))
        if first:
            self._received(data[:first])
        if damaged:
            self._received(data[first:end], damaged=True)
        if end < len(data):
            self._received(data[end:])
