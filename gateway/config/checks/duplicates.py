"""Cross-checks of what may be used once only: names, leases and ports."""

from collections.abc import Callable, Hashable, Iterable, Iterator

from gateway.config.plan.names import Owner, all_device_names, device_names, owners, rows_of, unlisted_units
from gateway.config.plan.reach import client_lines, listeners_for
from gateway.config.problem import Path, Problem, dotted, error
from gateway.config.schema.config import Config
from gateway.config.schema.device import Device
from gateway.config.schema.line import Line
from gateway.config.schema.listen import Listen
from gateway.config.schema.table import Table
from gateway.config.values.port import VirtualPort
from gateway.config.values.reserved_names import RESERVED
from gateway.images.self_image import NAME


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
            place = f"{first.place}, {dotted(first.path)}" if isinstance(first, Device) else first.place
            remedy = 'give it another one: name = "..."' if getattr(table, key, "") is None else ""
            yield error((*table.path, key), f"{what.format(value)} is already used in {place}", remedy)
