"""What clients of RTU or ASCII over TCP speak: the frames of a serial line, without a transaction identifier.

Nothing in a response says which request it answers, so there is one request at a time, as on a line, and responses keep
the order of the requests. A client that sends another request though it has no response yet has had its time-out: the
response that it no longer awaits is dropped, or it would take it for the next one (docs/adr/0007). Thus a response
leaves only when all that has arrived was looked at.

`_NEXT` is the machine. What is done at each transition stands beside it.
"""

from collections import deque
from typing import Final

from gateway.errors import NotModbus
from gateway.listeners.arrivals import Arrivals, Arrived
from gateway.listeners.failures import is_kept_back
from gateway.listeners.session import GONE, Connection, ListenSettings, Session
from gateway.modbus.codes import BROADCAST_UNIT, MAX_RTU_ADU
from gateway.request import Request, Target

# What the client waits for:
IDLE: Final = "idle"  # for no response; the next request can be handed out
AWAITING: Final = "awaiting"  # for the response to the request that was handed out
ANSWERED: Final = "answered"  # for the same, which is there, but so are bytes that nobody has looked at
UNANSWERED: Final = "unanswered"  # for a response that never comes: nothing is said of failures to it

# What may happen:
HANDED_OUT: Final = "handed out"  # a request that gets a response has gone to the router
TOGETHER: Final = "together"  # a request has come together with the one before
LATER: Final = "later"  # a request has come later than that, or has begun, or anything else has come
RESPONSE: Final = "response"  # the router has answered, perhaps that there is no response
FAILURE: Final = "failure"  # the request has failed, and nothing is to be said of it
READ_UP: Final = "read up"  # nothing has arrived since, or together with the request

_NEXT: Final[dict[str, dict[str, str]]] = {
    IDLE: {
        TOGETHER: IDLE,  # the request waits behind the others
        LATER: IDLE,  # those that wait are given up; the request waits
        HANDED_OUT: AWAITING,
    },
    AWAITING: {
        TOGETHER: AWAITING,  # it waits
        LATER: IDLE,  # the awaited one and those that wait are given up; it waits
        RESPONSE: ANSWERED,
        FAILURE: UNANSWERED,  # those that wait get no response either: it would be taken for that of the failed one
    },
    ANSWERED: {
        TOGETHER: ANSWERED,  # it waits
        LATER: IDLE,  # the response is dropped, and those that wait are given up; it waits
        READ_UP: IDLE,  # the response is sent
    },
    UNANSWERED: {
        TOGETHER: UNANSWERED,  # it is dropped, as those before it
        LATER: IDLE,  # it waits
    },
}

#: A client that sends so many bytes and no request among them speaks something else: HTTP, TLS.
MOST_NOISE: Final = 4 * MAX_RTU_ADU
#: A broadcast is dropped when so many requests more than `in_flight` and the awaited one are under way or wait.
MOST_BROADCASTS: Final = 128
#: A connection is to look at what waits as soon as it can.
_SOON: Final = 0.0


