"""Cuts the bytes of a client of RTU or ASCII over TCP into requests, and tells which were sent together."""

from math import inf
from typing import Final, Literal

from gateway.modbus.ascii import AsciiFramer
from gateway.modbus.codes import MAX_RTU_ADU
from gateway.modbus.frame import Frame
from gateway.modbus.rtu import RtuFramer

#: The silence that ends an RTU frame of unknown size, or noise, in seconds. A network delays the second half of a frame
#: by less (TCP repeats a lost segment after 200 ms at first).
SILENCE: Final = 0.25
#: Requests that arrive within this many seconds were sent together: no client has such a short time-out.
TOGETHER: Final = 0.05
#: Seconds between looks at a silent client. Bytes read next have arrived since the last look.
LOOK_STEP: Final = 0.02
#: The constant time for a framer.
_ALWAYS: Final = 0.0
#: The most bytes received at once.
_BUFFER: Final = 2 * MAX_RTU_ADU


#: When a request was sent: together with the previous one, or later. Unclear: the gateway stood still in between.
Relation = Literal["together", "later", "unclear"]


class Arrivals:
    """The bytes of one client, and the requests in them. Times in seconds, of one clock.

    Bytes are stored as they arrive (`filled`) and cut into frames when the session asks for them (`cut`). They have
    arrived between the last look that found no more of them (`looked`) and when they are cut. A frame behind noise may
    have arrived at any time since the noise.

    The framer gets no time: it would take a stand-still of the gateway for a silence.
    """

    __slots__ = (
        "_begun_since", "_buffer", "_found_since", "_framer", "_heard_at", "_heard_since", "_is_stopped",
        "_later_after", "_looked_at", "_together_until", "_uncut", "ends_at", "latest", "noise",
    )  # fmt: skip

    def __init__(self, scheme: str, now: float) -> None:
        """Expect the framing of `scheme`: `rtu+tcp` or `ascii+tcp`."""
        self._framer = AsciiFramer() if scheme == "ascii+tcp" else RtuFramer(SILENCE)
        self._buffer = memoryview(bytearray(_BUFFER))
        #: Received bytes that are not cut yet.
        self._uncut = b""
        #: The number of bytes since the last request.
        self.noise = 0
        #: The bytes cut last.
        self.latest = b""
        #: All bytes that had arrived at this time were cut.
        self._looked_at = now
        #: The last bytes have arrived between these two times.
        self._heard_since = self._heard_at = now
        #: Lower limits of arrival times: of the bytes since there was no incomplete frame, and of the frames found
        #: last.
        self._begun_since = self._found_since = now
        #: Up to the first time a request was certainly sent together with the previous one, after the second certainly
        #: not.
        self._together_until = self._later_after = now
        #: When a silence will end the incomplete frame, or None.
        self.ends_at: float | None = None
        #: Set while nothing is read.
        self._is_stopped = False

    @property
    def has_uncut(self) -> bool:
        """Whether bytes have been read that are not cut yet."""
        return bool(self._uncut)

    @property
    def has_begun(self) -> bool:
        """Whether a part of a frame has arrived."""
        return bool(self._uncut) or self._framer.unfinished > 0

    def room(self) -> memoryview:
        """Return the buffer for the next bytes."""
        return self._buffer

    def filled(self, count: int) -> None:
        """Store `count` bytes that were received into `room()`."""
        self._uncut += bytes(self._buffer[:count])

    def looked(self, now: float) -> None:
        """Note that all bytes that had arrived at `now` were read and cut."""
        self._looked_at = now

    def ended(self, now: float) -> list[Frame]:
        """Return the frames that a silence has ended. All bytes that have arrived until `now` must have been read.

        Bytes that are not cut yet may have arrived right after the last look: it was certainly silent only until then.
        """
        silent_until = self._looked_at if self._uncut else now
        if self.ends_at is None or silent_until < self.ends_at:
            return []
        self.ends_at = None
        self._found_since = self._begun_since
        return self._found(self._framer.tick(inf))

    def cut(self, now: float) -> list[Frame]:
        """Cut the received bytes. Return the frames that are complete with them."""
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
        frames = framer.received(data, _ALWAYS)
        self.ends_at = None if framer.deadline() is None else now + SILENCE
        # noise may hide frames that arrived before these bytes
        self._found_since = self._begun_since if framer.heard_noise else self._heard_since
        return self._found(frames)

    @property
    def noise_relation(self) -> Relation:
        """When bytes that are no request, or not yet, were sent, relative to the last request."""
        return self._relation(self._heard_since, self._heard_at) if self.noise else "together"

    def next_relation(self) -> Relation:
        """Return when the next of the frames found last was sent, relative to the previous one; once for each."""
        since, at = self._found_since, self._heard_at
        relation = self._relation(since, at)
        self._together_until = max(self._together_until, since + TOGETHER)
        self._later_after = max(self._later_after, at + TOGETHER)
        return relation

    def _relation(self, since: float, at: float) -> Relation:
        if at <= self._together_until:
            return "together"
        return "later" if since > self._later_after else "unclear"

    def encode(self, unit: int, pdu: bytes) -> bytes:
        """Encode the ADU of `pdu` in this client's framing."""
        return self._framer.encode(unit, pdu)

    def stop(self) -> None:
        """Note that reading stops: from now on the client waits for the gateway."""
        self._is_stopped = True

    def go_on(self, now: float) -> None:
        """Note that reading continues. Bytes that waited for that are not late, and a silence starts anew."""
        if self._is_stopped:
            self._is_stopped = False
            self._together_until = self._later_after = now + TOGETHER
            self._looked_at = now
            if self.ends_at is not None:
                self.ends_at = now + SILENCE

    def _found(self, frames: list[Frame]) -> list[Frame]:
        if frames:
            self.noise = self._framer.behind
        return frames
