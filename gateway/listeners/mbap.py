"""Sessions of Modbus TCP clients. Their ADUs carry a transaction identifier, so many requests can be in progress."""

from gateway.listeners.failures import is_kept_back
from gateway.listeners.session import GONE, Connection, ListenSettings, Session
from gateway.modbus import mbap
from gateway.request import Request, Target


class MbapSession(Session):
    """A Modbus TCP client.

    Responses carry the client's own transaction and unit identifiers, and are sent in the order in which they arrive.
    A client that uses an identifier again, as those do that do not count, has given up the request before: only the
    latest one with it gets a response. So reading goes on while the session finishes.
    """

    __slots__ = ("_framer", "_latest")

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
        #: The latest request with each transaction identifier in progress.
        self._latest: dict[int, Request] = {}

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
        is_latest = self._latest.get(request.transaction) is request
        if is_latest:
            del self._latest[request.transaction]
        if self._life == GONE:
            return
        if is_latest and pdu is not None and not is_kept_back(request, self._settings.on_failure):
            self._out.append(mbap.encode(request.transaction, request.unit, pdu))
        self._hold_back(request)
        self._go_on()

    def wants(self, request: Request) -> bool:
        """See Session; also False if another request with its identifier has replaced it."""
        return super().wants(request) and self._latest.get(request.transaction) is request

    @property
    def _takes_more(self) -> bool:
        return (self._in_flight < self._limit or self._limit == 0) and not self._back_pressure.is_on

    def _drain(self, now: float) -> None:
        while self._takes_more:
            adu = self._framer.next()
            if adu is None:
                return
            if self._limit == 0:  # no more requests are taken, but one may have been given up
                self._latest.pop(adu.transaction, None)
                continue
            self.last_asked = now
            self.asked += 1
            self._in_flight += 1
            request = self._latest[adu.transaction] = Request(adu.unit, adu.pdu, self, now, adu.transaction)
            self._router.submit(request, now)
        self._pause()
