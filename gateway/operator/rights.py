"""Access rights for display: the rows in words, and what they mean for one request of one client."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from ipaddress import ip_address

from gateway.config.plan.rights_in_words import RightsRow, right_in_words, row_in_words, rows_in_words
from gateway.errors import WrongQuestion
from gateway.modbus.functions import READING_IDENTIFICATION
from gateway.routing.access import includes
from gateway.routing.rights import Rights
from gateway.routing.router import Router
from gateway.runtime.gateway import Gateway
from gateway.runtime.running import Running


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether a client may do something, all that it may do with this unit, and the rows that decide this.

    Without rows, the rules for clients that no row names apply. `is_admitted`: the client has any right there;
    otherwise a listener rejects it. `is_routed`: there is such a unit at this listener.
    """

    is_admitted: bool
    is_allowed: bool
    is_routed: bool
    may: str
    rows: tuple[RightsRow, ...]


def rights_in_words(gateway: Gateway) -> Sequence[RightsRow]:
    """Return the table of rights in words; the first row that applies counts."""
    return rows_in_words(gateway.plan)


def verdict(running: Running, host: str, listener: str, unit: int, function: int, role: str) -> Verdict:
    """Decide about a request with this function to this unit, from a client at the address `host`.

    `role` counts only at a TLS listener.

    Raises:
        WrongQuestion: this is no address, or there is no such listener.
    """
    router = routers(running).get(listener)
    if router is None:
        raise WrongQuestion(f'there is no listener "{listener}"; there are {", ".join(routers(running))}')
    try:
        ip_address(host)
    except ValueError:
        raise WrongQuestion(f'"{host}" is not an IP address') from None
    rights = router.rights.of_role(role) if router.entry.kind == "certified" else router.rights
    rows = tuple(row_in_words(row, running.gateway.plan) for row in rights.rows_for(host, unit))
    may = right_in_words(rights.everywhere(host, unit))
    is_admitted = router is running.routers.web or rights.admits(host)
    return Verdict(is_admitted, _allows(rights, host, unit, function), unit in router.routes, may, rows)


def _allows(rights: Rights, host: str, unit: int, function: int) -> bool:
    """Tell whether a client may use a function of a unit, at all addresses; 43 for reading the identification."""
    return includes(rights.everywhere(host, unit), READING_IDENTIFICATION if function == 43 else bytes((function,)))


def routers(running: Running) -> Mapping[str, Router]:
    """Return the routers for clients with an address, by the names that rows have for them."""
    routers = {listener.settings.name: listener.router for listener in running.gateway.listeners}
    return routers | {"web": running.routers.web}
