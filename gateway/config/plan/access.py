"""The settings of listeners, and the rows of access rights."""

from collections.abc import Iterable
from typing import Final

from gateway.config.schema.access import Access
from gateway.config.schema.listen import Listen
from gateway.config.values.site import Site
from gateway.listeners.settings import ListenSettings
from gateway.modbus.codes import BROADCAST_UNIT, Area
from gateway.modbus.pdu import Span
from gateway.routing.access import NOTHING, READING, WRITING, AccessRow, Network, Right, right_to
from gateway.tls.settings import ServerTls

_RIGHTS: Final = {"read": READING, "write": WRITING}


def access_row(row: Access) -> AccessRow:
    """Turn a row of `[[access]]` into a row of rights."""
    return AccessRow(
        right=_right(row),
        networks=None if row.networks is None else networks_of(row),
        listeners=None if row.listen is None else frozenset(row.listen),
        units=None if row.units == "all" else frozenset(row.units),
        role=row.role,
        source=row.place,
        sites=frozenset(sites_of(row)),
        addresses=addresses_of(row),
        priority=row.priority,
    )


def networks_of(row: Access) -> tuple[Network, ...]:
    """List what `from` names, without sites."""
    return tuple(each for each in row.networks or () if not isinstance(each, Site))


def sites_of(row: Access) -> tuple[str, ...]:
    """List the sites that `from` names."""
    return tuple(each.name for each in row.networks or () if isinstance(each, Site))


def addresses_of(row: Access) -> tuple[Span, ...] | None:
    """List the addresses that a row is for; None if it has no such key, so that it is for all."""
    areas = ((area, getattr(row, area)) for area in Area)
    named = [(area, ranges) for area, ranges in areas if ranges is not None]
    spans = tuple(Span(area, first, last - first + 1) for area, ranges in named for first, last in ranges)
    return spans if named else None


def _right(row: Access) -> Right:
    if row.functions is not None:
        return right_to(row.functions)
    return NOTHING.union(*(_RIGHTS[name] for name in row.allow or ()))


def listen_settings(listen: Listen, everyone: Iterable[Listen]) -> ListenSettings:
    """Turn a table into the settings of a listener, which is one of `everyone`."""
    bind = listen.bind
    return ListenSettings(
        name=listen.label,
        host=bind.host,
        port=bind.port,
        clients=listen.clients,
        reserve=listen.reserve,
        idle=listen.idle,
        in_flight=listen.in_flight,
        unit0=listen.unit0 if listen.upstream is None else BROADCAST_UNIT,  # there it is a unit of the server
        on_failure=listen.on_failure,
        source=listen.place,
        scheme=bind.scheme,
        ipv6_only=any(bind.takes_ipv4_of(other.bind) for other in everyone),
        line=listen.line or "",
        upstream=listen.upstream or "",
        shares_port=any(bind.has_port_of(other.bind) for other in everyone if other is not listen),
        tls=_server_tls(listen),
    )


def _server_tls(listen: Listen) -> ServerTls | None:
    if listen.certificate is None or listen.key is None:
        return None
    return ServerTls(listen.certificate, listen.key, listen.clients_ca, listen.crl)
