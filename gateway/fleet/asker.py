"""Requests to the units of another site: an upstream whose requests are messages."""

import asyncio
from collections.abc import Callable
from typing import Any, Final, NamedTuple

from gateway.events import Emit
from gateway.fleet.exchange import SitePort
from gateway.fleet.headers import CLIENT, DEADLINE, HOPS, ROLE
from gateway.fleet.owner import SiteOrigin
from gateway.images.ordered import ForwardedOrigin
from gateway.lines.transaction import Transaction
from gateway.modbus.codes import BROADCAST_UNIT, MAX_PDU
from gateway.modbus.mbap import TcpFrame
from gateway.ports.port import Port
from gateway.request import Origin
from gateway.routing.audit import AuditedOrigin
from gateway.upstreams.driver import UpstreamDriver
from gateway.upstreams.upstream import Upstream

#: An owner stops sending a request this long before its client may be answered, in seconds. It covers the time between
#: the owner's last look at the clock and the sending.
GUARD: Final = 0.05


class Asker(UpstreamDriver):
    """Passes messages, time and requests to `upstream`; the PortOwner of the port to another site.

    A client gets no answer before the deadline that the owner has for its request: otherwise a write could begin after
    the answer. So requests under way keep their time when the connection is lost.
    """

    def __init__(self, upstream: Upstream, loop: asyncio.AbstractEventLoop, emit: Emit) -> None:
        super().__init__(upstream, loop, emit)
        #: Number of answers without an open request: copies, late ones, or ones that are not PDUs.
        self.unasked = 0
        self._call_soon = loop.call_soon
        self._port: SitePort | None = None
        self._is_closed = False
        #: Transaction identifiers of open requests by request number. Numbers are never used again.
        self._identifiers: dict[int, int] = {}
        self._last_number = 0

    def port_up(self, port: Port) -> None:
        """Send requests through `port` from now on."""
        assert isinstance(port, SitePort)  # noqa: S101 - `Exchange.open` returns nothing else
        self._port = self._boundary.port = port
        port.asking = self
        self._run(self.upstream.port_up, self._send, self._time())

    def received(self, data: bytes, *, damaged: bool = False) -> None:
        """Ignore bytes: this port carries messages."""

    def answered(self, number: int, pdu: bytes) -> None:
        """Pass the response to request `number` to the upstream. Count it as unasked if that request is not open."""
        identifier = self._identifiers.pop(number, None) if 1 <= len(pdu) <= MAX_PDU else None
        if identifier is None:
            self.unasked += 1
        else:
            self._run(self._receive, TcpFrame(identifier, BROADCAST_UNIT, pdu))

    def unsent(self, number: int) -> None:
        """Report to the upstream that request `number` has reached no gateway."""
        identifier = self._identifiers.pop(number, None)
        if identifier is not None:
            self._run(self.upstream.unsent, identifier, self._time())

    def close(self) -> None:
        """Stop the timer, once no request is under way."""
        self._is_closed = True
        if not self.is_busy:
            super().close()

    def _send(self, identifier: int, transaction: Transaction) -> None:
        request = transaction.requests[0]
        passed = passed_on(request.origin)
        time_left = min(transaction.limit, passed.seconds_left)
        self._last_number += 1
        self._identifiers[self._last_number] = identifier
        headers = {CLIENT: transaction.client, HOPS: str(passed.hops + 1)}
        if request.caller.role:
            headers[ROLE] = request.caller.role
        port, pdu = self._port, transaction.asked.data
        if port is not None:
            headers[DEADLINE] = port.clocks.until(time_left - GUARD, transaction.ends_at)
        if port is None or not port.ask(self._last_number, transaction.unit, pdu, headers):
            self._call_soon(self.unsent, self._last_number)

    def _receive(self, frame: TcpFrame) -> None:
        self.upstream.received((frame,), self._time())

    def _down(self) -> None:
        """Stop sending; requests under way may still be answered."""
        self.upstream.finish(self._time())

    def _step(self, step: Callable[..., None], *arguments: Any) -> None:
        step(*arguments)
        if self.upstream.must_renew:
            self._identifiers.clear()
            self.upstream.forget_late()
            self.upstream.tick(self._time())

    def _run(self, step: Callable[..., None], *arguments: Any) -> None:
        super()._run(step, *arguments)
        if self._is_closed:
            self.close()


class PassedOn(NamedTuple):
    """Limits of a request from another site: `hops` is the number of sites passed so far, `seconds_left` its time."""

    hops: int = 0
    seconds_left: float = float("inf")


def passed_on(origin: Origin) -> PassedOn:
    """Return the hops and the time left of the site request that `origin` stands for; the defaults for others."""
    if isinstance(origin, ForwardedOrigin):
        origin = origin.original.origin
    if isinstance(origin, AuditedOrigin):
        origin = origin.origin
    return PassedOn(origin.hops, origin.seconds_left) if isinstance(origin, SiteOrigin) else PassedOn()
