"""From a request to its target: one look-up for the route, one for the right."""

from collections.abc import Callable
from dataclasses import dataclass

from gateway import errors, events
from gateway.modbus.functions import only_reads
from gateway.request import NamedTarget, Request
from gateway.routing.access import EntryPoint, Rights
from gateway.routing.audit import AuditedOrigin
from gateway.routing.broadcast import Broadcast
from gateway.routing.identity import ANONYMOUS, Identity
from gateway.trace.ring import Ring


@dataclass(slots=True)
class Counts:
    """Requests without a route, and without a right."""

    no_route: int = 0
    denied: int = 0


class Router:
    """Routes the requests of one entry point. `routes` and `rights` are empty at first and may be replaced at any time.

    Unit 0 has a route too: none, a broadcast, or that of another unit.
    """

    def __init__(
        self,
        entry: EntryPoint,
        clock: Callable[[], float],
        emit: events.Emit,
        why_no_route: str = "no such unit",
        ring: Ring | None = None,
    ) -> None:
        """`clock` is that of the requests; `why_no_route` is for the log."""
        self.entry = entry
        self.routes: dict[int, NamedTarget] = {}
        self.rights = Rights((), entry)
        self.counts = Counts()
        self._clock = clock
        self._emit = emit
        self._why_no_route = why_no_route
        self._ring = ring or Ring()

    def submit(self, request: Request, now: float) -> None:
        """Pass the request to its target. Without a route it gets 0A, without a right 01."""
        unit = request.unit
        target = self.routes.get(unit)
        if target is not None and request.pdu[0] in self.rights[request.origin.host][unit]:
            target.submit(request, now)
        else:
            self._submit_other(request, target, now, self.rights, ANONYMOUS)

    def submit_for(self, identity: Identity, request: Request, now: float) -> None:
        """The same for a client with a certificate, which has the rights of its role."""
        self._submit_with(self.rights.of_role(identity.role), identity, request, now)

    def submit_named(self, identity: Identity, request: Request, now: float) -> None:
        """The same for a client of which `identity` is told, for the audit only: it has the rights of its host."""
        self._submit_with(self.rights, identity, request, now)

    def _submit_with(self, rights: Rights, identity: Identity, request: Request, now: float) -> None:
        unit = request.unit
        target = self.routes.get(unit)
        if target is not None and request.pdu[0] in rights[request.origin.host][unit]:
            target.submit(request, now)
        else:
            self._submit_other(request, target, now, rights, identity)

    def _submit_other(
        self, request: Request, target: NamedTarget | None, now: float, rights: Rights, identity: Identity
    ) -> None:
        """Submit a write, or fail a request without a route or a right."""
        pdu = request.pdu
        if not only_reads(pdu):
            is_broadcast = isinstance(target, Broadcast)
            request.origin = AuditedOrigin(
                request.origin, self.entry.name, self._clock, self._emit, identity, is_broadcast=is_broadcast
            )
        if target is None:
            self.counts.no_route += 1
            rejection = errors.NoRoute(self._why_no_route)
            self._emit(events.RequestRefused.of(request, rejection, listener=self.entry.name))
            self._ring.refuse(request, rejection, now)
            request.fail(rejection)
            return
        right = rights[request.origin.host][request.unit]
        if pdu[:1] in right or pdu[:2] in right:
            target.submit(request, now)
        else:
            self.counts.denied += 1
            client = request.origin.client
            self._emit(
                events.AccessDenied(
                    self.entry.name, client, request.unit, pdu[0], subject=identity.subject, role=identity.role
                )
            )
            denial = errors.AccessDenied(f"through {self.entry.name}")
            self._ring.refuse(request, denial, now, name=target.name)
            request.fail(denial)


class CertifiedRouter:
    """The router of one certified client: that of its listener, with the rights of its role."""

    __slots__ = ("_identity", "_router")

    def __init__(self, router: Router, identity: Identity) -> None:
        self._router = router
        self._identity = identity

    def submit(self, request: Request, now: float) -> None:
        """See Router.submit."""
        self._router.submit_for(self._identity, request, now)
