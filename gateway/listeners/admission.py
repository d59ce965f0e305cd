"""Decides which clients a listener accepts, and which one it closes for a new one when it is full.

A full listener closes the first of these that has no request in progress:

1. a client of the address with most connections, if others have fewer;
2. one that was never served;
3. the one that has been idle longest, unless it was served within the last PROTECTED seconds and the new client is of
   another address: a host that connects again may replace its own connections.

No client is closed for an address that already has more connections, so a flooding host replaces only its own. If none
can be closed, the new client is rejected.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from operator import itemgetter
from typing import Final, Generic, Protocol, TypeVar

from gateway.listeners.settings import ListenSettings
from gateway.request import Caller
from gateway.routing.rights import Rights
from gateway.timing.measured import NEVER

#: A served client is protected for this many seconds, however many addresses connect and disconnect.
PROTECTED: Final = 30.0

#: The reason for closing a healthy client.
MADE_ROOM: Final = "made room for another client"
#: The reasons for rejecting a client before anything is read from it.
NOT_MEANT: Final = "it connected to an address of the socket unit that this listener does not serve"
NO_RIGHTS: Final = "no [[access]] allows anything to clients from this address"
ALL_BUSY: Final = "too many clients, and all of them have requests in progress"
NONE_REPLACEABLE: Final = (
    f"too many clients; those without a request were served within the last {PROTECTED:g} s, "
    "or their addresses have fewer connections"
)


class Client(Protocol):
    """A connection or a peer."""

    @property
    def caller(self) -> Caller:
        """The caller of its requests."""

    @property
    def role(self) -> str | None:
        """The role in its certificate, None without one."""

    @property
    def is_idle(self) -> bool:
        """Whether it has no request in progress."""

    @property
    def last_asked(self) -> float:
        """The time of its last request, in seconds of the loop's clock, or NEVER."""


AnyClient = TypeVar("AnyClient", bound=Client)


@dataclass(slots=True)
class _Place:
    """The record of a present client."""

    #: When it connected, last sent a request, or was last seen with one in progress.
    active_at: float
    #: The rights that `is_named` belongs to: looking up a thousand clients takes milliseconds.
    rights: Rights | None = None
    is_named: bool = False

    def look(self, client: Client, now: float) -> None:
        """Note whether the client is or was active."""
        self.active_at = max(self.active_at, client.last_asked) if client.is_idle else now

    def is_named_by(self, rights: Rights, client: Client) -> bool:
        """Tell whether a row gives rights to the address of the client; the result is cached."""
        if self.rights is not rights:
            self.rights, self.is_named = rights, rights.names(client.caller.host, client.role)
        return self.is_named


class Admission(Generic[AnyClient]):
    """The present clients of one listener. Times are of the loop's clock."""

    def __init__(self) -> None:
        self._places: dict[AnyClient, _Place] = {}

    def __len__(self) -> int:
        return len(self._places)

    def __iter__(self) -> Iterator[AnyClient]:
        return iter(list(self._places))

    def enter(self, client: AnyClient, now: float) -> None:
        """Add a client that has connected."""
        self._places[client] = _Place(now)

    def leave(self, client: AnyClient) -> None:
        """Remove a client, if it is still present."""
        self._places.pop(client, None)

    def look(self, now: float) -> None:
        """Note which clients are active; called periodically."""
        for client, place in self._places.items():
            place.look(client, now)

    def make_room(
        self,
        caller: Caller,
        rights: Rights,
        settings: ListenSettings,
        now: float,
        reject: Callable[[AnyClient], None],
        role: str | None = None,
    ) -> str:
        """Make room for a client, perhaps by calling `reject`. Return why it is rejected; empty if it is not.

        `role` is the role in its certificate, None without one.
        """
        if not rights.admits(caller.host):
            return NO_RIGHTS
        self.look(now)
        candidates = self._find_candidates(caller.host, role, rights, settings)
        if candidates is None:
            return ""
        first = self._choose_candidate(candidates, caller.share_key, now)
        if first is None:
            return NONE_REPLACEABLE if any(client.is_idle for client in candidates) else ALL_BUSY
        reject(first)
        return ""

    def _find_candidates(
        self, host: str, role: str | None, rights: Rights, settings: ListenSettings
    ) -> list[AnyClient] | None:
        """Find the clients one of which must be closed for one from `host`; None if the listener is not full."""
        if settings.reserve and not rights.names(host, role):
            unnamed = [client for client, place in self._places.items() if not place.is_named_by(rights, client)]
            if len(unnamed) >= settings.clients - settings.reserve:
                return unnamed
        return list(self) if len(self) >= settings.clients else None

    def _choose_candidate(self, candidates: list[AnyClient], share_key: str, now: float) -> AnyClient | None:
        """Choose the client to close for one with this share key, which is not counted yet; None if there is none."""
        share = Counter(client.caller.share_key for client in self._places)
        own = share[share_key]
        fewest = min([*share.values(), own + 1])
        may_go: list[tuple[tuple[int, bool, float], AnyClient]] = []
        for client in candidates:
            has, idle = share[client.caller.share_key], now - self._places[client].active_at
            is_new, is_other = client.last_asked == NEVER, client.caller.share_key != share_key
            is_protected = idle < PROTECTED and is_other and not is_new
            if client.is_idle and has >= own and (has > fewest or not is_protected):
                may_go.append(((has, is_new, idle), client))
        return max(may_go, key=itemgetter(0))[1] if may_go else None
