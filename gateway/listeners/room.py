"""Whom a listener lets in, and who makes room for another client."""

from collections import Counter
from collections.abc import Callable, Collection
from typing import Final, Protocol, TypeVar

from gateway.listeners.session import NO_RIGHTS, NO_ROOM
from gateway.routing.access import Rights

#: Why a client is closed that was well.
MADE_ROOM: Final = "made room for another client"


class Client(Protocol):
    """A connection or a peer. `last_asked` is in seconds of the loop's clock."""

    @property
    def host(self) -> str:
        """The address, which decides what the client may do."""

    @property
    def is_idle(self) -> bool:
        """Whether no request of it is under way."""

    @property
    def last_asked(self) -> float:
        """When it asked last."""


AnyClient = TypeVar("AnyClient", bound=Client)


def refusal(
    host: str, rights: Rights, present: Collection[AnyClient], places: int, dismiss: Callable[[AnyClient], None]
) -> str:
    """Why a client from `host` is not let in; empty when there is a place for it, perhaps of one that was dismissed.

    That is the longest idle one (T 4.2.1.1) of the address that has the most: whoever floods a listener only drives out
    itself.
    """
    if not rights.admits(host):
        return NO_RIGHTS
    if len(present) < places:
        return ""
    idle = [client for client in present if client.is_idle]
    if not idle:
        return NO_ROOM
    share = Counter(client.host for client in present)
    dismiss(min(idle, key=lambda client: (-share[client.host], client.last_asked)))
    return ""
