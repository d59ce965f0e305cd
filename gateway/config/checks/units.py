"""Cross-checks of the units and their destinations, and of what may be used once only: names, leases and ports."""

from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import repeat
from typing import Final

from gateway.config.plan.lines import ASKED_AT_ZERO
from gateway.config.plan.names import Owner, all_device_names, device_names, owners, rows_of, unlisted_units
from gateway.config.plan.reach import (
    client_lines,
    is_apart,
    leads_everywhere,
    listeners_for,
    monitor_lines,
    only_part,
    passing_units,
)
from gateway.config.problem import Path, Problem, dotted, error, warning
from gateway.config.schema.config import Config
from gateway.config.schema.device import Device
from gateway.config.schema.line import Line
from gateway.config.schema.listen import Listen
from gateway.config.schema.profile import ProfileTable
from gateway.config.schema.table import Table
from gateway.config.schema.upstream import Upstream
from gateway.config.values.port import VirtualPort
from gateway.config.values.reserved_names import RESERVED
from gateway.config.values.unitset import show_units
from gateway.images.self_image import NAME
from gateway.modbus.codes import BROADCAST_UNIT, FIRST_UNIT, HIGHEST_UNIT, LAST_UNIT


@dataclass(frozen=True, slots=True)
class Claim:
    """A table that answers for `units`; `path` and `source` are its place in the file."""

    units: tuple[int, ...]
    owner: str
    path: Path
    source: str
    remedy: str = ""
    #: The names of the units, in their order.
    names: tuple[str, ...] = ()
    #: What else may be done, if the other claim is that of another table.
    or_none: str = ""


#: What is wrong where a client is led to a device that only others ask.
ONLY_HEARD: Final = "unit {} is on a line that only listens: every request is answered with 0A"
#: So many devices are named in an advice.
_MOST_TOLD: Final = 5


def profile_of_row(config: Config, owner: Owner, row: Device) -> ProfileTable | None:
    """Find the profile of a row; None if it does not exist.

    At address 0 of a line, only holding registers can be read.
    """
    profile = config.profile.get(row.profile or owner.profile)
    if profile is not None and BROADCAST_UNIT in row.units and isinstance(owner, Line):
        return profile.model_copy(update={"functions": tuple(ASKED_AT_ZERO)})
    return profile


def claims(config: Config) -> Iterator[Claim]:
    """Collect the claims of all tables except pass-through lines, which get the remaining units."""
    remedy = 'give one of them another unit ID for clients with "as"'
    for part in owners(config):
        or_none = _without_units(part, config)
        owner = f'of {"line" if isinstance(part, Line) else "upstream"} "{part.label}"'
        for row in rows_of(part):
            path = (*row.path, "unit" if row.known_as is None else "as")
            yield Claim(row.client_units, owner, path, row.place, remedy, tuple(device_names(part, row)), or_none)
    for image in config.image:
        owner = f'of image "{image.label}"'
        yield Claim((image.unit,), owner, (*image.path, "unit"), image.place, names=(image.label,))
    if config.own is not None:
        yield Claim((config.own.unit,), "of the gateway itself", (*config.own.path, "unit"), config.own.place)


def _without_units(part: Owner, config: Config) -> str:
    """Say how the devices of a line or upstream do without unit IDs for clients."""
    kind = "line" if isinstance(part, Line) else "upstream"
    if listeners_for(part, config):
        return f', or as = "none": the listener for the {kind} leads to it, and its name'
    return f', or as = "none" and the {kind} a listener of its own: [[listen]] with {kind} = "{part.label}"'


def not_configured(units: Iterable[int]) -> str:
    """Say that these units are not in the config."""
    text = show_units(units)
    return f"unit {text} is not configured" if text.isdecimal() else f"units {text} are not configured"


def heard_units(config: Config) -> frozenset[int]:
    """Find the unit IDs of devices that only others ask."""
    rows = (row for line in monitor_lines(config) for row in rows_of(line))
    return frozenset(unit for row in rows for unit in row.client_units)


