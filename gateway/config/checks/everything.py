"""Cross-checks between the tables of a config."""

from collections.abc import Callable, Hashable, Iterable, Iterator
from dataclasses import replace
from itertools import groupby, pairwise
from typing import Final

from gateway.config.checks.access import check_access
from gateway.config.checks.addresses import check_addresses
from gateway.config.checks.fleet import check_fleet
from gateway.config.checks.images import check_images
from gateway.config.checks.lease import check_lease
from gateway.config.checks.load import check_load
from gateway.config.checks.mqtt import check_mqtt, check_published
from gateway.config.checks.own_listeners import check_own_listeners
from gateway.config.checks.points import check_points
from gateway.config.checks.repeats import check_repeats
from gateway.config.checks.tls import check_tls
from gateway.config.checks.units import (
    check_asked,
    check_device_rows,
    check_numbers_as_names,
    check_overlaps,
    check_passing_through,
    check_references,
    client_lines,
)
from gateway.config.checks.upstreams import check_upstreams
from gateway.config.checks.web import check_web
from gateway.config.problem import Path, Problem, did_you_mean, dotted, error, warning
from gateway.config.reserved import RESERVED
from gateway.config.schema.profile import ProfileTable
from gateway.config.schema.root import Config, Device, Image, Line, Listen, Upstream
from gateway.config.schema.table import Table
from gateway.config.schema.web import Web
from gateway.config.values.address import DEFAULT_PORTS, Address
from gateway.config.values.character_format import fits_mode
from gateway.config.values.duration import show_duration
from gateway.images.self_image import NAME

#: Why the port at a path cannot be used, as far as can be seen without opening it; None if it can.
PortTrouble = Callable[[str], str | None]
#: Why a machine cannot listen at an address, as far as can be seen without binding it; None if it can.
AddressTrouble = Callable[[str], str | None]

#: The service may not bind lower ports: modbus-gateway.socket does.
_FIRST_FREE_PORT: Final = 1024
#: The limit of Linux: unix(7).
_LONGEST_SOCKET_PATH: Final = 107

#: Keys that exist for only one role of a line.
_CLIENT_KEYS: Final = (
    *("devices", "profile", "timeout", "turnaround", "late_window"),
    *("queue", "max_wait", "retries", "retry_within", "rest", "coalesce", "broadcast", "lease"),
)
_SERVER_KEYS: Final = ("serves", "on_failure", "answer_within", "broadcast_to")


def check(
    config: Config,
    failed: frozenset[str] = frozenset(),
    port_trouble: PortTrouble = lambda _: None,
    real_path: Callable[[str], str] = str,
    address_trouble: AddressTrouble = lambda _: None,
) -> Iterator[Problem]:
    """All conflicts between tables.

    `failed` are the sections with a table that is missing because it has errors: references that may mean it are not
    reported. `port_trouble` and `real_path` check ports, `address_trouble` checks addresses of listeners.
    """
    looked_at = (*_look_at_ports(config, port_trouble), *_look_at_addresses(config, address_trouble))
    found = [*_check_all(config, failed, real_path), *looked_at]
    yield from found
    if not failed and all(problem.severity == "warning" for problem in found):
        yield from check_repeats(config)
        yield from check_published(config)
        yield from check_load(config)
        yield from check_lease(config)


def _check_all(config: Config, failed: frozenset[str], real_path: Callable[[str], str]) -> Iterator[Problem]:
    yield from _check_content(config, failed)
    places = [*_check_binds(config, failed), *_check_ports(config, real_path)]
    yield from places
    yield from _check_ipv6(config)
    yield from _check_shared_ports(config)
    yield from _check_names(config, {problem.path[:-1] for problem in places})
    for line in config.line:
        yield from _check_device_server(line)
        yield from _check_format(line)
        yield from _check_role(line)
    yield from _check_control(config)
    yield from check_web(config)
    yield from check_mqtt(config)
    yield from check_fleet(config, failed)
    yield from check_tls(config)
    yield from _check_profiles(config, failed)
    yield from check_points(config, failed)
    yield from _check_spoken(config)
    yield from _check_timeouts(config)
    yield from check_access(config, failed)
    yield from check_device_rows(config)
    yield from check_overlaps(config)
    yield from check_numbers_as_names(config)
    yield from check_passing_through(config, failed)
    yield from check_own_listeners(config, failed)
    yield from check_asked(config, failed)
    yield from check_references(config, failed)
    yield from check_images(config, failed)
    yield from check_addresses(config)
    yield from check_upstreams(config, failed)


