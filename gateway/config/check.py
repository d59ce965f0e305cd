"""Checks the tables of a config against each other: what no single key can tell."""

from collections.abc import Callable, Iterator
from typing import Final

from gateway.config.add_ons import ADD_ONS
from gateway.config.checks.access import check_access
from gateway.config.checks.images import check_images, check_intervals
from gateway.config.checks.lines import check_lines
from gateway.config.checks.listeners import check_binds, check_ipv6, check_own_listeners, check_shared_ports
from gateway.config.checks.maps import check_planned_maps
from gateway.config.checks.points import check_points
from gateway.config.checks.profiles import check_profiles, check_profiles_of_devices
from gateway.config.checks.reference_numbers import check_addresses
from gateway.config.checks.times import check_load, check_retries
from gateway.config.checks.tls import check_tls
from gateway.config.checks.units import (
    check_asked,
    check_device_rows,
    check_names,
    check_numbers_as_names,
    check_overlaps,
    check_passing_through,
    check_ports,
    check_references,
)
from gateway.config.checks.upstreams import check_upstreams
from gateway.config.problem import Path, Problem, WrongValue, error, errors_in, warning
from gateway.config.resolve import Planning
from gateway.config.schema.config import Config
from gateway.config.values.address import Address

#: Why the port at a path cannot be used, as far as can be seen without opening it; None if it can.
PortTrouble = Callable[[str], str | None]
#: Why a machine cannot listen at an address, as far as can be seen without binding it; None if it can.
AddressTrouble = Callable[[str], str | None]
#: Why the class of a unit made in Python, `module:Name`, cannot be used; None if it can.
UnitTrouble = Callable[[str], WrongValue | None]

#: The limit of Linux: unix(7).
_LONGEST_SOCKET_PATH: Final = 107


def check(
    planning: Planning,
    failed: frozenset[str] = frozenset(),
    port_trouble: PortTrouble = lambda _: None,
    real_path: Callable[[str], str] = str,
    address_trouble: AddressTrouble = lambda _: None,
    unit_trouble: UnitTrouble = lambda _: None,
) -> Iterator[Problem]:
    """Find all conflicts between tables of the config that is being planned.

    `failed` are the sections with a table that is missing because it has errors: references that may mean it are not
    reported. `port_trouble` and `real_path` check ports, `address_trouble` checks addresses of listeners, and
    `unit_trouble` the classes of units made in Python.
    """
    config = planning.config
    found = [
        *_check_tables(config, failed, real_path),
        *_look_at_ports(config, port_trouble),
        *_look_at_addresses(config, address_trouble),
        *_look_at_units(config, unit_trouble),
    ]
    yield from found
    if failed or errors_in(found):
        return
    of_maps = [*check_planned_maps(planning.maps)]
    yield from of_maps
    if not errors_in(of_maps):
        yield from check_retries(config, planning.plan)
        yield from check_load(config, planning.plan)
        for add_on in ADD_ONS:
            yield from add_on.check_plan(config, planning.plan)


def _check_tables(config: Config, failed: frozenset[str], real_path: Callable[[str], str]) -> Iterator[Problem]:
    yield from _check_content(config, failed)
    places = [*check_binds(config), *check_ports(config, real_path)]
    yield from places
    yield from check_ipv6(config)
    yield from check_shared_ports(config)
    yield from check_names(config, {problem.path[:-1] for problem in places})
    yield from check_lines(config)
    yield from _check_control(config)
    for add_on in ADD_ONS:
        yield from add_on.check(config, failed)
    yield from check_tls(config)
    yield from check_profiles(config)
    yield from check_points(config, failed)
    yield from check_profiles_of_devices(config)
    yield from check_access(config, failed)
    yield from check_device_rows(config)
    yield from check_overlaps(config)
    yield from check_numbers_as_names(config)
    yield from check_passing_through(config, failed)
    yield from check_own_listeners(config, failed)
    yield from check_asked(config, failed)
    yield from check_references(config, failed)
    yield from check_images(config, failed)
    yield from check_intervals(config, failed)
    yield from check_addresses(config)
    yield from check_upstreams(config, failed)


def _check_content(config: Config, failed: frozenset[str]) -> Iterator[Problem]:
    is_shown = any(add_on.table(config) or add_on.key in failed for add_on in ADD_ONS)
    if config.site and not is_shown:
        *others, last = (f"[{add_on.key}]" for add_on in ADD_ONS)
        yield warning(("site",), f"has no effect without {', '.join(others)} or {last}")
    if not (config.line or config.image or config.upstream or failed):
        yield error((), "there is no [[line]], and nothing else to serve", 'add [[line]] with port = "/dev/ttyUSB0"')


def _check_control(config: Config) -> Iterator[Problem]:
    if config.control is not None and len((config.control.socket or "").encode()) > _LONGEST_SOCKET_PATH:
        yield error((*config.control.path, "socket"), f"is longer than {_LONGEST_SOCKET_PATH} bytes")


def _look_at_ports(config: Config, port_trouble: PortTrouble) -> Iterator[Problem]:
    for line in config.line:
        trouble = port_trouble(line.port) if isinstance(line.port, str) else None
        if trouble is not None:
            says_how = trouble.startswith("this user may not")
            remedy = "" if says_how else "the line waits for it; modbus-gateway ports lists those that exist"
            yield warning((*line.path, "port"), trouble, remedy)


def _look_at_addresses(config: Config, address_trouble: AddressTrouble) -> Iterator[Problem]:
    for path, bind in _binds(config):
        is_always_there = bind.is_loopback and "%" not in bind.host
        trouble = None if is_always_there else address_trouble(bind.host)
        if trouble is not None:
            yield warning((*path, "bind"), trouble, "ip -brief address lists those that it has")


def _look_at_units(config: Config, unit_trouble: UnitTrouble) -> Iterator[Problem]:
    for image in config.image:
        trouble = None if image.python is None else unit_trouble(image.python)
        if trouble is not None:
            yield error((*image.path, "python"), str(trouble), trouble.remedy)


def _binds(config: Config) -> Iterator[tuple[Path, Address]]:
    """Find each address where the gateway listens, with its table."""
    for table in (*config.listen, *(add_on.table(config) for add_on in ADD_ONS)):
        bind = getattr(table, "bind", None)
        if table is not None and bind is not None:
            yield table.path, bind
