"""Detects echoes of the gateway's own responses on a server line: an echoed write would be repeated forever."""

from typing import Final, Literal

from gateway.events import EchoHeard, Emit
from gateway.lines.echo import ECHOES
from gateway.modbus.frame import Frame

#: The kind of a received frame. `doubtful`: it may be a request or an echo. It is answered with an exception; if that
#: comes back too, it is an echo, for no client sends one.
Verdict = Literal["request", "echo", "doubtful"]
_ADVICE: Final = 'if the adapter echoes, set echo = true; if the client has no wire, wire = "direct"'


class OwnEcho:
    """Distinguishes the echo of the last response from a client's request with the same content. Times in seconds.

    The echo of a response that differs from its request proves that the adapter echoes, until one does not come back.
    """

    __slots__ = (
        "_echoes", "_emit", "_has_told", "_in_a_row", "_is_proven", "_is_repeatable", "_is_virtual", "_limit", "_name",
        "_said", "_source", "_until",
    )  # fmt: skip

    def __init__(self, name: str, source: str, emit: Emit, *, echoes: bool) -> None:
        """Make it for a line; `name` and `source` are for the event that reports the first echo.

        `echoes` is set if the adapter is known to echo.
        """
        self._name = name
        self._source = source
        self._emit = emit
        self._echoes = echoes
        #: Whether an echo has proved that the adapter echoes.
        self._is_proven = False
        #: Whether the event was emitted.
        self._has_told = False
        self.port_up(virtual=True)

    def port_up(self, *, virtual: bool) -> None:
        """Start anew with an open port. On a `virtual` one the client may repeat a response at once."""
        self._is_virtual = virtual
        #: Our last response, until the next frame is received.
        self._said: Frame | None = None
        #: Whether a client can send it too, because it equals the request.
        self._is_repeatable = False
        #: Before this time it is an echo even then.
        self._until = 0.0
        #: Number of responses in a row that came back.
        self._in_a_row = 0
        #: The number of them that makes the next one doubtful.
        self._limit = ECHOES

    def note_response(self, response: Frame, until: float, *, is_repeatable: bool) -> None:
        """Note a response being sent. No client can repeat it before `until`, unless the port is virtual."""
        self._said = response
        self._until = until
        self._is_repeatable = is_repeatable

    def judge(self, frame: Frame, heard_at: float, heard_since: float) -> Verdict:
        """Return the kind of `frame`, read at `heard_at` and received after `heard_since`. Call it for each frame."""
        said, self._said = self._said, None
        if said is None:
            return "request"
        if frame != said:
            self._note_none()
            return "request"
        if self._echoes:
            return "echo"
        self._is_proven |= not self._is_repeatable
        self._in_a_row += 1
        if self._is_proven or (not self._is_virtual and heard_at < self._until):
            self._tell()
            return "echo"
        may_be_early = not self._is_virtual and heard_since < self._until
        return "doubtful" if may_be_early or self._in_a_row >= self._limit else "request"

    def _note_none(self) -> None:
        """Note that the last response did not come back."""
        if not self._is_repeatable:
            self._is_proven = False
            if self._in_a_row >= self._limit:  # the client repeated itself: doubt it less often
                self._limit *= 2
        self._in_a_row = 0

    def _tell(self) -> None:
        if not self._has_told:
            self._has_told = True
            self._emit(EchoHeard(self._name, self._source, _ADVICE))
