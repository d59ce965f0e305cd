"""Cross-checks of access rights: rows that match no client, and the defaults without rows."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from gateway.config.checks.listeners import numbers_on
from gateway.config.checks.units import ONLY_HEARD, heard_units, not_configured, served_units
from gateway.config.plan.access import access_row, networks_of, sites_of
from gateway.config.plan.names import owners, rows_of
from gateway.config.plan.reach import all_listeners, client_lines, is_apart, only_part
from gateway.config.problem import Problem, did_you_mean, error, warning
from gateway.config.schema.access import Access
from gateway.config.schema.config import Config
from gateway.config.schema.line import Line
from gateway.config.schema.listen import Listen
from gateway.config.schema.upstream import Upstream
from gateway.config.values.reserved_names import RESERVED, WITHOUT_ADDRESSES
from gateway.config.values.site import Site
from gateway.config.values.unitset import show_units
from gateway.modbus.codes import BROADCAST_UNIT, FIRST_UNIT, HIGHEST_UNIT, LAST_UNIT, Area
from gateway.modbus.functions import only_reads
from gateway.profiles.profile import Range
from gateway.routing.access import LOOPBACK, Network
from gateway.routing.deciding import OF_AREA

_AREAS: Final = tuple(map(str, Area))
_FIRST_RIGHT: Final = (
    'allow = ["read", "write"]. Then add a last row allow = ["read"]: clients that match no row are refused'
)


def check_access(config: Config, failed: frozenset[str]) -> Iterator[Problem]:
    """Find rows that do not say what they allow, or cannot match, and say who may write. `failed` as in `check`."""
    if not config.access and "access" not in failed:
        yield from _defaults(config)
    if "access" not in failed:
        yield from _check_reads(config.access)
        yield from _check_refused(config)
    for listen in config.listen:
        yield from _check_reserve(listen, config, failed)
    for row in config.access:
        yield from _check_content(row)
        yield from _check_addresses(row)
        if not failed & {"listen", "line"}:
            yield from _check_listeners(row, config)
            yield from _check_networks(row, config)
        if not failed & {"listen", "line", "image", "upstream"}:
            yield from _check_units(row, config)
    yield from _check_order(config.access, _by_own_numbers(config))


def _defaults(config: Config) -> Iterator[Problem]:
    for listen in config.listen:
        row = ""
        if listen.bind.scheme == "tls":
            what = "TLS clients may only read without [[access]], whatever their roles"
            row = f'role = "operator", listen = ["{listen.label}"]'
        elif listen.bind.scheme == "udp":
            what = "UDP clients may only read without [[access]]: a datagram can name any address as its sender"
            row = f'listen = ["{listen.label}"]'
        elif not listen.bind.is_loopback:
            what = "clients from other machines may only read without [[access]]"
            row = f'from = ["10.2.0.0/24", {_this_machine(listen, config)}]'
        if row:
            remedy = f"to let them write, add [[access]] with {row} and {_FIRST_RIGHT}"
            yield warning((*listen.path, "bind"), what, remedy)


def _check_reads(rows: tuple[Access, ...]) -> Iterator[Problem]:
    """Warn if no row lets a client read, and some let it write. If no row allows anything, that is intended."""
    first = next((row for row in rows if row.allow or row.functions), None)
    reads = any(
        "read" in (row.allow or ()) or any(only_reads(bytes((number,))) for number in row.functions or ())
        for row in rows
    )
    if first is not None and not reads:
        key = "allow" if first.allow else "functions"
        what = "no row of [[access]] lets a client read: clients that match no row are refused"
        yield warning((*first.path, key), what, 'allow = ["read", "write"], or a last row allow = ["read"]')


def _check_refused(config: Config) -> Iterator[Problem]:
    """Warn of rows that all name `control`, `web` and the like: any row ends the defaults for every client."""
    rows = config.access
    is_for_nobody = all(row.listen and set(row.listen) <= set(RESERVED) for row in rows)
    if config.listen and is_for_nobody and any(row.allow for row in rows):
        what = "no row of [[access]] is for a [[listen]]: all clients that connect there are refused"
        yield warning((*rows[0].path, "listen"), what, 'add a last row allow = ["read"]')


def _check_reserve(listen: Listen, config: Config, failed: frozenset[str]) -> Iterator[Problem]:
    """Find listeners that reserve all their connections, or some that no client can use."""
    path = (*listen.path, "reserve")
    if listen.reserve >= listen.clients:
        remedy = f"make clients larger, or reserve less than {listen.clients}"
        yield error(path, "leaves no connection for clients that no row of [[access]] names", remedy)
    here = [row for row in config.access if row.listen is None or listen.label in row.listen]
    named = any(networks_of(row) and (row.allow or row.functions) for row in here)
    if listen.reserve and config.access and not named and "access" not in failed:
        remedy = 'name them in a row: from = ["10.2.0.7"]'
        what = "reserves connections, but no row of [[access]] gives an address any right"
        yield warning(path, what, remedy)


def _this_machine(listen: Listen, config: Config) -> str:
    """List the local addresses that can reach a listener, as a row names them."""
    networks = [own for own in LOOPBACK if not _explain_unreachable(listen, own, all_listeners(config))]
    return ", ".join(f'"{str(own).removesuffix("/128")}"' for own in networks)


def _check_content(row: Access) -> Iterator[Problem]:
    if (row.allow is None) == (row.functions is None):
        remedy = 'such as allow = ["read", "write"]; allow = [] refuses everything'
        yield error(row.path, "must have one of allow and functions", remedy)
    for key, value in (("from", row.networks), ("listen", row.listen)):
        if value == ():
            yield error((*row.path, key), "is empty, so the row matches no client", "leave it out to match all clients")


def _check_addresses(row: Access) -> Iterator[Problem]:
    """Find rows for addresses that allow no function that has such addresses."""
    named = _ranges(row)
    key, right = "allow" if row.allow else "functions", access_row(row).right
    if named and right and all(right.isdisjoint(OF_AREA[Area(area)]) for area in named):
        what = f"nothing of this is for {' or '.join(named)}, so the row refuses everything at its addresses"
        yield warning((*row.path, key), what, "write allow = [] if that is meant")


def _check_listeners(row: Access, config: Config) -> Iterator[Problem]:
    cables = [*(line.label for line in config.line if line.role == "server"), *WITHOUT_ADDRESSES]
    known = [*(listen.label for listen in all_listeners(config)), *cables, *RESERVED]
    for index, name in enumerate(row.listen or ()):
        path = (*row.path, "listen", index)
        if name not in known:
            yield error(path, f'there is no listener "{name}"', did_you_mean(name, known))
        elif name in cables and row.networks is not None:
            what = f'clients of "{name}" have no network, so a row with from never matches them'
            yield warning(path, what, "name it in a row of its own, without from")
    named = [name for name in row.listen or () if name in known]
    by_unit = [f'"{name}"' for name in named if name not in _by_own_numbers(config)]
    if 0 < len(by_unit) < len(named):
        there = " and ".join(by_unit)
        what = f"names listeners for one line or upstream, under its own numbers, and {there}, where units have others"
        yield error((*row.path, "listen"), what, "write a row for each kind")


def _check_networks(row: Access, config: Config) -> Iterator[Problem]:
    """Find networks from which no client can connect, as far as the addresses in the file tell."""
    listeners = all_listeners(config)
    meant = [listen for listen in listeners if row.listen is None or listen.label in row.listen]
    for index, network in enumerate(row.networks or ()):
        if isinstance(network, Site):
            continue
        reasons = [_explain_unreachable(listen, network, listeners) for listen in meant]
        if reasons and all(reasons):
            yield warning((*row.path, "from", index), f"no client can connect from {network}: {reasons[0]}")


def _explain_unreachable(listen: Listen, network: Network, everyone: Iterable[Listen]) -> str:
    """Say why no client from `network` can connect to a listener; empty if one can."""
    bind, version = listen.bind, listen.bind.ip_version
    if bind.is_loopback and not any(overlap(network, own) for own in LOOPBACK):
        return f"{listen.label} is for programs on this machine ({bind})"
    takes_both = bind.is_wildcard and not any(bind.takes_ipv4_of(other.bind) for other in everyone)
    if version == network.version or version is None or (version == 6 and takes_both):
        return ""
    return f"{listen.label} takes IPv{version} clients only ({bind})"


def _by_own_numbers(config: Config) -> frozenset[str]:
    """Name the listeners for one line or upstream."""
    return frozenset(listen.label for listen in config.listen if only_part(listen) is not None)


def _check_units(row: Access, config: Config) -> Iterator[Problem]:
    if row.units == "all":
        return
    path, answered = (*row.path, "units"), _answered(row, config)
    if BROADCAST_UNIT in row.units and BROADCAST_UNIT not in answered:
        yield error(path, f"unit {BROADCAST_UNIT} is outside {FIRST_UNIT}-{HIGHEST_UNIT}")
    elif row.listen is None and (nameless := _without_numbers(config) & set(row.units) - answered):
        what = f"devices at {show_units(nameless)} have no unit ID for clients, so the row does not count for them"
        yield warning(path, what, "write a row with listen for each line or upstream; units are its own there")
    elif heard_units(config).issuperset(row.units) and (row.allow or row.functions):
        yield warning(path, ONLY_HEARD.format(show_units(row.units)), "give the right to a mirror of it")
    elif not answered & set(row.units):
        remedy = ""
        if not _by_own_numbers(config).isdisjoint(row.listen or ()):
            remedy = f"through a listener for one line, units are addresses on its wire: {show_units(answered)}"
        yield warning(path, f"{not_configured(row.units)}, so the row never matches", remedy)


def _without_numbers(config: Config) -> frozenset[int]:
    """Find where devices are that have no unit ID for clients."""
    rows = (row for owner in owners(config) for row in rows_of(owner) if not row.client_units)
    return frozenset(unit for row in rows for unit in row.units)


def _answered(row: Access, config: Config) -> frozenset[int]:
    """Find the unit IDs that a row can match: those of the line or server if it names listeners for one."""
    named = {only_part(listen) for listen in config.listen if listen.label in (row.listen or ())} - {None}
    if named:
        parts: tuple[Line | Upstream, ...] = (*client_lines(config), *config.upstream)
        return frozenset().union(*(numbers_on(part) for part in parts if part.label in named))
    apart = any(is_apart(line, config) for line in client_lines(config)) and row.listen is None
    return served_units(config) | (frozenset(range(FIRST_UNIT, LAST_UNIT + 1)) if apart else frozenset())


def _check_order(rows: Sequence[Access], by_own_numbers: frozenset[str]) -> Iterator[Problem]:
    """Find rows that never match, because an earlier one matches all that they would: the first match wins.

    A row is compared only with rows that name its first client: thousands of rows are one for each client.
    """
    #: The earlier rows that name a client, in their order; with None those for all clients.
    naming: dict[Network | Site | None, list[int]] = {}
    for index, row in enumerate(rows):
        by_own = not by_own_numbers.isdisjoint(row.listen or ())
        covering = (
            next((one for one in naming.get(client, ()) if _covers(rows[one], row, by_own_numbers=by_own)), None)
            for client in (None, *_around_first_client(row))
        )
        first = min((one for one in covering if one is not None), default=None)
        if first is not None:
            what = f"never matches, because the row in {rows[first].place} matches all that it would match"
            yield warning(row.path, what, "first match wins: put the special row before the general one")
        for client in (None,) if row.networks is None else row.networks:
            naming.setdefault(client, []).append(index)


def _around_first_client(row: Access) -> Iterator[Network | Site]:
    """Find what contains the first client of a row: the site itself, or every network around it."""
    for client in (row.networks or ())[:1]:
        if isinstance(client, Site):
            yield client
        else:
            yield from (client.supernet(new_prefix=length) for length in range(client.prefixlen + 1))


def _covers(earlier: Access, row: Access, *, by_own_numbers: bool) -> bool:
    """Tell whether `earlier` matches all that `row` does, which may count units `by_own_numbers`."""
    if by_own_numbers and earlier.units != "all" and earlier.listen is None:
        return False
    listeners = earlier.listen is None or (row.listen is not None and set(row.listen) <= set(earlier.listen))
    units = earlier.units == "all" or (row.units != "all" and set(row.units) <= set(earlier.units))
    # without a role and a listener, it does not count for clients with certificates
    roles = earlier.role == row.role or (earlier.role is None and earlier.listen is not None)
    return roles and listeners and units and _covers_addresses(earlier, row) and _covers_clients(earlier, row)


def _covers_addresses(earlier: Access, row: Access) -> bool:
    covering, covered = _ranges(earlier), _ranges(row)
    if not covering or not covered:
        return not covering
    return all(
        any(first <= start and end <= last for first, last in covering.get(area, ()))
        for area, ranges in covered.items()
        for start, end in ranges
    )


def _ranges(row: Access) -> dict[str, tuple[Range, ...]]:
    """Find the addresses that a row names, by area; nothing if it is for all."""
    return {area: ranges for area in _AREAS if (ranges := getattr(row, area)) is not None}


def _covers_clients(earlier: Access, row: Access) -> bool:
    if earlier.networks is None:
        return True
    if row.networks is None or not set(sites_of(row)) <= set(sites_of(earlier)):
        return False
    return all(
        any(overlap(big, small) and big.prefixlen <= small.prefixlen for big in networks_of(earlier))
        for small in networks_of(row)
    )


def overlap(one: Network, other: Network) -> bool:
    """Tell whether some address is in both networks."""
    return one.version == other.version and one.overlaps(other)
