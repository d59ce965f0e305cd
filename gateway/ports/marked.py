"""Input of a terminal that marks damaged characters: termios(3), PARMRK. See docs/adr/0013-damaged-characters.md."""

import re
from typing import Final

from gateway.ports.port import Received

_FF: Final = b"\xff"
#: FF FF is one FF. FF, NUL and a character mean a parity error, a framing error or a break.
_MARK: Final = re.compile(rb"(\xff\xff)|((?:\xff\x00.)+)", re.DOTALL)
_BEGUN: Final = (_FF, b"\xff\x00")


class MarkedInput:
    """Removes the marks and passes the bytes to `received`.

    Consecutive damaged characters are passed together: for one of them, some drivers mark a whole USB packet.
    """

    def __init__(self, received: Received) -> None:
        self._received = received
        self._begun = b""

    def received(self, marked: bytes) -> None:
        """Take bytes that were read."""
        if self._begun or _FF in marked:
            self._parse(self._begun + marked)
        else:
            self._received(marked)

    def _parse(self, marked: bytes) -> None:
        self._begun = b""
        data, at = b"", 0
        for mark in _MARK.finditer(marked):
            data += marked[at : mark.start()]
            at = mark.end()
            if mark[1]:
                data += _FF
                continue
            self._pass_on(data)
            self._received(mark[2][2::3], damaged=True)
            data = b""
        data += marked[at:]
        self._begun = next((begun for begun in _BEGUN if marked.endswith(begun, at)), b"")
        self._pass_on(data.removesuffix(self._begun))

    def _pass_on(self, data: bytes) -> None:
        if data:
            self._received(data)
