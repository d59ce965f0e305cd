"""Adapters that return what they send: on two-wire lines the receiver hears the sender."""

from typing import Final

#: So much of what comes before an echo is kept.
_KEPT: Final = 1024


class Echo:
    """Strips what was sent from what is received, exactly that and once.

    As long as the echo is not complete nothing is let through, so that the echo of a write is never its own
    confirmation; without an echo the request times out. What comes before the echo is dropped with it: `before`.
    """

    def __init__(self) -> None:
        self.before = b""
        self._sent = b""
        self._heard = b""

    def expect(self, sent: bytes) -> None:
        """`sent` goes out now; what came before is forgotten."""
        self._sent = sent
        self.before = self._heard = b""

    def strip(self, data: bytes) -> bytes:
        """What of `data` came behind the echo."""
        if not self._sent:
            return data
        self._heard = self._heard[-_KEPT:] + data
        self.before, echo, behind = self._heard.partition(self._sent)
        if not echo:
            return b""
        self._sent = self._heard = b""
        return behind
