"""Whom a listener lets in, and who makes room for another client.

When there is no place, the first of these is closed, and nobody who has a request under way:

1. who is from the address with most connections, as long as others have fewer;
2. who was never served;
3. who has stopped asking as it usually does;
4. whose interval is not known yet; of these, as of those before, who has been silent for most of its own intervals.

All others ask as usual, and stay. Nobody goes for an address that has more connections already: whoever floods a
listener only drives out itself. If nobody may go, the one who comes is sent away.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from operator import itemgetter
from typing import Final, Generic, TypeVar

from gateway.listeners.activity import Activity, Client
from gateway.listeners.session import ListenSettings
from gateway.routing.access import Rights

#: Why a client is closed that was well.
MADE_ROOM: Final = "made room for another client"
#: Why a client is sent away before a byte of it is read.
NO_RIGHTS: Final = "no [[access]] allows anything to clients from this address"
ALL_BUSY: Final = "too many clients, and all of them have requests under way"
NOBODY_GOES: Final = "too many clients; those without a request ask as usual, or their addresses have fewer connections"

#: So many activities are remembered of addresses that have left, for so many seconds: a client that comes back goes on.
MOST_REMEMBERED: Final = 1000
MEMORY: Final = 600.0

AnyClient = TypeVar("AnyClient", bound=Client)


class Admission(Generic[AnyClient]):
    """The clients of one listener, and those that were. Times are of the loop's clock.

    `origin_of` tells what counts as the address of a client from a host, at a time.
    """

    def __init__(self, origin_of: Callable[[str, float], str]) -> None:
        self._origin_of = origin_of
        self._activities: dict[AnyClient, Activity] = {}
        #: Those of addresses that have left, by origin; who left first is the first.
        self._left: dict[str, Activity] = {}

    def __len__(self) -> int:
        return len(self._activities)

    def __iter__(self) -> Iterator[AnyClient]:
        return iter(list(self._activities))

    def enter(self, client: AnyClient, now: float) -> None:
        """A client has come in."""
        origin = self._origin_of(client.host, now)
        activity = self._left.pop(origin, None)
        if activity is None or now - activity.active_at > MEMORY:
            activity = Activity(origin, now)
        activity.come_back(now)
        self._activities[client] = activity

    def leave(self, client: AnyClient, now: float) -> None:
        """A client has gone, or is going; one that has gone already may go again."""
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
        """Look at what everybody does; to be called every now and then, whoever comes."""
        for client, activity in self._activities.items():
            activity.look(client, now)

    def refusal(
        self, host: str, rights: Rights, settings: ListenSettings, now: float, dismiss: Callable[[AnyClient], None]
    ) -> str:
        """Why a client from `host` is not let in; empty when there is a place, perhaps that of one who is dismissed."""
        if not rights.admits(host):
            return NO_RIGHTS
        self.look(now)
        rivals = self._rivals(host, rights, settings)
        if rivals is None:
            return ""
        first = self._first_to_go(rivals, self._origin_of(host, now), now)
        if first is None:
            return NOBODY_GOES if any(client.is_idle for client in rivals) else ALL_BUSY
        dismiss(first)
        return ""

    def _rivals(self, host: str, rights: Rights, settings: ListenSettings) -> list[AnyClient] | None:
        """Those of whom one has to go for a client from `host`; None as long as there is a place."""
        if settings.reserve and not rights.names(host):
            unnamed = [
                client for client, activity in self._activities.items() if not activity.is_named_by(rights, client.host)
            ]
            if len(unnamed) >= settings.clients - settings.reserve:
                return unnamed
        return list(self) if len(self) >= settings.clients else None

    def _first_to_go(self, rivals: list[AnyClient], origin: str, now: float) -> AnyClient | None:
        """Who goes for a client from `origin`, which has its connections without the one that comes."""
        share = Counter(activity.origin for activity in self._activities.values())
        own = share[origin]
        fewest = min([*share.values(), own + 1])
        may_go: list[tuple[tuple[int, bool, bool, float], AnyClient]] = []
        for client in rivals:
            activity = self._activities[client]
            has = share[activity.origin]
            if client.is_idle and has >= own and (has > fewest or not activity.is_usual(now)):
                may_go.append(((has, *activity.order(now)), client))
        return max(may_go, key=itemgetter(0))[1] if may_go else None
