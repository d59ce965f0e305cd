"""What clients of RTU or ASCII over TCP speak: the frames of a serial line, without a transaction identifier.

Nothing in a response says which request it answers, so there is one request at a time, as on a line, and responses keep
the order of the requests. A client that sends another request though it has no response yet has had its time-out: the
response that it no longer awaits is dropped, or it would take it for the next one (docs/adr/0007).
"""

from collections import deque
from typing import Final

from gateway.errors import NotModbus
from gateway.listeners.failures import is_kept_back
from gateway.listeners.session import Connection, ListenSettings, Session
from gateway.modbus.ascii import AsciiFramer
from gateway.modbus.codes import BROADCAST_UNIT, MAX_RTU_ADU
from gateway.modbus.frame import Frame
from gateway.modbus.rtu import RequestFramer
from gateway.request import Request, Target

#: The silence that ends an RTU frame of unknown size, and whatever is no frame, in seconds. Longer than a network holds
#: back the second half of a frame (the first repetition of a lost segment comes after 200 ms).
SILENCE: Final = 0.25
#: Requests that come within so many seconds were sent together: no client's time-out is so short.
TOGETHER: Final = 0.05
#: A client that sends so many bytes and no request among them speaks something else: HTTP, TLS.
MOST_NOISE: Final = 4 * MAX_RTU_ADU
#: What is received at once.
_BUFFER: Final = 2 * MAX_RTU_ADU
#: A connection is to look at what waits as soon as it can.
_SOON: Final = 0.0


class OverTcpSession(Session):
    """A client that speaks RTU or ASCII on a TCP connection.

    Requests that come together wait for one another, at most `in_flight` of them. What is no request is not answered,
    nor is a request to unit 0, unless `unit0` names the unit that answers for it. When one that fails gets no response
    (`on_failure`), those that were sent together with it get none either: theirs would be taken for its own.
    """

    __slots__ = (
        "_answers_unit0", "_awaited", "_behind", "_buffer", "_framer", "_frames", "_heard_at", "_noise", "_stopped_at",
        "_together_until", "_unanswered", "_waiting",
    )  # fmt: skip

    def __init__(
        self,
        client: str,
        *,
        host: str,
        router: Target,
        connection: Connection,
        settings: ListenSettings,
        now: float,
    ) -> None:
        """See Session."""
        super().__init__(client, host=host, router=router, connection=connection, settings=settings, now=now)
        self._limit += 1  # the awaited one: what comes behind it tells that it is awaited no more
        self._answers_unit0 = isinstance(settings.unit0, int)
        self._framer = AsciiFramer() if settings.scheme == "ascii+tcp" else RequestFramer(SILENCE)
        self._buffer = memoryview(bytearray(_BUFFER))
        self._noise = 0
        #: What has arrived, what has been taken of it, and the one whose response the client waits for.
        self._frames: deque[Frame] = deque()
        self._waiting: deque[Request] = deque()
        self._awaited: Request | None = None
        #: Whether one that was awaited has failed, and nothing was said.
        self._unanswered = False
        #: When bytes have arrived; until when requests were sent together with the one before.
        self._heard_at = now
        self._together_until = now
        #: Since when nothing is read; and how far the framer's time is behind because of that.
        self._stopped_at: float | None = None
        self._behind = 0.0

    @property
    def has_begun(self) -> bool:
        """Whether a part of an ADU has arrived."""
        return self._framer.unfinished > 0

    def room(self) -> memoryview:
        """Where the next bytes from the client go."""
        return self._buffer

    def received(self, count: int, now: float) -> None:
        """`count` bytes have arrived in `room()`."""
        self._noise += count
        self._heard_at = now
        self._found(self._framer.tick(now - self._behind))
        self._found(self._framer.received(bytes(self._buffer[:count]), now - self._behind))
        self.proceed(now)

    def wants(self, request: Request) -> bool:
        """See Session; and the client must not have given the request up."""
        return super().wants(request) and (request is self._awaited or not self._gets_response(request))

    def answer(self, request: Request, pdu: bytes | None) -> None:
        """Take the response to one of the session's requests; dropped when the client has given it up.

        It may have: its next request may have arrived, and nobody has read it yet.
        """
        if request is self._awaited and not (self._draining or self._paused or self.gone):
            self._connection.look()
        if request is self._awaited:
            self._awaited = None
            if is_kept_back(request, self._on_failure):
                self._unanswered = True
                self._drop_waiting()
            elif pdu is not None and not self.gone:
                self._out.append(self._framer.encode(request.unit, pdu))
        elif self._gets_response(request):
            return
        self._in_flight -= 1
        if self.gone:
            return
        self._hold_back(request)
        if self._draining:
            return
        self._flush()
        self._resume()
        self._close_when_done()

    def _resume(self) -> None:
        super()._resume()
        if self._waiting and not self._blocked and not self._is_held:
            self._connection.wake(_SOON)

    def _drain(self, now: float) -> None:
        self._catch_up(now)
        if self._noise > MOST_NOISE:
            raise NotModbus(f"{self._noise} bytes without a request")
        self._submit(now)
        while self._takes_more:
            if not self._frames:
                ends_at = self._framer.deadline()
                self._connection.wake(None if ends_at is None else ends_at + self._behind)
                return
            self._take(*self._frames.popleft(), now)
            self._submit(now)
        if self._stopped_at is None:
            self._stopped_at = now
        self._pause()

    def _catch_up(self, now: float) -> None:
        """Let the framer's time pass, but not while the client waits for us: then it cannot be silent.

        How long what arrives afterwards has been waiting to be read, nobody knows.
        """
        if self._paused:
            return
        if self._stopped_at is not None:
            self._behind += now - self._stopped_at
            self._together_until = now + TOGETHER
            self._stopped_at = None
        self._found(self._framer.tick(now - self._behind))

    def _found(self, frames: list[Frame]) -> None:
        if frames:
            self._frames += frames
            self._noise = 0

    def _take(self, unit: int, pdu: bytes, now: float) -> None:
        are_together = self._heard_at <= self._together_until
        if self._awaited is not None and not are_together:
            self._give_up()
        self._unanswered = self._unanswered and are_together
        self._together_until = max(self._together_until, self._heard_at + TOGETHER)
        self.last_asked = now
        request = Request(unit, pdu, self, now)
        if not (self._unanswered and self._gets_response(request)):
            self._in_flight += 1
            self._waiting.append(request)

    def _give_up(self) -> None:
        """The client has had its time-out: it waits for no response any more."""
        self._awaited = None
        self._in_flight -= 1
        self._drop_waiting()

    def _drop_waiting(self) -> None:
        """Nothing that waits gets a response; broadcasts are still handed out."""
        broadcasts = [request for request in self._waiting if not self._gets_response(request)]
        self._in_flight -= len(self._waiting) - len(broadcasts)
        self._waiting = deque(broadcasts)

    def _submit(self, now: float) -> None:
        """Hand out what waits, up to the next request that gets a response."""
        while self._waiting and self._awaited is None and not self._blocked and not self._is_held:
            request = self._waiting.popleft()
            if self._gets_response(request):
                self._awaited = request
            self._router.submit(request, now)

    def _gets_response(self, request: Request) -> bool:
        """Nobody responds to unit 0 on a line (S 2.1)."""
        return request.unit != BROADCAST_UNIT or self._answers_unit0
