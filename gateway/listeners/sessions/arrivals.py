"""Cuts the bytes of a client of RTU or ASCII over TCP into requests, and tells which of them were sent together."""

from typing import Final, Literal

from gateway.modbus.ascii import AsciiFramer
from gateway.modbus.codes import MAX_RTU_ADU
from gateway.modbus.frame import Frame
from gateway.modbus.rtu import RtuFramer

#: The silence that ends an RTU frame of unknown size, or noise, in seconds. A network delays the second half of a frame
#: by less (TCP first repeats a lost segment after 200 ms).
SILENCE: Final = 0.25
#: Requests that arrive within this many seconds were sent together: no client's time-out is so short.
TOGETHER: Final = 0.05
#: How often a client that sends nothing is looked at, in seconds. What is read next has arrived since the last look.
LOOK_STEP: Final = 0.02
#: The most that is received at once.
_BUFFER: Final = 2 * MAX_RTU_ADU


#: Whether a request was sent together with the one before, or later. It is unclear if the gateway stood still between.
Relation = Literal["together", "later", "unclear"]


class Arrivals:
    """The bytes of one client, and the requests in them. Times in seconds, of one clock.

    Bytes are stored as they arrive (`filled`) and cut into frames when the session asks for them (`cut`). While nothing
    is read (`stop`), the framer's clock stands still: it is unknown how long the bytes read next have been waiting.

    Bytes have arrived at any time between the last look that found no more of them (`looked`) and when they are cut. A
    frame behind noise is found long after it has arrived, at any time since the noise.
    """

    __slots__ = (
        "_begun_since", "_behind", "_buffer", "_found_since", "_framer", "_heard_at", "_heard_since", "_later_after",
        "_looked_at", "_stopped_at", "_together_until", "_uncut", "latest", "noise",
    )  # fmt: skip

    def __init__(self, scheme: str, now: float) -> None:
        """`scheme` is `rtu+tcp` or `ascii+tcp`."""
        self._framer = AsciiFramer() if scheme == "ascii+tcp" else RtuFramer(SILENCE)
        self._buffer = memoryview(bytearray(_BUFFER))
        self._uncut = b""
        #: Bytes since the last request, and those that were cut last.
        self.noise = 0
        self.latest = b""
        #: What had arrived then was cut.
        self._looked_at = now
        #: The last bytes have arrived between these two times.
        self._heard_since = self._heard_at = now
        #: The incomplete frame, and the frames that were found last, have not arrived before these times.
        self._begun_since = self._found_since = now
        #: Until when a request was certainly sent together with the one before, and after when it certainly was not.
        self._together_until = self._later_after = now
        #: Since when nothing is read; how far the framer's clock is behind because of that.
        self._stopped_at: float | None = None
        self._behind = 0.0

    @property
    def has_uncut(self) -> bool:
        """Whether bytes have been read that are not cut yet."""
        return bool(self._uncut)

    @property
    def has_begun(self) -> bool:
        """Whether a part of a frame has arrived."""
        return bool(self._uncut) or self._framer.unfinished > 0

    def room(self) -> memoryview:
        """Where the next bytes go."""
        return self._buffer

    def filled(self, count: int) -> None:
        """`count` bytes have arrived in `room()`."""
        self._uncut += bytes(self._buffer[:count])

    def looked(self, now: float) -> None:
        """All that had arrived at `now` has been read and cut."""
        self._looked_at = now

    def ended(self, now: float) -> list[Frame]:
        """Let time pass; the frames that were ended by a silence before the bytes that are not cut yet."""
        ends_at = self._framer.deadline()
        if ends_at is None or now < ends_at + self._behind:
            return []
        self._found_since = self._begun_since
        return self._found(self._framer.tick(ends_at))  # `now - behind` may always be rounded to just before it

    def cut(self, now: float) -> list[Frame]:
        """The frames that are now complete."""
        data, self._uncut = self._uncut, b""
        if not data:
            return []
        self.latest = data
        self._heard_since, self._heard_at = self._looked_at, now
        framer = self._framer
        if not framer.unfinished:
            self._begun_since = self._heard_since
        self.noise += len(data)
        framer.heard_noise = False
        frames = framer.received(data, now - self._behind)
        if frames and not framer.heard_noise:  # else they may have arrived before this piece, hidden by the noise
            self._begun_since = self._heard_since
        self._found_since = self._begun_since if framer.heard_noise else self._heard_since
        return self._found(frames)

    @property
    def noise_relation(self) -> Relation:
        """When bytes arrived that are not a request, or not yet: as the last request and its companions, or later."""
        return self._relation(self._heard_since, self._heard_at) if self.noise else "together"

    def next_relation(self) -> Relation:
        """Compare when the next of the frames that were found last was sent with the one before; once for each."""
        since, at = self._found_since, self._heard_at
        relation = self._relation(since, at)
        self._together_until = max(self._together_until, since + TOGETHER)
        self._later_after = max(self._later_after, at + TOGETHER)
        return relation

    def _relation(self, since: float, at: float) -> Relation:
        if at <= self._together_until:
            return "together"
        return "later" if since > self._later_after else "unclear"

    def deadline(self) -> float | None:
        """When a silence will end something, or None."""
        ends_at = self._framer.deadline()
        return None if ends_at is None else ends_at + self._behind

    def encode(self, unit: int, pdu: bytes) -> bytes:
        """The ADU in this client's framing."""
        return self._framer.encode(unit, pdu)

    def stop(self, now: float) -> None:
        """Reading stops: from now on the client waits for the gateway."""
        if self._stopped_at is None:
            self._stopped_at = now

    def go_on(self, now: float) -> None:
        """Reading continues. Bytes that waited for the gateway are not late."""
        if self._stopped_at is not None:
            self._behind += now - self._stopped_at
            self._together_until = self._later_after = now + TOGETHER
            self._looked_at = now
            self._stopped_at = None

    def _found(self, frames: list[Frame]) -> list[Frame]:
        if frames:
            self.noise = self._framer.behind
        return frames
