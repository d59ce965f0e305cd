"""Sessions of clients that send RTU or ASCII frames over TCP: without a transaction identifier.

Nothing in a response says which request it belongs to. So there is one request at a time, as on a serial line, and
responses keep the order of the requests. A client that sends another request before it has a response has given up the
first one: the late response is dropped, because the client would take it for the next one (docs/adr/0007). So a
response is sent only after everything that has arrived was read.

`_NEXT` is the state machine, with the action at each transition.
"""

from collections import deque
from collections.abc import Iterable
from typing import Final

from gateway.errors import NotModbus
from gateway.listeners.sessions.arrivals import Arrivals, Relation
from gateway.listeners.sessions.session import GONE, Connection, Session
from gateway.listeners.settings import ListenSettings, is_kept_back
from gateway.modbus.codes import BROADCAST_UNIT, MAX_RTU_ADU
from gateway.modbus.frame import Frame
from gateway.modbus.framings import Framing, likeness
from gateway.modbus.functions import request_size
from gateway.modbus.rtu import OVERHEAD
from gateway.request import Caller, Request, Target

# The states, named after what the client waits for:
IDLE: Final = "idle"  # no response; the next request can be handed out
AWAITING: Final = "awaiting"  # the response to the request that was handed out
ANSWERED: Final = "answered"  # the same; the response is there, but so are unread bytes
UNANSWERED: Final = "unanswered"  # a response that never comes: of a failure that is not reported, or see UNCLEAR

# The events:
HANDED_OUT: Final = "handed out"  # a request that gets a response has gone to the router
TOGETHER: Final = "together"  # a request arrived together with the one before
LATER: Final = "later"  # a request arrived later than that, or has begun, or other bytes arrived
UNCLEAR: Final = "unclear"  # the same, but the gateway stood still: it may as well have arrived together
RESPONSE: Final = "response"  # the router has answered, perhaps without a response
FAILURE: Final = "failure"  # the request has failed, which is not to be reported
CAUGHT_UP: Final = "caught up"  # nothing has arrived since, or only together with the request

_NEXT: Final[dict[str, dict[str, str]]] = {
    IDLE: {
        TOGETHER: IDLE,  # the request waits behind the others
        LATER: IDLE,  # those that wait are given up; the request waits
        UNCLEAR: UNANSWERED,  # those that wait are given up, and this one gets no response either
        HANDED_OUT: AWAITING,
    },
    AWAITING: {
        TOGETHER: AWAITING,  # it waits
        LATER: IDLE,  # the awaited one and those that wait are given up; it waits
        UNCLEAR: UNANSWERED,  # the same, but it gets no response either
        RESPONSE: ANSWERED,
        FAILURE: UNANSWERED,  # waiting requests get no response either: it would be taken for the failed one's
    },
    ANSWERED: {
        TOGETHER: ANSWERED,  # it waits
        LATER: IDLE,  # the response is dropped, and those that wait are given up; it waits
        UNCLEAR: UNANSWERED,  # the same, but it gets no response either
        CAUGHT_UP: IDLE,  # the response is sent
    },
    UNANSWERED: {
        TOGETHER: UNANSWERED,  # it is dropped, like those before it
        UNCLEAR: UNANSWERED,  # the same
        LATER: IDLE,  # it waits
    },
}

#: A client that sends this many bytes without a request uses another protocol, such as HTTP or TLS.
MOST_NOISE: Final = 4 * MAX_RTU_ADU
#: A broadcast is dropped if this many requests beyond `in_flight` and the awaited one are in progress or wait.
MOST_BROADCASTS: Final = 128
#: Process waiting requests as soon as possible.
_SOON: Final = 0.0


