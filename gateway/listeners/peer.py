"""A Modbus UDP client as a state machine: a datagram in, at most one response out.

A datagram may be lost, repeated or forged, and there is no connection to close: what is kept of a peer is bounded.
"""

from collections.abc import Callable

from gateway.errors import Busy
from gateway.listeners.failures import OnFailure, is_kept_back
from gateway.listeners.session import NEVER
from gateway.modbus import mbap
from gateway.request import Request, Target


class Peer:
    """A Modbus UDP client, known by its address and port: the Origin of its requests.

    At most `in_flight` requests are in progress; another one gets 06. The same request again while it is in progress is
    a repeated datagram: it is executed once and gets one response. Another request with the same transaction
    identifier replaces the earlier one, whose response is dropped.
    """

    #: Datagrams come without a certificate.
    role: None = None

    __slots__ = (
        "_limit", "_on_failure", "_router", "_send", "_under_way", "asked", "client", "gone", "host", "last_asked",
    )  # fmt: skip

    def __init__(
        self,
        client: str,
        *,
        host: str,
        router: Target,
        send: Callable[[bytes], None],
        in_flight: int,
        on_failure: OnFailure = "exception",
    ) -> None:
        """`client` names the peer in events, `host` is its address; `send` sends a datagram to it."""
        self.client = client
        self.host = host
        self.gone = False
        self.last_asked = NEVER
        self.asked = 0
        self._router = router
        self._send = send
        self._limit = in_flight
        self._on_failure = on_failure
        self._under_way: dict[int, Request] = {}

    @property
    def is_idle(self) -> bool:
        """Whether no request of the client is in progress."""
        return not self._under_way

    @property
    def in_progress(self) -> int:
        """The number of its requests that have no response yet."""
        return len(self._under_way)

    def received(self, adu: mbap.TcpFrame, now: float) -> None:
        """Process one request."""
        self.last_asked = now
        self.asked += 1
        earlier = self._under_way.get(adu.transaction)
        if earlier is not None and (earlier.unit, earlier.pdu) == (adu.unit, adu.pdu):
            return
        request = Request(adu.unit, adu.pdu, self, now, adu.transaction)
        self._under_way[adu.transaction] = request
        if len(self._under_way) > self._limit:
            request.fail(Busy())
        else:
            self._router.submit(request, now)

    def wants(self, request: Request) -> bool:
        """Whether a request that still waits should be sent."""
        return not self.gone and self._under_way.get(request.transaction) is request

    def answer(self, request: Request, pdu: bytes | None) -> None:
        """Take the response to one of the peer's requests."""
        if self._under_way.get(request.transaction) is not request:
            return
        del self._under_way[request.transaction]
        if pdu is not None and not self.gone and not is_kept_back(request, self._on_failure):
            self._send(mbap.encode(request.transaction, request.unit, pdu))

    def closed(self) -> None:
        """The peer is forgotten; its responses are dropped."""
        self.gone = True

    def __repr__(self) -> str:
        return f"<Peer {self.client} in_flight={len(self._under_way)}>"