def _check_content(config: Config, failed: frozenset[str]) -> Iterator[Problem]:
    shown_by = (config.web, config.mqtt, config.fleet)
    if config.site and not any(shown_by) and failed.isdisjoint(("web", "mqtt", "fleet")):
        yield warning(("site",), "has no effect without [web], [mqtt] or [fleet]")
    if not (config.line or config.image or config.upstream or failed):
        yield error((), "there is no [[line]], and nothing else to serve", 'add [[line]] with port = "/dev/ttyUSB0"')


def _check_names(config: Config, misplaced: set[Path]) -> Iterator[Problem]:
    """Names are unique. A name made from a duplicate port or address is not reported again."""
    servers = [line for line in config.line if line.role == "server"]
    listeners: tuple[Listen | Line, ...] = (*config.listen, *servers)
    kept_open: tuple[Line | Upstream, ...] = (*config.line, *config.upstream)
    for listener in listeners:
        if listener.name in RESERVED:
            what = f'"{listener.name}" is what [[access]] calls {RESERVED[listener.name]}'
            yield error((*listener.path, "name"), what)
    for called in (listeners, kept_open):
        yield from _find_repeated("name", ((one.label, one) for one in called if one.name or one.path not in misplaced))
    yield from _find_repeated("lease", ((line.lease, line) for line in config.line if line.lease is not None))
    yield from _find_repeated("name", (*_generate_names(config).items(), *_list_names(config)))


def _generate_names(config: Config) -> dict[str, Table]:
    """The default names of units. Duplicates among them come from duplicate lines or units."""
    lines = client_lines(config)
    made: dict[str, Table] = {name: line for line in lines if line.devices is None for name in line.all_device_names}
    rows = [(line, row) for line in lines for row in line.devices or () if row.name is None]
    made |= {name: row for line, row in rows for name in line.device_names(row)}
    for upstream in config.upstream:
        made |= {name: row for row in upstream.rows for name in upstream.unit_names(row)}
        made |= dict.fromkeys(upstream.unnamed.values() if config.listeners_for(upstream) else (), upstream)
    return made


def _list_names(config: Config) -> Iterator[tuple[str, Table]]:
    for line in config.line:
        for row in line.devices or ():
            if row.name is not None:
                yield from ((name, row) for name in line.device_names(row))
    if config.own is not None:
        yield NAME, config.own
    yield from ((image.label, image) for image in config.image)


def _check_binds(config: Config, failed: frozenset[str]) -> Iterator[Problem]:
    for index, listen in enumerate(config.listen):
        first = next((one for one in config.listen[:index] if one.bind.collides_with(listen.bind)), None)
        if first is not None:
            yield _taken(listen, first.bind, f"in {first.source}")
    web = config.web
    if web is not None and "listen" not in failed:
        by_whom = "in {}" if config.listen else "by {}"
        for bind, source in (each for each in config.binds if _takes(each[0], web.bind, config)):
            yield _taken(web, bind, by_whom.format(source))


def _takes(bind: Address, web: Address, config: Config) -> bool:
    """Whether the page cannot listen, because a listener does at `bind`."""
    takes_ipv4 = not any(bind.takes_ipv4_of(other.bind) for other in config.listen)
    return bind.collides_with(web) or (takes_ipv4 and bind.takes_ipv4_of(web))


def _taken(later: Listen | Web, bind: Address, where: str) -> Problem:
    """The error for an address of which an earlier one at `bind` has a part."""
    covers = ""
    if bind.host != later.bind.host:
        covers = next((f"; {_covering(each)}" for each in (bind, later.bind) if _covering(each)), "")
        if bind.takes_ipv4_of(later.bind):
            covers = "; [::] takes IPv4 clients too"
    return error((*later.path, "bind"), f"this address is already used {where}{covers}")