class OverTcpSession(Session):
    """A client that sends RTU or ASCII frames on a TCP connection.

    Requests that arrive together wait for one another; after `in_flight` of them reading stops. Noise gets no response,
    nor does a request to unit 0, unless `unit0` names the unit for it. Broadcasts are never given up, because no
    response is expected. They do not stop reading either, because the time-out of a request behind them would not be
    seen: beyond `MOST_BROADCASTS` they are dropped.
    """

    __slots__ = ("_arrivals", "_awaited", "_state", "_waiting")

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
        self._limit += 1  # the awaited one: later bytes show that it was given up
        self._arrivals = Arrivals(settings.scheme, now)
        self._state = IDLE
        #: The request whose response the client waits for.
        self._awaited: Request | None = None
        #: The requests that arrived after it, in order.
        self._waiting: deque[Request] = deque()

    @property
    def has_begun(self) -> bool:
        """Whether a part of an ADU has arrived."""
        return self._arrivals.has_begun

    def room(self) -> memoryview:
        """Return the buffer for the next bytes from the client."""
        return self._arrivals.room()

    def received(self, count: int, now: float) -> None:
        """Process `count` bytes that were received into `room()`."""
        self._arrivals.filled(count)
        self.proceed(now)

    def look(self, now: float) -> None:
        """Process bytes that have arrived until `now`. Call it every LOOK_STEP; later bytes arrived after that."""
        if self._back_pressure.is_paused:
            return
        is_all = self._read() < len(self._arrivals.room())
        if self._arrivals.has_uncut:
            self.proceed(self._connection.time())
        if is_all:
            self._arrivals.looked(now)

    def wants(self, request: Request) -> bool:
        """Tell whether a waiting request should still be sent: not if the client has given it up."""
        return super().wants(request) and (request is self._awaited or not self._gets_response(request))

    def answer(self, request: Request, pdu: bytes | None) -> None:
        """Take the response to a request of the session; drop it if the client has given the request up.

        The client's next request may have arrived unread. Then the response waits until `proceed` has processed that.
        """
        if self._life == GONE:
            return
        if request is not self._awaited and self._gets_response(request):
            return
        self._hold_back(request)
        if request is self._awaited:
            if is_kept_back(request, self._settings.on_failure):
                self._apply(FAILURE)
                self._abandon_all()
            else:
                self._apply(RESPONSE)
                if pdu is not None:
                    self._out.append(self._arrivals.encode(request.unit, pdu))
                if self._read():
                    self._connection.wake(_SOON)
                    return
                self._deliver()
        else:
            self.in_progress -= 1
        self._go_on()

    def _awaited_requests(self) -> Iterable[Request]:
        return [] if self._awaited is None else [self._awaited]

    @property
    def _takes_more(self) -> bool:
        """Whether reading goes on; also while the client is held back, or its time-out would not be seen."""
        is_blocked = self._back_pressure.blocked_at is not None
        has_room = self.in_progress < self._limit or self._unanswered < self._limit
        return not is_blocked and (has_room or self._limit == 0)

    @property
    def _unanswered(self) -> int:
        """Number of requests that still must get a response."""
        return (self._awaited is not None) + sum(map(self._gets_response, self._waiting))

    def _resume(self) -> None:
        super()._resume()
        if self._waiting and not self._back_pressure.is_on:
            self._connection.wake(_SOON)

    def closed(self) -> None:
        """Drop all requests and responses; see Session."""
        super().closed()
        self._awaited = None
        self._waiting.clear()

    def _drain(self, now: float) -> None:
        arrivals = self._arrivals
        if not self._back_pressure.is_paused:  # while the client waits for the gateway it cannot be silent
            arrivals.go_on(now)
            if arrivals.ends_at is not None and now >= arrivals.ends_at:
                self._read()
                self._take(arrivals.ended(now), now)
            self._take(arrivals.cut(now), now)
        elif self._state == ANSWERED:  # bytes read before the pause show whether the response is still awaited
            self._take(arrivals.cut(now), now)
        if self._state == ANSWERED:
            self._deliver()
        self._hand_out(now)
        if self._takes_more:
            self._connection.wake(arrivals.ends_at)
            super()._resume()  # requests handed out may have been answered at once
        else:
            arrivals.stop()
            self._pause()
        if self._state == ANSWERED:
            self._connection.wake(_SOON)

    def _flush(self) -> None:
        """Send responses, but not one that waits for unread bytes."""
        if self._state != ANSWERED:
            super()._flush()

    def _read(self) -> int:
        """Read the first of the arrived bytes. Return their number.

        They must be processed before a response is sent. The first ones are enough: they arrived together with the last
        request, or later.
        """
        if self._back_pressure.is_paused:
            return 0
        count = self._connection.receive(self._arrivals.room())
        if count:
            self._arrivals.filled(count)
        return count

    def _take(self, frames: list[Frame], now: float) -> None:
        """Take requests that were found at the same time. All are examined before one is handed out."""
        if self._arrivals.noise > MOST_NOISE:
            self._give_up()
            raise NotModbus(f"{self._arrivals.noise} bytes without a request")
        if frames:
            self._queue(frames, now)
        elif not self.asked and self._arrivals.noise:
            self._check_framing()
        if self._awaited is not None or self._waiting:
            self._notice(self._arrivals.noise_relation)

    def _check_framing(self) -> None:
        """Check the first bytes of a client that contain no request.

        Raises:
            NotModbus: they have another framing.
        """
        own: Framing = "ASCII" if self._settings.scheme == "ascii+tcp" else "RTU"
        latest = self._arrivals.latest
        is_begin = own == "RTU" and len(latest) < OVERHEAD + request_size(latest[1:])
        if is_begin or len(latest) < self._arrivals.noise:
            return  # they may be a part of a request, whose values may look like anything
        words = likeness(latest, own)
        if words:
            raise NotModbus(f"what it sends is not {own}{words}")

    def _queue(self, frames: list[Frame], now: float) -> None:
        for frame in frames:
            self._notice(self._arrivals.next_relation())
            request = Request(frame.unit, frame.pdu, self, now)
            if self._must_wait(request):
                self.in_progress += 1
                self._waiting.append(request)
        self.last_asked = now
        self.asked += len(frames)

    def _notice(self, relation: Relation) -> None:
        """Note that something has arrived, and whether it was sent together with the previous request."""
        event = relation
        if relation == UNCLEAR and self._state != UNANSWERED and not self._unanswered:
            event = LATER  # no response could be taken for another
        if event != TOGETHER:
            self._give_up()
        self._apply(event)

    def _must_wait(self, request: Request) -> bool:
        if self._limit == 0:
            return False  # the gateway takes no more requests
        if self._gets_response(request):
            return self._state != UNANSWERED
        return self.in_progress < self._limit + MOST_BROADCASTS

    def _hand_out(self, now: float) -> None:
        """Hand out waiting requests, up to the next one that gets a response."""
        most = self._settings.in_flight
        while self._waiting and self._awaited is None and not self._back_pressure.is_on:
            if self.in_progress - len(self._waiting) > most:
                return
            request = self._waiting.popleft()
            self._flush()  # handing out takes a while, in which the client may give up
            if self._gets_response(request):
                self._awaited = request
                self._apply(HANDED_OUT)
            self._router.submit(request, now)

    def _deliver(self) -> None:
        """Send the response in `_out`."""
        self._apply(CAUGHT_UP)
        self._awaited = None
        self.in_progress -= 1

    def _give_up(self) -> None:
        """Drop all requests, and a kept response: the client's time-out has passed."""
        if self._state == ANSWERED:
            self._out.clear()
        self._abandon_all()

    def _abandon_all(self) -> None:
        """Drop all requests in progress or waiting; broadcasts are still handed out."""
        if self._awaited is not None:
            self._awaited.give_up()
            self._awaited = None
            self.in_progress -= 1
        if self._waiting:
            broadcasts = [request for request in self._waiting if not self._gets_response(request)]
            self.in_progress -= len(self._waiting) - len(broadcasts)
            self._waiting = deque(broadcasts)

    def _apply(self, event: str) -> None:
        self._state = _NEXT[self._state][event]

    def _gets_response(self, request: Request) -> bool:
        """Tell whether a request gets a response; on a line one to unit 0 gets none (S 2.1)."""
        return request.unit != BROADCAST_UNIT or isinstance(self._settings.unit0, int)
