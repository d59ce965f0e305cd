"""The table of access rights in words, with the rules that are not rows."""

from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

from gateway.config.plan.settings import Plan
from gateway.config.values.reserved_names import CONTROL, EMBEDDED
from gateway.config.values.unitset import show_units
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.routing.access import EVERYTHING, LOOPBACK, NOTHING, READING, WRITING, AccessRow, Network, Right

_WORDS: Final = {EVERYTHING: "read, write", READING: "read", WRITING: "write", NOTHING: "nothing"}


class RightsRow(NamedTuple):
    """From where, through which listeners, to which units clients may do what. `source` is its place in the config.

    `addresses` are those of a row for some only: `holding 0-99, 120; coils 3`. `priority` is `high`, or empty.
    """

    clients: str
    through: str
    units: str
    may: str
    source: str = ""
    addresses: str = ""
    priority: str = ""


def rows_in_words(plan: Plan) -> list[RightsRow]:
    """Say each row in words, of which the first that applies counts, and then what applies without one."""
    return [*(row_in_words(row, plan) for row in plan.access), *_rest(plan)]


def row_in_words(row: AccessRow, plan: Plan) -> RightsRow:
    """Say one row in words."""
    units = "all" if row.units is None else f"{show_units(row.units)} {own_numbers(row, plan)}".rstrip()
    right, addresses = right_in_words(row.right), addresses_in_words(row)
    priority = "" if row.priority == "normal" else row.priority
    return RightsRow(_clients(row), _through(row), units, right, row.source, addresses, priority)


def right_in_words(right: Right) -> str:
    """Say what a right allows: `read, write`, or the numbers of functions."""
    return _WORDS.get(right) or "functions " + show_units(each if isinstance(each, int) else each[0] for each in right)


def addresses_in_words(row: AccessRow) -> str:
    """Say which addresses a row is for; empty if it is for all."""
    return "; ".join(
        f"{area} {', '.join(span.addresses for span in spans)}" for area, spans in addresses_by_area(row).items()
    )


def addresses_by_area(row: AccessRow) -> Mapping[Area, list[Span]]:
    """Sort the addresses that a row is for by area; nothing if it is for all."""
    found: dict[Area, list[Span]] = {}
    for span in row.addresses or ():
        found.setdefault(span.area, []).append(span)
    return found


def own_numbers(row: AccessRow, plan: Plan) -> str:
    """Say where the units of a row for listeners of one line or upstream have these numbers; empty for others."""
    named = (listener for listener in plan.listeners if listener.only and listener.name in (row.listeners or ()))
    return " or ".join(sorted({"on the wire" if listener.line else "at the server" for listener in named}))


def unnamed(scheme: str, plan: Plan) -> list[str]:
    """List the listeners of this scheme that no row names: udp clients only read there, tls ones need a role."""
    return [one.name for one in plan.listeners if one.scheme == scheme and not _is_named(one.name, plan)]


def _clients(row: AccessRow) -> str:
    if row.sites:
        return f"site {', '.join(sorted(row.sites))}"
    if row.networks is None:
        place = "anywhere"
    else:
        place = "this machine" if row.networks == LOOPBACK else ", ".join(map(_network, row.networks))
    if row.role is None:
        return place
    return f'{place}, role "{row.role}"' if row.role else f"{place}, without a role"


def _network(network: Network) -> str:
    return str(network if network.num_addresses > 1 else network.network_address)


def _through(row: AccessRow) -> str:
    return "any listener" if row.listeners is None else ", ".join(sorted(row.listeners))


def _rest(plan: Plan) -> Iterator[RightsRow]:
    """Say the rights of clients that match no row."""
    if not any((row.networks, row.listeners, row.units, row.role, row.addresses) == (None,) * 5 for row in plan.access):
        yield RightsRow("all else", "", "", "nothing")
    for server in plan.servers:
        if not _is_named(server.line.name, plan):
            yield RightsRow("the line", server.line.name, show_units(server.line.serves), "read, write, broadcast")
    if not _is_named(CONTROL, plan):
        yield RightsRow("who may open it", CONTROL, "all", "read, write")
    if any(image.python for image in plan.images) and not _is_named(EMBEDDED, plan):
        yield RightsRow("units made in Python", EMBEDDED, "all", "read, write")
    for name, part in plan.add_ons.items():
        if not _is_named(name, plan):
            yield from (RightsRow(one.clients, name, one.units, one.may) for one in part.usual_rights)


def _is_named(listener: str, plan: Plan) -> bool:
    return any(listener in (row.listeners or ()) for row in plan.access)