def served_units(config: Config) -> frozenset[int]:
    """Find all units that have a destination."""
    units = frozenset(unit for claim in claims(config) for unit in claim.units)
    if any(line.devices is None and not is_apart(line, config) for line in client_lines(config)):
        return units.union(range(FIRST_UNIT, LAST_UNIT + 1))
    return units


def check_overlaps(config: Config) -> Iterator[Problem]:
    """Find units with more than one destination: one error for all that two tables have in common."""
    owners: dict[int, Claim] = {}
    taken: dict[tuple[str, str], list[tuple[int, Claim, Claim]]] = {}
    for claim in claims(config):
        for unit in claim.units:
            first = owners.setdefault(unit, claim)
            if first is not claim:
                taken.setdefault((claim.owner, first.owner), []).append((unit, claim, first))
    for found in taken.values():
        units, (_, claim, first) = {unit for unit, *_ in found}, found[0]
        verb = "is already a unit" if len(units) == 1 else "are already units"
        remedy = claim.remedy + (claim.or_none if first.owner != claim.owner else "")
        yield error(claim.path, f"{show_units(units)} {verb} {first.owner} ({first.source})", remedy)


def check_numbers_as_names(config: Config) -> Iterator[Problem]:
    """Find units that are called by the number of another one: digits mean a number."""
    for claim in claims(config):
        for unit, name in zip(claim.units or repeat(None), claim.names, strict=False):
            if name.isdecimal() and int(name) != unit:
                this = "this device has none" if unit is None else f"this is unit {unit}"
                what = f'"{name}" is a number, and means unit {name}; {this}'
                yield error((*claim.path[:-1], "name"), what, f'add a letter, such as "unit-{name}"')


def check_passing_through(config: Config, failed: frozenset[str]) -> Iterator[Problem]:
    """Find lines without devices that are not alone: they take all units. `failed` as in `check`."""
    lines = client_lines(config)
    together = [line for line in lines if not is_apart(line, config)]
    for line in together:
        is_beside_others = len(together) > 1 or (len(lines) > 1 and not _is_asked(line, config))
        if line.devices is None and is_beside_others and "listen" not in failed:
            yield error(
                line.path,
                "has no devices, but is not the only client line: it is unknown which units are on it",
                "name its devices, such as devices = [{ unit = 1 }], or give it its own [[listen]] with "
                f'line = "{line.label}"',
            )
        if line.devices is None and not (passing_units(config) or listeners_for(line, config)):
            yield error(line.path, "has no devices, and no unit is left to pass through", "take it out")
        if line.devices == ():
            yield error((*line.path, "devices"), "is empty", "leave it out, and every unit 1-247 passes through")


def check_asked(config: Config, failed: frozenset[str]) -> Iterator[Problem]:
    """Find units that no client can reach, if every listener is for one line or upstream. `failed` as in `check`.

    Server lines lead to units too, and so do mirrors and virtual units.
    """
    if leads_everywhere(config) or failed & {"listen", "line", "image"}:
        return
    served, polled_names = _served_to_outside_clients(config), _polled(config)
    own = {part.path for part in owners(config) if listeners_for(part, config)}
    for claim in claims(config):
        polled = {unit for unit, name in zip(claim.units, claim.names, strict=False) if name in polled_names}
        unasked = set(claim.units) - served - polled
        if unasked and claim.path[:2] not in own:
            what = f"no listener leads to {show_units(unasked)}: each is for one line or upstream"
            yield warning(claim.path, what, "add a [[listen]] without line and upstream")


def check_device_rows(config: Config) -> Iterator[Problem]:
    """Find rows of devices that are ambiguous."""
    for owner in owners(config):
        for row in rows_of(owner):
            yield from _check_row(row, owner)
        yield from _check_wire_units(owner)
    for line in client_lines(config):
        yield from _check_reserved(line)
        yield from _check_lone_device(line)


