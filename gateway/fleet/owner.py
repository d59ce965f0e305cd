"""Requests from other sites to the units of this gateway, with the rights of the site that sends them.

    request ──subject, reply, size──▶ dropped
       │ too many of this sender: 06 · too many hops, no such gateway: 0A · too late: 0B
       ▼
    router (rights, audit) ▸ device ▸ line ──right before it is sent: too late──▶ 0B, not sent
       ▼
    response to the subject of the sender

There is no I/O here. Deadlines are by `clock`: it is monotonic, and goes on while the machine sleeps.
"""

from collections.abc import Callable
from typing import Final

from gateway.errors import ExceptionCode, Unwanted
from gateway.events import AccessDenied, Emit
from gateway.fleet.clock import deadline_for
from gateway.fleet.counts import OwnerCounts
from gateway.fleet.headers import CLIENT, DEADLINE, HOPS, MOST_HOPS, ROLE, hops_of, text_of
from gateway.fleet.messages import Message
from gateway.fleet.slots import Slot, Slots
from gateway.fleet.subjects import Asked, answer_folder, asked_by
from gateway.modbus.codes import MAX_PDU
from gateway.modbus.pdu import exception_response
from gateway.request import Caller, Origin, Request, Target

#: The name of other sites in [[access]].
LISTENER: Final = "fleet"


class SiteOrigin(Origin):
    """The origin of one request from another site, with its deadline `expires_at` and the number of sites passed."""

    __slots__ = ("_owner", "caller", "expires_at", "hops", "reply", "slot")

    def __init__(self, owner: "Owner", caller: Caller, slot: Slot, reply: str, expires_at: float, hops: int) -> None:
        self._owner = owner
        self.caller = caller
        self.slot = slot
        self.reply = reply
        self.expires_at = expires_at
        self.hops = hops

    @property
    def seconds_left(self) -> float:
        """Seconds until its deadline."""
        return self.expires_at - self._owner.clock()

    def wants(self, request: Request) -> bool:  # noqa: ARG002 - the same for reads and writes
        """Tell whether there is still time to send it. Lines ask right before they send it."""
        return self.seconds_left > 0

    def answer(self, request: Request, pdu: bytes | None) -> None:
        """Take the response."""
        self._owner.answered(self, request, pdu)


class Owner:
    """The units of `site` for other sites. Deadlines name this process `instance`."""

    def __init__(
        self,
        site: str,
        instance: str,
        router: Target,
        publish: Callable[[Message], bool],
        clock: Callable[[], float],
        emit: Emit,
    ) -> None:
        self.site = site
        self.instance = instance
        self.clock = clock
        self.counts = OwnerCounts()
        self._slots = Slots()
        self._router = router
        self._publish = publish
        self._emit = emit

    @property
    def under_way(self) -> int:
        """Number of requests without a response."""
        return self._slots.under_way

    def received(self, message: Message, now: float) -> None:
        """Take a request at `now`, by the clock of requests and not that of deadlines."""
        asked = asked_by(message.subject, self.site)
        if asked is None or not 1 <= len(message.body) <= MAX_PDU:
            self._drop(now)
        # A sender may name any reply subject, also that of a request to a third site.
        elif not message.reply.startswith(answer_folder(asked.sender, self.site)):
            self._drop(now)
            self._emit(AccessDenied(LISTENER, asked.sender, asked.unit, message.body[0]))
        else:
            self.counts.requests += 1
            self._accept(asked, message, now)

    def _drop(self, now: float) -> None:
        self.counts.dropped += 1
        self.counts.dropped_at = now

    def answered(self, origin: SiteOrigin, request: Request, pdu: bytes | None) -> None:
        """Send the response of a request; `pdu` is None if it ends without one."""
        self._slots.give_back(origin.slot)
        if pdu is None:
            return
        if isinstance(request.error, Unwanted):
            self.counts.expired += 1
            pdu = exception_response(request.pdu[0], ExceptionCode.GATEWAY_TARGET_FAILED_TO_RESPOND)
        else:
            self.counts.responses += 1
        self._publish(Message(origin.reply, pdu))

    def _accept(self, asked: Asked, message: Message, now: float) -> None:
        """Pass a request to the router, unless its headers or the number of requests under way forbid it."""
        headers = message.headers or {}
        hops = hops_of(headers.get(HOPS, "1"))
        expires_at = deadline_for(self.instance, headers.get(DEADLINE, ""))
        if hops > MOST_HOPS or expires_at is None:
            self.counts.refused += 1
            self._refuse(message, ExceptionCode.GATEWAY_PATH_UNAVAILABLE)
            return
        if expires_at <= self.clock():
            self.counts.expired += 1
            self._refuse(message, ExceptionCode.GATEWAY_TARGET_FAILED_TO_RESPOND)
            return
        client = text_of(headers.get(CLIENT, ""))
        slot = self._slots.take(asked.sender, client)
        if slot is None:
            self.counts.busy += 1
            self._refuse(message, ExceptionCode.SERVER_DEVICE_BUSY)
            return
        # Numbered like a port of an address: a client name from another site cannot be trusted.
        name, role = f"{slot.sender}:{slot.number}", text_of(headers.get(ROLE, ""))
        caller = Caller(name, host=slot.sender, share_key=slot.sender, subject=client, role=role)
        origin = SiteOrigin(self, caller, slot, message.reply, expires_at, hops)
        self._router.submit(Request(asked.unit, message.body, origin, now), now)

    def _refuse(self, message: Message, code: ExceptionCode) -> None:
        self._publish(Message(message.reply, exception_response(message.body[0], code)))

    def __repr__(self) -> str:
        return f"<Owner {self.site} under way={self.under_way}>"
