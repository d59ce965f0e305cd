"""Which clients a listener accepts, and which one it closes for a new one when it is full.

A full listener closes the first of these that has no request in progress:

1. a client of the address with most connections, if others have fewer;
2. one that was never served;
3. one that has stopped polling at its usual interval;
4. one whose interval is not known yet. Among equals, the one that has been silent for most of its intervals.

All others poll as usual and stay. No client is closed for an address that already has more connections, so a flooding
host replaces only its own. If none can be closed, the new client is rejected.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from operator import itemgetter
from typing import Final, Generic, TypeVar

from gateway.listeners.activity import Activity, Client
from gateway.listeners.session import ListenSettings
from gateway.routing.access import Rights

#: Why a healthy client is closed.
MADE_ROOM: Final = "made room for another client"
#: Why a client is rejected before anything is read from it.
NO_RIGHTS: Final = "no [[access]] allows anything to clients from this address"
ALL_BUSY: Final = "too many clients, and all of them have requests in progress"
NONE_REPLACEABLE: Final = (
    "too many clients; those without a request poll as usual, or their addresses have fewer connections"
)

#: How many activities of disconnected addresses are kept, and for how many seconds: a client that returns continues.
MOST_REMEMBERED: Final = 1000
MEMORY: Final = 600.0

AnyClient = TypeVar("AnyClient", bound=Client)


class Admission(Generic[AnyClient]):
    """The present and recent clients of one listener. Times are of the loop's clock.

    `origin_of` returns what counts as the address of a client from a host, at a time.
    """

    def __init__(self, origin_of: Callable[[str, float], str]) -> None:
        self._origin_of = origin_of
        self._activities: dict[AnyClient, Activity] = {}
        #: Those of disconnected addresses by origin, in the order in which they left.
        self._left: dict[str, Activity] = {}

    def __len__(self) -> int:
        return len(self._activities)

    def __iter__(self) -> Iterator[AnyClient]:
        return iter(list(self._activities))

    def enter(self, client: AnyClient, now: float) -> None:
        """A client has connected."""
        origin = self._origin_of(client.caller.host, now)
        activity = self._left.pop(origin, None)
        if activity is None or now - activity.active_at > MEMORY:
            activity = Activity(origin, now)
        activity.come_back(now)
        self._activities[client] = activity

    def leave(self, client: AnyClient, now: float) -> None:
        """A client has disconnected or is being closed; may be called twice."""
        activity = self._activities.pop(client, None)
        if activity is None:
            return
        activity.look(client, now)
        activity.rights = None
        self._left.pop(activity.origin, None)
        self._left[activity.origin] = activity
        if len(self._left) > MOST_REMEMBERED:
            del self._left[next(iter(self._left))]

    def look(self, now: float) -> None:
        """Look at every client; called periodically."""
        for client, activity in self._activities.items():
            activity.look(client, now)

    def refusal(
        self,
        host: str,
        rights: Rights,
        settings: ListenSettings,
        now: float,
        dismiss: Callable[[AnyClient], None],
        role: str | None = None,
    ) -> str:
        """Why a client from `host` is rejected; empty if it is accepted, perhaps after another one was closed.

        `role` is that in its certificate, None if it has shown none.
        """
        if not rights.admits(host):
            return NO_RIGHTS
        self.look(now)
        candidates = self._find_candidates(host, role, rights, settings)
        if candidates is None:
            return ""
        first = self._choose_candidate(candidates, self._origin_of(host, now), now)
        if first is None:
            return NONE_REPLACEABLE if any(client.is_idle for client in candidates) else ALL_BUSY
        dismiss(first)
        return ""

    def _find_candidates(
        self, host: str, role: str | None, rights: Rights, settings: ListenSettings
    ) -> list[AnyClient] | None:
        """The clients of which one must be closed for one from `host`; None if the listener is not full."""
        if settings.reserve and not rights.names(host, role):
            unnamed = [
                client for client, activity in self._activities.items() if not activity.is_named_by(rights, client)
            ]
            if len(unnamed) >= settings.clients - settings.reserve:
                return unnamed
        return list(self) if len(self) >= settings.clients else None

    def _choose_candidate(self, candidates: list[AnyClient], origin: str, now: float) -> AnyClient | None:
        """The client to close for one from `origin`; the new connection is not counted yet."""
        share = Counter(activity.origin for activity in self._activities.values())
        own = share[origin]
        fewest = min([*share.values(), own + 1])
        may_go: list[tuple[tuple[int, bool, bool, float], AnyClient]] = []
        for client in candidates:
            activity = self._activities[client]
            has = share[activity.origin]
            if client.is_idle and has >= own and (has > fewest or not activity.is_usual(now)):
                may_go.append(((has, *activity.order(now)), client))
        return max(may_go, key=itemgetter(0))[1] if may_go else None
