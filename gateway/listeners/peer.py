"""A Modbus UDP client as a state machine: a datagram in, at most one response out.

A datagram may be lost, repeated or forged, and there is no connection to close: what is kept of a peer is bounded.
"""

from collections.abc import Callable

from gateway.errors import Busy
from gateway.listeners.failures import OnFailure, is_kept_back
from gateway.listeners.session import NEVER
from gateway.modbus import mbap
from gateway.request import Request, Target

#: Requests in progress by their transaction identifiers.
UnderWay = dict[int, Request]


class Peer:
    """A Modbus UDP client, known by its address and port: the Origin of its requests.

    At most `in_flight` requests are in progress; another one gets 06. The same request again while it is in progress is
    a repeated datagram: it is executed once and gets one response. Another request with the same transaction
    identifier replaces the earlier one, whose response is dropped. That holds for what an earlier listener at the same
    address has in progress, too.
    """

    #: Datagrams come without a certificate.
    role: None = None

    __slots__ = (
        "_is_finishing", "_limit", "_on_failure", "_router", "_send", "asked", "client", "gone", "host", "last_asked",
        "under_way",
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
        under_way: UnderWay | None = None,
    ) -> None:
        """`client` names the peer in events, `host` is its address; `send` sends a datagram to it.

        `under_way` is that of the same peer at an earlier listener: from now on both have it.
        """
        self.client = client
        self.host = host
        self.gone = False
        self.last_asked = NEVER
        self.asked = 0
        self._router = router
        self._send = send
        self._limit = in_flight
        self._on_failure = on_failure
        #: Its requests in progress.
        self.under_way: UnderWay = {} if under_way is None else under_way
        self._is_finishing = False

    @property
    def is_idle(self) -> bool:
        """Whether no request of the client is in progress."""
        return not self.under_way

    @property
    def in_progress(self) -> int:
        """The number of its requests that have no response yet."""
        return len(self.under_way)

    def received(self, adu: mbap.TcpFrame, now: float) -> None:
        """Process one request."""
        self.last_asked = now
        self.asked += 1
        earlier = self.under_way.get(adu.transaction)
        if earlier is not None and (earlier.unit, earlier.pdu) == (adu.unit, adu.pdu):
            return
        if self._is_finishing:
            self.under_way.pop(adu.transaction, None)
            return
        request = Request(adu.unit, adu.pdu, self, now, adu.transaction)
        self.under_way[adu.transaction] = request
        if len(self.under_way) > self._limit:
            request.fail(Busy())
        else:
            self._router.submit(request, now)

    def finish(self) -> None:
        """Take no more requests; one with the identifier of another in progress still shows that this is given up."""
        self._is_finishing = True

    def wants(self, request: Request) -> bool:
        """Whether a request that still waits should be sent."""
        return not self.gone and self.under_way.get(request.transaction) is request

    def answer(self, request: Request, pdu: bytes | None) -> None:
        """Take the response to one of the peer's requests."""
        if self.under_way.get(request.transaction) is not request:
            return
        del self.under_way[request.transaction]
        if pdu is not None and not self.gone and not is_kept_back(request, self._on_failure):
            self._send(mbap.encode(request.transaction, request.unit, pdu))

    def closed(self) -> None:
        """The peer is forgotten; its responses are dropped."""
        self.gone = True

    def __repr__(self) -> str:
        return f"<Peer {self.client} in_flight={len(self.under_way)}>"
