"""A Modbus UDP client as a state machine: a datagram in, at most one response out.

A datagram may be lost, repeated or forged, and there is no connection to close: the state of a peer is bounded.
"""

from collections.abc import Callable
from typing import NamedTuple

from gateway.errors import Busy
from gateway.listeners.settings import ListenSettings, is_kept_back
from gateway.modbus import mbap
from gateway.request import Caller, Origin, Request, Target
from gateway.timing.measured import NEVER


class Path(NamedTuple):
    """The path to a peer: its addresses, and a socket."""

    #: Reads the arrived datagrams, so that every peer can `notice` them. They are processed soon, not inside this call.
    read: Callable[[], None]
    #: Sends a datagram to the peer.
    send: Callable[[bytes], None]


class Peer(Origin):
    """A Modbus UDP client, identified by its address and port: the Origin of its requests.

    At most `in_flight` requests are in progress; another one gets 06. The same request again while it is in progress is
    a repeated datagram: it is executed once and gets one response. Another request with the same transaction identifier
    replaces the earlier one, whose response is dropped. Every datagram that has arrived counts, also while the peer
    finishes, so all are read before a response is sent.
    """

    #: Datagrams come without a certificate.
    role: None = None

    __slots__ = (
        "_is_finishing", "_path", "_router", "_settings", "_under_way", "asked", "caller", "gone", "last_asked",
    )  # fmt: skip

    def __init__(self, caller: Caller, *, router: Target, settings: ListenSettings, path: Path) -> None:
        """Submit the requests of `caller` to `router`."""
        self.caller = caller
        self.gone = False
        self.last_asked = NEVER
        self.asked = 0
        self._router = router
        self._settings = settings
        self._path = path
        #: Its requests in progress by their transaction identifiers.
        self._under_way: dict[int, Request] = {}
        self._is_finishing = False

    @property
    def is_idle(self) -> bool:
        """Whether no request of the client is in progress."""
        return not self._under_way

    @property
    def in_progress(self) -> int:
        """Number of its requests without a response."""
        return len(self._under_way)

    def notice(self, adu: mbap.TcpFrame) -> bool:
        """Tell whether a received request repeats one in progress. If it reuses its identifier, replace that one."""
        earlier = self._under_way.get(adu.transaction)
        if earlier is None:
            return False
        if (earlier.unit, earlier.pdu) == (adu.unit, adu.pdu):
            return True
        del self._under_way[adu.transaction]
        earlier.give_up()
        return False

    def received(self, adu: mbap.TcpFrame, now: float, *, is_repeated: bool = False) -> None:
        """Process one request; `is_repeated` if it repeated one in progress when it was read."""
        self.last_asked = now
        self.asked += 1
        if self.notice(adu) or is_repeated or self._is_finishing:
            return
        request = Request(adu.unit, adu.pdu, self, now, adu.transaction)
        self._under_way[adu.transaction] = request
        if len(self._under_way) > self._settings.in_flight:
            request.fail(Busy())
        else:
            self._router.submit(request, now)

    def finish(self) -> None:
        """Accept no more requests; one that reuses the identifier of another in progress still gives that up."""
        self._is_finishing = True

    def wants(self, request: Request) -> bool:
        """Tell whether a waiting request should still be sent."""
        return not self.gone and self._under_way.get(request.transaction) is request

    def answer(self, request: Request, pdu: bytes | None) -> None:
        """Take the response to one of the peer's requests."""
        if not self.gone:
            self._path.read()
        if self._under_way.get(request.transaction) is not request:
            return
        del self._under_way[request.transaction]
        if pdu is not None and not self.gone and not is_kept_back(request, self._settings.on_failure):
            self._path.send(mbap.encode(request.transaction, request.unit, pdu))

    def closed(self) -> None:
        """Forget the peer: its responses are dropped."""
        self.gone = True
        for request in self._under_way.values():
            request.give_up()

    def __repr__(self) -> str:
        return f"<Peer {self.caller.client} in_flight={len(self._under_way)}>"
