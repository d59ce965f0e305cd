"""The units of this gateway for other sites: their requests are those of clients, with rights by who sends them.

    request ──subject, reply, size──▶ dropped
       │ too many of this sender: 06 · too many hops, no such gateway: 0A · too late: 0B
       ▼
    router (rights, audit) ▸ device ▸ line ──right before it is sent: too late──▶ 0B, not sent
       ▼
    response to the subject of the sender

There is no I/O here. `clock` is the one that deadlines are told by: monotonic, and it goes on while the machine sleeps.
"""

from collections.abc import Callable
from typing import Final, Protocol

from gateway.errors import ExceptionCode, Unwanted
from gateway.events import AccessDenied, Emit
from gateway.fleet.clock import deadline_for
from gateway.fleet.counts import OwnerCounts
from gateway.fleet.headers import CLIENT, DEADLINE, HOPS, MOST_HOPS, ROLE, hops_of, text_of
from gateway.fleet.messages import Message
from gateway.fleet.subjects import answer_folder, asked_by
from gateway.modbus.codes import MAX_PDU
from gateway.modbus.pdu import exception_response
from gateway.request import Request
from gateway.routing.identity import Identity

#: What rows of [[access]] call other sites.
LISTENER: Final = "fleet"
#: The most requests under way, of one sender and of all.
MOST_OF_SENDER: Final = 64
MOST: Final = 1024
#: So many clients of one sender take turns with those that are here. What is beyond shares one more turn.
MOST_CLIENTS: Final = 16


class Way(Protocol):
    """The router for other sites."""

    def submit_named(self, identity: Identity, request: Request, now: float) -> None:
        """Take over a request."""


class SiteOrigin:
    """The origin of one request of another site. `expires_at` is its deadline, `hops` how many sites it has passed."""

    __slots__ = ("_owner", "client", "expires_at", "hops", "host", "reply", "turn")

    def __init__(self, owner: "Owner", turn: "_Turn", reply: str, expires_at: float, hops: int) -> None:
        self._owner = owner
        self.host = turn.sender
        #: As an address has a port: what a sender says of its clients is no name that may be trusted.
        self.client = f"{turn.sender}:{turn.number}"
        self.turn = turn
        self.reply = reply
        self.expires_at = expires_at
        self.hops = hops

    @property
    def seconds_left(self) -> float:
        """Until its deadline."""
        return self.expires_at - self._owner.clock()

    def wants(self, request: Request) -> bool:  # noqa: ARG002 - the same for reads and writes
        """Whether it should still be sent. Lines ask this right before they send it."""
        return self.seconds_left > 0

    def answer(self, request: Request, pdu: bytes | None) -> None:
        """Take the response."""
        self._owner.answered(self, request, pdu)


class Owner:
    """The units of `site`. `instance` is the name of this process for deadlines."""

    def __init__(
        self,
        site: str,
        instance: str,
        way: Way,
        publish: Callable[[Message], bool],
        clock: Callable[[], float],
        emit: Emit,
    ) -> None:
        self.site = site
        self.instance = instance
        self.clock = clock
        self.counts = OwnerCounts()
        #: Requests under way, and their turns: by sender, by what it calls its client.
        self.under_way = 0
        self._turns: dict[str, dict[str, _Turn]] = {}
        self._way = way
        self._publish = publish
        self._emit = emit

    def received(self, message: Message, now: float) -> None:
        """Take a request. `now` is the clock of requests, not that of deadlines."""
        asked, pdu = asked_by(message.subject, self.site), message.body
        if asked is None or not 1 <= len(pdu) <= MAX_PDU:
            self.counts.dropped += 1
            return
        # Who may send a request may name any reply subject, also that of a request to a third site.
        if not message.reply.startswith(answer_folder(asked.sender, self.site)):
            self.counts.dropped += 1
            self._emit(AccessDenied(LISTENER, asked.sender, asked.unit, pdu[0]))
            return
        headers = message.headers or {}
        self.counts.requests += 1
        hops = hops_of(headers.get(HOPS, "1"))
        expires_at = deadline_for(self.instance, headers.get(DEADLINE, ""))
        if hops > MOST_HOPS or expires_at is None:
            self._refuse(message, ExceptionCode.GATEWAY_PATH_UNAVAILABLE)
            self.counts.refused += 1
            return
        if expires_at <= self.clock():
            self._refuse(message, ExceptionCode.GATEWAY_TARGET_FAILED_TO_RESPOND)
            self.counts.expired += 1
            return
        client = text_of(headers.get(CLIENT, ""))
        turn = self._take_turn(asked.sender, client)
        if turn is None:
            self._refuse(message, ExceptionCode.SERVER_DEVICE_BUSY)
            self.counts.busy += 1
            return
        origin = SiteOrigin(self, turn, message.reply, expires_at, hops)
        identity = Identity(client, text_of(headers.get(ROLE, "")))
        self._way.submit_named(identity, Request(asked.unit, pdu, origin, now), now)

    def answered(self, origin: SiteOrigin, request: Request, pdu: bytes | None) -> None:
        """A request has its response, or ends without one."""
        self._end_turn(origin.turn)
        if pdu is None:
            return
        if isinstance(request.error, Unwanted):
            self.counts.expired += 1
            pdu = exception_response(request.pdu[0], ExceptionCode.GATEWAY_TARGET_FAILED_TO_RESPOND)
        else:
            self.counts.responses += 1
        self._publish(Message(origin.reply, pdu))

    def _refuse(self, message: Message, code: ExceptionCode) -> None:
        self._publish(Message(message.reply, exception_response(message.body[0], code)))

    def _take_turn(self, sender: str, told_client: str) -> "_Turn | None":
        """The turn that a request has in queues; None if too many are under way."""
        turns = self._turns.get(sender) or {}
        if self.under_way >= MOST or sum(turn.under_way for turn in turns.values()) >= MOST_OF_SENDER:
            return None
        client = told_client if told_client in turns or len(turns) < MOST_CLIENTS else _OTHERS
        turn = turns.get(client)
        if turn is None:
            taken = {each.number for each in turns.values()}
            number = next(each for each in range(1, MOST_CLIENTS + 2) if each not in taken)
            turn = turns[client] = _Turn(sender, client, number)
            self._turns[sender] = turns
        turn.under_way += 1
        self.under_way += 1
        return turn

    def _end_turn(self, turn: "_Turn") -> None:
        turns = self._turns[turn.sender]
        turn.under_way -= 1
        self.under_way -= 1
        if not turn.under_way:
            del turns[turn.client]
        if not turns:
            del self._turns[turn.sender]

    def __repr__(self) -> str:
        return f"<Owner {self.site} under way={self.under_way}>"


#: The name of all clients beyond MOST_CLIENTS; no header has such a one.
_OTHERS: Final = "\n"


class _Turn:
    """A client of another site: its number there, and its requests under way."""

    __slots__ = ("client", "number", "sender", "under_way")

    def __init__(self, sender: str, client: str, number: int) -> None:
        self.sender = sender
        self.client = client
        self.number = number
        self.under_way = 0
