"""Sessions of Modbus TCP clients. Their ADUs carry a transaction identifier, so many requests can be in progress."""

from gateway.listeners.failures import is_kept_back
from gateway.listeners.session import GONE, Connection, ListenSettings, Session
from gateway.modbus import mbap
from gateway.request import Request, Target


class MbapSession(Session):
    """A Modbus TCP client.

    Responses carry the client's own transaction and unit identifiers, and are sent in the order in which they arrive.
    """

    __slots__ = ("_framer",)

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
        self._framer = mbap.MbapFramer()

    @property
    def has_begun(self) -> bool:
        """Whether a part of an ADU has arrived."""
        return self._framer.unfinished > 0

    def room(self) -> memoryview:
        """The buffer for the next bytes from the client."""
        return self._framer.room()

    def received(self, count: int, now: float) -> None:
        """`count` bytes have arrived in `room()`."""
        self._framer.filled(count)
        self.proceed(now)

    def answer(self, request: Request, pdu: bytes | None) -> None:
        """Take the response to one of the session's requests."""
        self._in_flight -= 1
        if self._life == GONE:
            return
        if pdu is not None and not is_kept_back(request, self._settings.on_failure):
            self._out.append(mbap.encode(request.transaction, request.unit, pdu))
        self._hold_back(request)
        self._go_on()

    def _drain(self, now: float) -> None:
        while self._takes_more:
            adu = self._framer.next()
            if adu is None:
                return
            self.last_asked = now
            self.asked += 1
            self._in_flight += 1
            self._router.submit(Request(adu.unit, adu.pdu, self, now, adu.transaction), now)
        self._pause()