def check_references(config: Config, failed: frozenset[str]) -> Iterator[Problem]:
    """Find units that other tables name and that do not exist. If a table that may have them `failed`, find none."""
    if failed & {"line", "image", "upstream"}:
        return
    served = served_units(config)
    for listen in config.listen:
        if only_part(listen) is None and isinstance(listen.unit0, int) and listen.unit0 not in served:
            yield error((*listen.path, "unit0"), not_configured({listen.unit0}), _called(config, {listen.unit0}))
    for line in config.line:
        unknown = line.named_units - served
        if unknown:
            yield error((*line.path, "serves"), not_configured(unknown), _called(config, unknown))
        heard = heard_units(config).intersection(line.named_units)
        if heard:
            yield warning((*line.path, "serves"), ONLY_HEARD.format(show_units(heard)), "serve a mirror of it")


def _called(config: Config, addresses: Collection[int]) -> str:
    """Say which unit IDs clients use for the devices at these addresses, if these are what was meant."""
    rows = [row for line in client_lines(config) for row in line.devices or ()]
    found = [
        f"{unit} is at address {at}"
        for row in rows
        for at, unit in zip(row.units, row.client_units, strict=False)
        if at in addresses and at != unit
    ]
    return f"use the unit IDs for clients: {', '.join(found[:_MOST_TOLD])}" if found else ""


def _is_asked(line: Line, config: Config) -> bool:
    """Tell whether any client can reach a line without devices that has no listener of its own."""
    units = _served_to_outside_clients(config).intersection(passing_units(config))
    return leads_everywhere(config) or bool(units) or not _polled(config).isdisjoint(all_device_names(line))


def _served_to_outside_clients(config: Config) -> frozenset[int]:
    return frozenset(unit for line in config.line for unit in line.named_units)


def _polled(config: Config) -> frozenset[str]:
    """Name the devices that have a mirror, or are in a virtual unit."""
    names = {image.of for image in config.image} | {row.device for image in config.image for row in image.map}
    return frozenset(name for name in names if name is not None)


def _check_row(row: Device, owner: Owner) -> Iterator[Problem]:
    if row.client_units and len(row.client_units) != len(row.units):
        yield error(
            (*row.path, "as"),
            f"names {len(row.client_units)} units for clients, but there are {len(row.units)} {_where(owner)}",
            f'as many as in unit = "{show_units(row.units)}" are needed',
        )
    if len(row.units) > 1 and row.name is not None and "*" not in row.name:
        becomes = "that clients use" if row.client_units else _where(owner)
        remedy = f'write "{row.name}-*": * becomes the unit {becomes}'
        yield error((*row.path, "name"), f"{len(row.units)} devices cannot have one name", remedy)
    if 0 in row.client_units:
        what = "unit 0 stands for every device" if isinstance(owner, Line) else "clients cannot ask for unit 0"
        remedy = "name the unit that clients use: as = 50" if len(row.units) == 1 else "name the units that clients use"
        if isinstance(owner, Upstream):
            remedy += '; or write as = "none": then only a [[listen]] with upstream leads to it, as unit 0'
        yield error((*row.path, "unit"), what, remedy)


def _where(owner: Owner) -> str:
    """Say where a device has its unit."""
    return "on the wire" if isinstance(owner, Line) else "behind the server"


def _check_wire_units(owner: Owner) -> Iterator[Problem]:
    asked_as: dict[int, int | str] = {}
    for row in rows_of(owner):
        known: Sequence[int | str] = row.client_units or device_names(owner, row)
        for unit, known_as in zip(row.units, known, strict=False):
            first = asked_as.setdefault(unit, known_as)
            if first != known_as:
                has = f"has the unit ID {first} for clients" if isinstance(first, int) else f"is {first}"
                yield warning((*row.path, "unit"), f"unit {unit} {_where(owner)} already {has}")