def _covering(bind: Address) -> str:
    """What it includes beside the address that is written."""
    if bind.is_wildcard:
        return f"{bind.host} stands for every address of its kind"
    return "localhost stands for 127.0.0.1 and [::1]" if bind.host == "localhost" else ""


def _check_ipv6(config: Config) -> Iterator[Problem]:
    for listen in config.listen:
        ipv4 = next((other for other in config.listen if listen.bind.takes_ipv4_of(other.bind)), None)
        if ipv4 is not None and not ipv4.bind.is_wildcard:
            remedy = f'to serve every IPv4 address, write "{replace(ipv4.bind, host="0.0.0.0")}" in {ipv4.source}'  # noqa: S104 - advice
            what = f"takes IPv6 clients only, because {ipv4.source} has an IPv4 address with the same port"
            yield warning((*listen.path, "bind"), what, remedy)


def _check_shared_ports(config: Config) -> Iterator[Problem]:
    """The socket unit opens the lower ports, by default at every address: such a socket is for one listener."""
    for index, listen in enumerate(config.listen):
        first = next((other for other in config.listen[:index] if listen.bind.has_port_of(other.bind)), None)
        is_low = listen.bind.port < _FIRST_FREE_PORT
        if first is not None and is_low and not listen.bind.collides_with(first.bind):
            what = f"the service does not start with it and {first.source}, unless modbus-gateway.socket names both"
            remedy = 'its [::] takes clients of every address; for both see "Other addresses" in docs/operations.md'
            yield warning((*listen.path, "bind"), what, remedy)


def _check_ports(config: Config, real_path: Callable[[str], str]) -> Iterator[Problem]:
    yield from _find_repeated("port", ((_real(line, real_path), line) for line in config.line), "this port")


def _check_device_server(line: Line) -> Iterator[Problem]:
    """The address of a device server sets the mode, and the serial line behind it cannot be controlled."""
    if not isinstance(line.port, Address):
        return
    if line.has("mode") and line.mode != line.spoken:
        remedy = f'leave mode out, or write port = "{replace(line.port, scheme=f"{line.mode}+tcp")}"'
        yield error((*line.path, "mode"), f"{line.port.scheme}:// carries {line.spoken.upper()}", remedy)
    if line.port.port == DEFAULT_PORTS["tcp"]:
        what = f"port 502 is that of Modbus TCP, and {line.port.scheme}:// sends bare {line.spoken.upper()} frames"
        remedy = f'if the server speaks Modbus TCP: [[upstream]] with to = "{replace(line.port, scheme="tcp")}"'
        yield warning((*line.path, "port"), what, remedy)
    if line.rs485 == "kernel":
        remedy = 'set RS-485 in the device server, and leave rs485 out or "adapter"'
        yield error((*line.path, "rs485"), "a device server controls its own driver", remedy)


def _look_at_ports(config: Config, port_trouble: PortTrouble) -> Iterator[Problem]:
    for line in config.line:
        trouble = port_trouble(line.port) if isinstance(line.port, str) else None
        if trouble is not None:
            remedy = "the line waits for it; modbus-gateway ports lists those that exist"
            yield warning((*line.path, "port"), trouble, remedy)


def _look_at_addresses(config: Config, address_trouble: AddressTrouble) -> Iterator[Problem]:
    for each in _binding(config):
        is_always_there = each.bind.is_loopback and "%" not in each.bind.host
        trouble = None if is_always_there else address_trouble(each.bind.host)
        if trouble is not None:
            yield warning((*each.path, "bind"), trouble, "ip -brief address lists those that it has")


def _binding(config: Config) -> tuple[Listen | Web, ...]:
    return (*config.listen, *(() if config.web is None else (config.web,)))


def _check_format(line: Line) -> Iterator[Problem]:
    if line.format is None:
        return
    if not fits_mode(line.format, line.spoken):
        remedy = f'write "8{line.format.parity}{line.format.stop_bits}", or {_other_mode(line)}'
        yield error((*line.path, "format"), "RTU needs 8 data bits", remedy)
    if line.spoken == "ascii" and line.format.data_bits == 8 and line.format.parity != "N":
        remedy = 'most are set to "7E1", "7O1" or "8N1"'
        yield warning((*line.path, "format"), f"{line.format} is unusual for ASCII devices", remedy)


