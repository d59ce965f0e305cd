"""Detects the gateway's own responses that the adapter of a server line echoes: a write would be executed for ever."""

from typing import Final

from gateway.events import EchoHeard, Emit
from gateway.lines.echo import ECHOES
from gateway.modbus.frame import Frame

#: How much later than the port's latency an echo may arrive, in seconds. Hardly any client does nothing but repeat the
#: same write this soon.
_HELD_BACK: Final = 0.1
_ADVICE: Final = 'if the adapter echoes, set echo = true; if the client has no wire, wire = "direct"'


class OwnEcho:
    """Tells the echo of the last response from a client's request with the same content. Times in seconds.

    `echoes` says whether the adapter is known to echo. A `virtual` port does not echo, and its client may send the same
    at once.
    """

    __slots__ = (
        "_echoes", "_emit", "_has_told", "_in_a_row", "_is_repeatable", "_name", "_said", "_source", "_until",
        "is_virtual",
    )  # fmt: skip

    def __init__(self, name: str, source: str, emit: Emit, *, echoes: bool) -> None:
        """`name` and `source` are the line's, for the event that reports the first echo."""
        self.is_virtual = True
        self._name = name
        self._source = source
        self._emit = emit
        self._echoes = echoes
        self._said: Frame | None = None
        #: Whether a client can send it too, because it equals the request; until when it is an echo even then.
        self._is_repeatable = False
        self._until = 0.0
        self._in_a_row = 0
        self._has_told = False

    def note_response(self, response: Frame, until: float, *, is_repeatable: bool) -> None:
        """A response is sent on the line. No client can repeat it before `until`, and no adapter echoes it later."""
        self._said = response
        self._until = until
        self._is_repeatable = is_repeatable

    def is_echo(self, frame: Frame, heard_at: float) -> bool:
        """Whether `frame` is the echo of the last response. To be called for each frame received."""
        said, self._said = self._said, None
        if said is None or self._echoes:
            return frame == said
        late_by = heard_at - self._until
        if self.is_virtual or frame != said or (self._is_repeatable and late_by >= _HELD_BACK):
            self._in_a_row = 0
            return False
        self._in_a_row += 1 if self._is_repeatable else ECHOES
        if late_by >= 0 and self._in_a_row < ECHOES:
            return False
        if not self._has_told:
            self._has_told = True
            self._emit(EchoHeard(self._name, self._source, _ADVICE))
        return True
