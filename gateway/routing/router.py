"""From a request to its target: one look-up for the route, one for the right."""

from collections.abc import Callable
from dataclasses import dataclass

from gateway import errors, events
from gateway.devices.device import Device
from gateway.modbus.codes import BROADCAST_UNIT, HIGHEST_UNIT
from gateway.modbus.functions import only_reads
from gateway.request import NamedTarget, Request, Target
from gateway.routing.access import EntryPoint, includes
from gateway.routing.audit import AuditedOrigin
from gateway.routing.broadcast import Broadcast
from gateway.routing.rights import Rights
from gateway.trace.ring import Ring


@dataclass(slots=True)
class RouterCounts:
    """Numbers of requests without a route, and without a right."""

    no_route: int = 0
    denied: int = 0


class Router(Target):
    """Routes the requests of one entry point. `routes` and `rights` are empty at first and may be replaced at any time.

    Unit 0 has no route, a broadcast, or the route of another unit.
    """

    def __init__(
        self,
        entry: EntryPoint,
        clock: Callable[[], float],
        emit: events.Emit,
        why_no_route: str = "no such unit",
        ring: Ring | None = None,
    ) -> None:
        """Make a router without routes. `clock` is that of the requests; `why_no_route` is for the log."""
        self.entry = entry
        self.routes: dict[int, NamedTarget] = {}
        self.rights = Rights((), entry)
        self.counts = RouterCounts()
        self._clock = clock
        self._emit = emit
        self._why_no_route = why_no_route
        self._ring = ring or Ring()

    def submit(self, request: Request, now: float) -> None:
        """Pass the request to its target. Without a route it fails with 0A, without a right with 01."""
        unit = request.unit
        target = self.routes.get(unit)
        if target is not None and request.pdu[0] in self.rights[request.caller.host][unit]:
            target.submit(request, now)
        else:
            self._submit_other(request, target, now, self.rights, unit)

    def _submit_other(
        self, request: Request, target: NamedTarget | None, now: float, rights: Rights, unit: int, device: str = ""
    ) -> None:
        """Submit a request that is no plain read, with an audit for a write; fail it without a route or a right.

        `unit` is that of the rights. `device` is what events call the target, if the unit of the request is not that of
        clients.
        """
        caller, pdu = request.caller, request.pdu
        if not only_reads(pdu):
            is_broadcast = isinstance(target, Broadcast)
            request.origin = AuditedOrigin(
                request.origin, self.entry.name, self._clock, self._emit, device, is_broadcast=is_broadcast
            )
        if target is None:
            self.counts.no_route += 1
            rejection = errors.NoRoute(self._why_no_route)
            self._emit(events.RequestRefused.of(request, rejection, listener=self.entry.name))
            self._ring.refuse(request, rejection, now)
            request.fail(rejection)
            return
        if not includes(rights.at(caller.host, unit), pdu):
            ruling = rights.ruling(caller.host, unit, pdu)
            if not ruling.is_allowed:
                self._deny(request, target, now, ruling.refused_at, device)
                return
            if ruling.has_priority:
                request.caller = caller.with_priority()
        target.submit(request, now)

    def _deny(self, request: Request, target: NamedTarget, now: float, refused_at: str, device: str) -> None:
        """Fail a request without the right to it."""
        caller, function = request.caller, request.pdu[0]
        self.counts.denied += 1
        who = caller.client, request.unit, function, caller.subject, caller.role
        self._emit(events.AccessDenied(self.entry.name, *who, device, refused_at))
        where = f", at {refused_at}" if refused_at else ""
        denial = errors.AccessDenied(f"through {self.entry.name}{where}")
        self._ring.refuse(request, denial, now, name=target.name)
        request.fail(denial)


class CertifiedRouter(Router):
    """The router of clients with a certificate: each has the rights of its role."""

    def submit(self, request: Request, now: float) -> None:
        """Pass the request to its target, by the rights of the client's role."""
        unit, caller = request.unit, request.caller
        target, rights = self.routes.get(unit), self.rights.of_role(caller.role)
        if target is not None and request.pdu[0] in rights[caller.host][unit]:
            target.submit(request, now)
        else:
            self._submit_other(request, target, now, rights, unit)


class NamingRouter(Router):
    """The router of an entrance where devices are asked by their names too, so that some need no unit: see `key_of`.

    What is told of a request to one of those has its unit on the wire, and its name.
    """

    def submit(self, request: Request, now: float) -> None:
        """Pass the request to its target; the unit may be the key of a device."""
        if request.unit <= HIGHEST_UNIT:
            super().submit(request, now)
            return
        key, device = request.unit, self.routes.get(request.unit)
        request.unit = device.settings.unit if isinstance(device, Device) else BROADCAST_UNIT
        self._submit_other(request, device, now, self.rights, key, "" if device is None else device.name)