def _other_mode(line: Line) -> str:
    other = "rtu" if line.spoken == "ascii" else "ascii"
    return f"{other}+tcp:// in port" if isinstance(line.port, Address) else f'mode = "{other}"'


def _check_role(line: Line) -> Iterator[Problem]:
    foreign = _CLIENT_KEYS if line.role == "server" else _SERVER_KEYS
    for key in filter(line.has, foreign):
        other = "client" if line.role == "server" else "server"
        yield error((*line.path, key), f'only a line with role = "{other}" has this key')
    if line.role == "server" and line.serves is None:
        yield error(
            (*line.path, "serves"), "serves is missing", "name the units that the gateway answers for: serves = [41]"
        )


def _check_control(config: Config) -> Iterator[Problem]:
    if config.control is not None and len((config.control.socket or "").encode()) > _LONGEST_SOCKET_PATH:
        yield error((*config.control.path, "socket"), f"is longer than {_LONGEST_SOCKET_PATH} bytes")


def _check_profiles(config: Config, failed: frozenset[str]) -> Iterator[Problem]:
    for profile in config.profile.values():
        if profile.functions == ():
            yield error((*profile.path, "functions"), "is empty", "leave it out, and every function is accepted")
        yield from _check_timing(profile)
    if "profile" in failed:
        return
    rows = [row for line in config.line for row in line.devices or ()]
    tables: tuple[Line | Device | Image, ...] = (*config.line, *rows, *config.image)
    for table in tables:
        if table.profile is not None and table.profile not in config.profile:
            remedy = did_you_mean(table.profile, config.profile)
            yield error((*table.path, "profile"), f'there is no profile "{table.profile}"', remedy)


def _check_spoken(config: Config) -> Iterator[Problem]:
    """The mode of a line is one that its devices have."""
    for line in config.line:
        tables: tuple[Line | Device, ...] = (line, *(line.devices or ()))
        for table in tables:
            profile = config.profile.get(table.profile or "")
            if line.role == "client" and profile is not None and profile.mode not in (None, line.spoken):
                what = f"{profile.path[-1]} devices use {profile.mode.upper()}, but this line {line.spoken.upper()}"
                yield warning((*table.path, "profile"), what, f"set {_other_mode(line)} for the line")


def _check_timeouts(config: Config) -> Iterator[Problem]:
    """A device's time-out replaces the times of its profile, so it should not be below one of them."""
    for line in config.line:
        for row in line.devices or ():
            profile = config.profile.get(row.profile or line.profile or "")
            if row.timeout is None or profile is None:
                continue
            slowest = max(profile.timing, key=lambda point: point.time, default=None)
            if slowest is not None and row.timeout < slowest.time:
                what = (
                    f"is shorter than the {show_duration(slowest.time)} of {profile.path[-1]} for"
                    f" {slowest.items} items (function {slowest.fc})"
                )
                yield warning(
                    (*row.path, "timeout"), what, "leave timeout out: the profile has a time for each request"
                )


def _check_timing(profile: ProfileTable) -> Iterator[Problem]:
    rows = sorted(profile.timing, key=lambda row: (row.fc, row.items))
    for function, points in groupby(rows, key=lambda row: row.fc):
        for fewer, more in pairwise(points):
            if fewer.items == more.items:
                yield error((*more.path, "items"), f"function {function} already has a time for {more.items} items")
            elif more.time < fewer.time:
                what = f"function {function} takes less time for {more.items} items than for {fewer.items}"
                yield error((*more.path, "time"), what, "more items cannot take less time")


def _find_repeated(key: str, uses: Iterable[tuple[Hashable, Table]], what: str = '"{}"') -> Iterator[Problem]:
    """Tables that have the same value at `key` as an earlier table. `what` describes the value."""
    taken: dict[Hashable, Table] = {}
    for value, table in uses:
        first = taken.setdefault(value, table)
        if first is not table:
            place = f"{first.source}, {dotted(first.path)}" if isinstance(first, Device) else first.source
            yield error((*table.path, key), f"{what.format(value)} is already used in {place}")


def _real(line: Line, real_path: Callable[[str], str]) -> Hashable:
    return real_path(line.port) if isinstance(line.port, str) else (line.port.host.lower(), line.port.port)
