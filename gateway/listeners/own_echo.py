"""Our own responses on a server line that its adapter returns: as requests, a write would be carried out for ever."""

from typing import Final

from gateway.events import EchoHeard, Emit
from gateway.lines.echo import ECHOES
from gateway.modbus.frame import Frame

#: So many seconds later than its latency allows an echo may come. Hardly a client does nothing but write the same, and
#: each time so soon again.
_HELD_BACK: Final = 0.1
_ADVICE: Final = 'if the adapter echoes, set echo = true; if the client has no wire, wire = "direct"'


class OwnEcho:
    """Tells the response that was said last from a client's request with the same content. Times in seconds.

    `echoes` says whether the adapter is known to return what we send. A `virtual` port returns nothing, and its client
    may say the same at once.
    """

    __slots__ = (
        "_echoes", "_emit", "_has_told", "_in_a_row", "_is_repeatable", "_name", "_said", "_source", "_until",
        "is_virtual",
    )  # fmt: skip

    def __init__(self, name: str, source: str, emit: Emit, *, echoes: bool) -> None:
        """`name` and `source` are the line's, for the event that says once that an echo was heard."""
        self.is_virtual = True
        self._name = name
        self._source = source
        self._emit = emit
        self._echoes = echoes
        self._said: Frame | None = None
        #: Whether a client can say it too, because it is a copy of the request; until when it is an echo even so.
        self._is_repeatable = False
        self._until = 0.0
        self._in_a_row = 0
        self._has_told = False

    def said(self, response: Frame, until: float, *, is_repeatable: bool) -> None:
        """This goes on the line. No client can repeat it before `until`, and no adapter should return it later."""
        self._said = response
        self._until = until
        self._is_repeatable = is_repeatable

    def is_echo(self, frame: Frame, heard_at: float) -> bool:
        """Whether `frame` is what was said last, returned by the adapter. To be asked of each frame that is heard."""
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
