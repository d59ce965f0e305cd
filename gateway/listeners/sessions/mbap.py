"""Sessions of Modbus TCP clients. Their ADUs carry a transaction identifier, so many requests can be in progress."""

from collections.abc import Iterable
from typing import Final

from gateway.errors import IllegalFunction, NoRoute, NotModbus, RequestError
from gateway.listeners.sessions.session import GONE, HALF_CLOSED, Connection, Session
from gateway.listeners.settings import ListenSettings, is_kept_back
from gateway.modbus import mbap
from gateway.modbus.framings import likeness
from gateway.request import Caller, Request, Target

#: Replaces the transaction identifier of a request that another one has replaced.
_GIVEN_UP: Final = -1
#: A client counts if each of its last _COUNTED identifiers was larger than the previous one, by less than _STEP. So
#: none of them was used twice.
_COUNTED: Final = 16
_STEP: Final = 0x1000
#: The next requests were read ahead: they do not prove that the client counts, because it may have given up some.
_READ_AHEAD: Final = -1
#: What the first frames of RTU get.
_OF_RTU: Final = (NoRoute, IllegalFunction)
#: No client has a shorter time-out, in seconds.
_QUICK: Final = 0.05
#: Process bytes already read as soon as possible.
_SOON: Final = 0.0


class MbapSession(Session):
    """A Modbus TCP client.

    Responses carry the client's own transaction and unit identifiers, and are sent in the order in which they become
    available. A client that uses an identifier again has given up its earlier request: only the latest request with an
    identifier gets a response. So reading goes on while the session finishes. And before a response is sent, everything
    that has arrived is read. This is not needed if the client counts its identifiers up and the response is quick,
    because then its next requests have other identifiers.
    """

    __slots__ = ("_framer", "_latest", "_rises", "_under_way")

    def __init__(
        self,
        caller: Caller,
        *,
        router: Target,
        connection: Connection,
        settings: ListenSettings,
        now: float,
    ) -> None:
        """Begin a session; see Session."""
        super().__init__(caller, router=router, connection=connection, settings=settings, now=now)
        self._framer = mbap.MbapFramer()
        #: The requests in progress by transaction identifier.
        self._under_way: dict[int, Request] = {}
        #: The latest identifier.
        self._latest = 0
        #: The number of identifiers in a row that have risen, up to the latest one, or _READ_AHEAD.
        self._rises = 0

    @property
    def has_begun(self) -> bool:
        """Whether a part of an ADU has arrived."""
        return self._framer.unfinished > 0

    def room(self) -> memoryview:
        """Return the buffer for the next bytes from the client."""
        return self._framer.room()

    def received(self, count: int, now: float) -> None:
        """Process `count` bytes that were received into `room()`."""
        self._framer.filled(count)
        self.proceed(now)

    def answer(self, request: Request, pdu: bytes | None) -> None:
        """Take the response to one of the session's requests."""
        self.in_progress -= 1
        is_awaited = request.transaction != _GIVEN_UP
        was_under_way = (  # else it was ready at once
            is_awaited and self._under_way and self._under_way.pop(request.transaction, None) is not None
        )
        if was_under_way and self._rises > 0 and self._connection.time() - request.received_at > _QUICK:
            self._rises = 0  # the client may reuse the identifier after a time-out
        if self._life == GONE:
            return
        if is_awaited and pdu is not None and not is_kept_back(request, self._settings.on_failure):
            self._out.append(mbap.encode(request.transaction, request.unit, pdu))
        self._hold_back(request)
        self._go_on()

    def wants(self, request: Request) -> bool:
        """Tell whether a waiting request should still be sent: not if another with its identifier has replaced it."""
        return super().wants(request) and request.transaction != _GIVEN_UP

    def _awaited_requests(self) -> Iterable[Request]:
        return self._under_way.values()

    @property
    def _hint(self) -> str:
        return self._framer.hint

    @property
    def _takes_more(self) -> bool:
        return (self.in_progress < self._limit or self._limit == 0) and not self._back_pressure.is_on

    def _drain(self, now: float) -> None:
        while self._takes_more:
            adu = self._framer.next()
            if adu is None:
                self._rises = max(self._rises, 0)
                return
            if self._under_way and (earlier := self._under_way.get(adu.transaction)) is not None:
                del self._under_way[adu.transaction]
                earlier.transaction = _GIVEN_UP
                earlier.give_up()
            if self._out:
                self._withdraw(adu.transaction)
            if self._limit == 0:  # no more requests are taken
                continue
            if self._rises != _READ_AHEAD:
                self._rises = self._rises + 1 if 0 < (adu.transaction - self._latest) & 0xFFFF < _STEP else 0
            self._latest = adu.transaction
            self.last_asked = now
            self.asked += 1
            self.in_progress += 1
            request = Request(adu.unit, adu.pdu, self, now, adu.transaction)
            self._router.submit(request, now)
            if not request.is_over:
                self._under_way[adu.transaction] = request
            elif request.error is not None:
                self._check_framing(request, request.error)
        self._rises = _READ_AHEAD
        self._pause()

    def _check_framing(self, request: Request, error: RequestError) -> None:
        """Recognise RTU: an address 0 in it looks like the protocol identifier, and then unit or function are wrong.

        Raises:
            NotModbus: the client has sent RTU frames.
        """
        if isinstance(error, _OF_RTU):
            words = likeness(mbap.encode(request.transaction, request.unit, request.pdu), "Modbus TCP")
            if words:
                raise NotModbus(f"what it sends is not Modbus TCP{words}")

    def _close_when_done(self) -> None:
        """Close when done, but first process bytes read before the client closed its side."""
        if self._life != HALF_CLOSED or self._limit == 0 or not self._framer.has_whole:
            super()._close_when_done()

    def _flush_drained(self) -> None:
        if self._out and self._rises >= _COUNTED and self._connection.time() - self.last_asked > _QUICK:
            self._rises = 0
        self._flush()

    def _flush(self) -> None:
        if self._out and self._rises < _COUNTED:
            self._look()
        super()._flush()

    def _look(self) -> None:
        """Read arrived bytes, and drop the responses whose identifiers occur in them again.

        They are processed later: the caller may be a line that is delivering its response.
        """
        room = self._framer.room()
        if len(room) and (count := self._connection.receive(room)):
            self._framer.filled(count)
            self._rises = _READ_AHEAD
            self._connection.wake(_SOON)
        if self._framer.unfinished:
            self._out = [response for response in self._out if not self._framer.holds(response[:2])]

    def _withdraw(self, transaction: int) -> None:
        """Drop the response with this identifier that was ready at once and is not sent yet."""
        for number, response in enumerate(self._out):
            if response[0] << 8 | response[1] == transaction:
                del self._out[number]
                return
