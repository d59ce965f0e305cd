"""What a terminal says that marks damaged characters: termios(3), PARMRK. See docs/adr/0013-damaged-characters.md."""

import re
from typing import Final

from gateway.ports.port import Received

_FF: Final = b"\xff"
#: FF FF is one FF. FF, NUL and a character are one that came with a parity error, a framing error or in a break.
_MARK: Final = re.compile(rb"(\xff\xff)|((?:\xff\x00.)+)", re.DOTALL)
_BEGUN: Final = (_FF, b"\xff\x00")


class MarkedInput:
    """Takes the marks out and hands the rest to `received`.

    Damaged characters that follow each other are handed over together: some drivers mark all that came in one USB
    packet when one of them is damaged.
    """

    def __init__(self, received: Received) -> None:
        self._received = received
        self._begun = b""

    def received(self, marked: bytes) -> None:
        """Take what was read."""
        if self._begun or _FF in marked:
            self._take_apart(self._begun + marked)
        else:
            self._received(marked)

    def _take_apart(self, marked: bytes) -> None:
        self._begun = b""
        data, at = b"", 0
        for mark in _MARK.finditer(marked):
            data += marked[at : mark.start()]
            at = mark.end()
            if mark[1]:
                data += _FF
                continue
            self._hand_over(data)
            self._received(mark[2][2::3], damaged=True)
            data = b""
        data += marked[at:]
        self._begun = next((begun for begun in _BEGUN if marked.endswith(begun, at)), b"")
        self._hand_over(data.removesuffix(self._begun))

    def _hand_over(self, data: bytes) -> None:
        if data:
            self._received(data)