def _check_reserved(line: Line) -> Iterator[Problem]:
    for row in line.devices or ():
        reserved = [unit for unit in row.units if unit > LAST_UNIT]
        if reserved:
            what = f"unit {show_units(reserved)}: the specification reserves {LAST_UNIT + 1}-{HIGHEST_UNIT}"
            yield warning((*row.path, "unit"), what, "right if the device is set to it; others are 1-247")


def _check_lone_device(line: Line) -> Iterator[Problem]:
    rows = line.devices or ()
    for row in rows:
        if BROADCAST_UNIT in row.units and (len(rows) > 1 or len(row.units) > 1):
            yield warning(
                (*row.path, "unit"),
                "any device on the line may answer unit 0, and the line has several",
                "it must be the only device of its line",
            )


def check_names(config: Config, misplaced: set[Path]) -> Iterator[Problem]:
    """Find names that are used twice, or are reserved. `misplaced` are tables whose port or address is used twice."""
    servers = [line for line in config.line if line.role == "server"]
    listeners: tuple[Listen | Line, ...] = (*config.listen, *servers)
    kept_open: tuple[Owner, ...] = (*config.line, *config.upstream)
    for listener in listeners:
        if listener.name is not None and listener.name in RESERVED:
            what = f'"{listener.name}" is what [[access]] calls {RESERVED[listener.name]}'
            yield error((*listener.path, "name"), what)
    for called in (listeners, kept_open):
        yield from _find_repeated("name", ((one.label, one) for one in called if one.name or one.path not in misplaced))
    yield from _find_repeated("lease", ((line.lease, line) for line in config.line if line.lease is not None))
    yield from _find_repeated("name", (*_generate_names(config).items(), *_list_names(config)))


def _generate_names(config: Config) -> dict[str, Table]:
    """Make the default names of units. Duplicates among them come from duplicate lines or units."""
    lines = client_lines(config)
    made: dict[str, Table] = {name: line for line in lines if line.devices is None for name in all_device_names(line)}
    rows = [(owner, row) for owner in owners(config) for row in rows_of(owner) if row.name is None and row.client_units]
    made |= {name: row for owner, row in rows for name in device_names(owner, row)}
    for upstream in config.upstream:
        made |= dict.fromkeys(unlisted_units(upstream).values() if listeners_for(upstream, config) else (), upstream)
    return made


def _list_names(config: Config) -> Iterator[tuple[str, Table]]:
    """List the names in the file, and those of devices without units: their numbers may be those of others too."""
    known = set[str]()
    for owner in owners(config):
        for row in rows_of(owner):
            if row.name is not None or (not row.client_units and owner.label not in known):
                yield from ((name, row) for name in device_names(owner, row))
        known.add(owner.label)
    if config.own is not None:
        yield NAME, config.own
    yield from ((image.label, image) for image in config.image)


def check_ports(config: Config, real_path: Callable[[str], str]) -> Iterator[Problem]:
    """Find lines that have the port of an earlier one."""
    yield from _find_repeated("port", ((_real(line, real_path), line) for line in config.line), "this port")


def _real(line: Line, real_path: Callable[[str], str]) -> Hashable:
    port = line.port
    if isinstance(port, VirtualPort):
        return real_path(port.name) if port.name.startswith("/") else port
    return real_path(port) if isinstance(port, str) else (port.host.lower(), port.port)


def _find_repeated(key: str, uses: Iterable[tuple[Hashable, Table]], what: str = '"{}"') -> Iterator[Problem]:
    """Find tables that have the same value at `key` as an earlier table. `what` describes the value."""
    taken: dict[Hashable, Table] = {}
    for value, table in uses:
        first = taken.setdefault(value, table)
        if first is not table:
            place = f"{first.place}, {dotted(first.path[2:])}" if isinstance(first, Device) else first.place
            remedy = 'give it another one: name = "..."' if getattr(table, key, "") is None else ""
            yield error((*table.path, key), f"{what.format(value)} is already used in {place}", remedy)
