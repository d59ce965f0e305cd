"""Access rights for display: the rows in words, and what they mean for one request of one client."""

from collections.abc import Mapping
from dataclasses import dataclass
from ipaddress import ip_address
from typing import NamedTuple

from gateway.config.plan.rights_in_words import RightsRow, right_in_words, row_in_words
from gateway.errors import WrongQuestion
from gateway.modbus.functions import READING_IDENTIFICATION, TABLE_FUNCTIONS
from gateway.routing.access import includes
from gateway.routing.router import Router
from gateway.runtime.running import Running


class Client(NamedTuple):
    """A client at the address `host`. `role` counts only at a TLS listener."""

    host: str
    listener: str
    role: str


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether a client may do something, all that it may do with this unit, and the rows that decide this.

    Without rows, the rules for clients that no row names apply. `is_admitted`: the client has any right there;
    otherwise a listener rejects it. `is_routed`: there is such a unit at this listener. `may` is what is allowed at
    every address. `depends`: without an address in the question, it is not allowed at all of them, but may be at some.
    """

    is_admitted: bool
    is_allowed: bool
    is_routed: bool
    depends: bool
    may: str
    rows: tuple[RightsRow, ...]


def verdict(running: Running, client: Client, unit: int, function: int, address: int | None) -> Verdict:
    """Decide about a request with this function to this unit, at this address, or at all if that is None.

    Raises:
        WrongQuestion: the client has no valid address, or there is no such listener.
    """
    router = routers(running).get(client.listener)
    if router is None:
        raise WrongQuestion(f'there is no listener "{client.listener}"; there are {", ".join(routers(running))}')
    host = client.host
    try:
        ip_address(host)
    except ValueError:
        raise WrongQuestion(f'"{host}" is not an IP address') from None
    rights = router.rights.of_role(client.role) if router.entry.kind == "certified" else router.rights
    everywhere, pdu = rights.everywhere(host, unit), _request(function, address)
    is_everywhere = function in TABLE_FUNCTIONS and address is None
    is_allowed = includes(everywhere, pdu) if is_everywhere else rights.permits(host, unit, pdu)
    return Verdict(
        is_admitted=router is running.routers.web or rights.admits(host),
        is_allowed=is_allowed,
        is_routed=unit in router.routes,
        depends=is_everywhere and not is_allowed and includes(rights.somewhere(host, unit), pdu),
        may=right_in_words(everywhere),
        rows=tuple(row_in_words(row, running.gateway.plan) for row in rights.rows_for(host, unit)),
    )


def _request(function: int, address: int | None) -> bytes:
    """Make the beginning of a request for one item, or for two at the same address; 43 reads the identification."""
    if function == READING_IDENTIFICATION[0]:
        return READING_IDENTIFICATION
    items = b"" if address is None else address.to_bytes(2, "big") + b"\0\1"
    return bytes((function,)) + 2 * items


def routers(running: Running) -> Mapping[str, Router]:
    """Return the routers for clients with an address, by the names that rows have for them."""
    routers = {listener.settings.name: listener.router for listener in running.gateway.listeners}
    return routers | {"web": running.routers.web}