class OverTcpSession(Session):
    """A client that speaks RTU or ASCII on a TCP connection.

    Requests that come together wait for one another; behind `in_flight` of them reading stops. What is no request is
    not answered, nor is a request to unit 0, unless `unit0` names the unit that answers for it. Such broadcasts are
    never given up: nobody awaits an answer to them. Nor do they stop reading, or the time-out of a request behind them
    would not be seen: beyond `MOST_BROADCASTS` they are dropped.
    """

    __slots__ = ("_arrivals", "_awaited", "_state", "_waiting")

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
        self._arrivals = Arrivals(settings.scheme, now)
        self._state = IDLE
        #: The request whose response the client waits for; and what has arrived behind it, in order.
        self._awaited: Request | None = None
        self._waiting: deque[Request] = deque()

    @property
    def has_begun(self) -> bool:
        """Whether a part of an ADU has arrived."""
        return self._arrivals.has_begun

    def room(self) -> memoryview:
        """Where the next bytes from the client go."""
        return self._arrivals.room()

    def received(self, count: int, now: float) -> None:
        """`count` bytes have arrived in `room()`."""
        self._arrivals.filled(count)
        self.proceed(now)

    def wants(self, request: Request) -> bool:
        """See Session; and the client must not have given the request up."""
        return super().wants(request) and (request is self._awaited or not self._gets_response(request))

    def answer(self, request: Request, pdu: bytes | None) -> None:
        """Take the response to one of the session's requests; dropped when the client has given it up.

        It may have: its next request may have arrived, and nobody has read it yet. Then the response waits until
        `proceed` has looked at that.
        """
        if self._life == GONE:
            return
        if request is not self._awaited and self._gets_response(request):
            return
        self._hold_back(request)
        if request is self._awaited:
            if is_kept_back(request, self._settings.on_failure):
                self._happens(FAILURE)
                self._let_go()
            else:
                self._happens(RESPONSE)
                if pdu is not None:
                    self._out.append(self._arrivals.encode(request.unit, pdu))
                if self._has_unread():
                    self._connection.wake(_SOON)
                    return
                self._deliver()
        else:
            self._in_flight -= 1
        self._go_on()

    @property
    def _takes_more(self) -> bool:
        """Whether reading goes on. It does while the client is held back, or its time-out would not be seen."""
        is_blocked = self._back_pressure.blocked_at is not None
        return not is_blocked and (self._in_flight < self._limit or self._to_answer < self._limit)

    @property
    def _to_answer(self) -> int:
        """Requests that get a response and have none yet."""
        return (self._awaited is not None) + sum(map(self._gets_response, self._waiting))

    def _resume(self) -> None:
        super()._resume()
        if self._waiting and not self._back_pressure.is_on:
            self._connection.wake(_SOON)

    def closed(self) -> None:
        """See Session."""
        super().closed()
        self._awaited = None
        self._waiting.clear()

    def _drain(self, now: float) -> None:
        arrivals = self._arrivals
        if not self._is_paused:  # while the client waits for us it cannot be silent
            arrivals.go_on(now)
            self._take(arrivals.ended(now), now)
            self._take(arrivals.cut(now), now)
        if self._state == ANSWERED:
            self._deliver()
        self._hand_out(now)
        if self._takes_more:
            self._connection.wake(arrivals.deadline())
            super()._resume()  # what was handed out may have been answered at once
        else:
            arrivals.stop(now)
            self._pause()

    def _has_unread(self) -> bool:
        """Whether anything stands unread that is to be looked at before a response leaves; its beginning is read.

        The beginning says it all: what stands unread has come together with the last request, or later than that.
        """
        if self._is_draining or self._is_paused:
            return False
        count = self._connection.receive(self._arrivals.room())
        if count:
            self._arrivals.filled(count)
        return count > 0

    def _take(self, arrived: list[Arrived], now: float) -> None:
        """Take the requests that have been found at the same time. None is handed out before all were looked at."""
        if self._arrivals.noise > MOST_NOISE:
            self._give_up()
            raise NotModbus(f"{self._arrivals.noise} bytes without a request")
        if arrived and self._limit > 0:
            self._queue(arrived, now)
        if (self._awaited is not None or self._waiting) and self._arrivals.has_begun_later:
            self._give_up()
            self._happens(LATER)

    def _queue(self, arrived: list[Arrived], now: float) -> None:
        for (unit, pdu), at in arrived:
            happening = TOGETHER if self._arrivals.came_together(at) else LATER
            if happening == LATER:
                self._give_up()
            self._happens(happening)
            request = Request(unit, pdu, self, now)
            if self._is_to_wait(request):
                self._in_flight += 1
                self._waiting.append(request)
        self.last_asked = now

    def _is_to_wait(self, request: Request) -> bool:
        if self._gets_response(request):
            return self._state != UNANSWERED
        return self._in_flight < self._limit + MOST_BROADCASTS

    def _hand_out(self, now: float) -> None:
        """Hand out what waits, up to the next request that gets a response."""
        most = self._settings.in_flight
        while self._waiting and self._awaited is None and not self._back_pressure.is_on:
            if self._in_flight - len(self._waiting) > most:
                return
            request = self._waiting.popleft()
            if self._gets_response(request):
                self._awaited = request
                self._happens(HANDED_OUT)
            self._router.submit(request, now)

    def _deliver(self) -> None:
        """The client gets the response, which is in `_out`."""
        self._happens(READ_UP)
        self._awaited = None
        self._in_flight -= 1

    def _give_up(self) -> None:
        """The client has had its time-out: it waits for no response any more."""
        if self._state == ANSWERED:
            self._out.clear()
        self._let_go()

    def _let_go(self) -> None:
        """Nothing that is under way gets a response, nor what waits; broadcasts are still handed out."""
        if self._awaited is not None:
            self._awaited = None
            self._in_flight -= 1
        if self._waiting:
            broadcasts = [request for request in self._waiting if not self._gets_response(request)]
            self._in_flight -= len(self._waiting) - len(broadcasts)
            self._waiting = deque(broadcasts)

    def _happens(self, happening: str) -> None:
        self._state = _NEXT[self._state][happening]

    def _gets_response(self, request: Request) -> bool:
        """Nobody responds to unit 0 on a line (S 2.1)."""
        return request.unit != BROADCAST_UNIT or isinstance(self._settings.unit0, int)
