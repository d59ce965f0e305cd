"""What arrives from a client of RTU or ASCII over TCP: bytes, cut into requests, and which of these came together."""

from collections import deque
from typing import Final, NamedTuple

from gateway.modbus.ascii import AsciiFramer
from gateway.modbus.codes import MAX_RTU_ADU
from gateway.modbus.frame import Frame
from gateway.modbus.rtu import RtuFramer

#: The silence that ends an RTU frame of unknown size, and whatever is no frame, in seconds. Longer than a network holds
#: back the second half of a frame (the first repetition of a lost segment comes after 200 ms).
SILENCE: Final = 0.25
#: Requests that come within so many seconds were sent together: no client's time-out is so short.
TOGETHER: Final = 0.05
#: What is received at once.
_BUFFER: Final = 2 * MAX_RTU_ADU


class Arrived(NamedTuple):
    """A request, and when its last byte came."""

    frame: Frame
    at: float


class Arrivals:
    """The bytes of one client, and the requests in them. Times in seconds, of one clock.

    Bytes are taken as they come (`filled`) and cut into frames when the session looks at them (`cut`). While nothing is
    read (`stop`) the framer's time stands still: how long what comes afterwards has been waiting, nobody knows.
    """

    __slots__ = (
        "_behind", "_buffer", "_framer", "_heard_at", "_pieces", "_stopped_at", "_together_until", "_uncut", "noise",
    )  # fmt: skip

    def __init__(self, scheme: str, now: float) -> None:
        """`scheme` is `rtu+tcp` or `ascii+tcp`."""
        self._framer = AsciiFramer() if scheme == "ascii+tcp" else RtuFramer(SILENCE)
        self._buffer = memoryview(bytearray(_BUFFER))
        self._uncut = b""
        #: The pieces with the bytes that are no frame yet, and when each came.
        self._pieces: deque[tuple[bytes, float]] = deque()
        #: Bytes since the last request.
        self.noise = 0
        #: When the last bytes came; until when requests were sent together with the one before.
        self._heard_at = now
        self._together_until = now
        #: Since when nothing is read; and how far the framer's time is behind because of that.
        self._stopped_at: float | None = None
        self._behind = 0.0

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

    def ended(self, now: float) -> list[Arrived]:
        """Let time pass; the frames that silence has ended before what is not cut yet came."""
        ends_at = self._framer.deadline()
        if ends_at is None or now < ends_at + self._behind:
            return []
        return self._arrived(self._framer.tick(ends_at))  # `now - behind` may be rounded to just before it, for ever

    def cut(self, now: float) -> list[Arrived]:
        """The frames that are complete with the bytes that have come."""
        data = self._uncut
        if not data:
            return []
        self._uncut = b""
        self._heard_at = now
        self.noise += len(data)
        if isinstance(self._framer, RtuFramer):  # ASCII frames end with the piece in which they are found
            self._pieces.append((data, now))
        return self._arrived(self._framer.received(data, now - self._behind))

    @property
    def has_begun_later(self) -> bool:
        """Whether bytes that are no request, or none yet, came later than the last request and what came with that."""
        return self.noise > 0 and self._heard_at > self._together_until

    def came_together(self, at: float) -> bool:
        """Whether the request that came at that time came together with the one before; asked once of each."""
        is_together = at <= self._together_until
        self._together_until = max(self._together_until, at + TOGETHER)
        return is_together

    def deadline(self) -> float | None:
        """When silence ends something, or None."""
        ends_at = self._framer.deadline()
        return None if ends_at is None else ends_at + self._behind

    def encode(self, unit: int, pdu: bytes) -> bytes:
        """The ADU as this client reads it."""
        return self._framer.encode(unit, pdu)

    def stop(self, now: float) -> None:
        """Nothing is read from now on: the client waits for us."""
        if self._stopped_at is None:
            self._stopped_at = now

    def go_on(self, now: float) -> None:
        """It is read again. What has waited because of us is not late."""
        if self._stopped_at is not None:
            self._behind += now - self._stopped_at
            self._together_until = now + TOGETHER
            self._stopped_at = None

    def _arrived(self, frames: list[Frame]) -> list[Arrived]:
        """When each frame that was found now came. Behind noise they are found long after that."""
        if frames:
            self.noise = self._framer.behind
        if len(self._pieces) > 1 and frames:
            arrived = self._look_up(frames)
        else:
            arrived = [Arrived(frame, self._heard_at) for frame in frames]
        self._forget_finished()
        return arrived

    def _look_up(self, frames: list[Frame]) -> list[Arrived]:
        """The same, of frames in more than one piece."""
        heard = b"".join(data for data, _ in self._pieces)
        pieces = iter(self._pieces)
        arrived = []
        found_to = read_to = 0
        at = self._heard_at
        for frame in frames:
            adu = self._framer.encode(frame.unit, frame.pdu)
            found_to = heard.find(adu, found_to) + len(adu)
            while read_to < found_to:
                data, at = next(pieces)
                read_to += len(data)
            arrived.append(Arrived(frame, at))
        return arrived

    def _forget_finished(self) -> None:
        """Keep only what the framer keeps."""
        pieces = self._pieces
        finished = sum(len(data) for data, _ in pieces) - self._framer.unfinished
        while finished > 0:
            data, at = pieces.popleft()
            if finished < len(data):
                pieces.appendleft((data[finished:], at))
            finished -= len(data)
