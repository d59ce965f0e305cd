"""Cross-checks of listeners: their addresses, and those that are for one line or one upstream."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Final

from gateway.config.plan.reach import client_lines, monitor_lines
from gateway.config.problem import Path, Problem, did_you_mean, error, warning
from gateway.config.schema.config import Config
from gateway.config.schema.line import Line
from gateway.config.schema.listen import Listen
from gateway.config.schema.upstream import Upstream
from gateway.config.values.address import Address
from gateway.config.values.unitset import show_units
from gateway.modbus.codes import BROADCAST_UNIT, FIRST_UNIT, LAST_UNIT

#: The service may not bind lower ports: modbus-gateway.socket does.
_FIRST_FREE_PORT: Final = 1024


def check_binds(config: Config) -> Iterator[Problem]:
    """Find listeners that cannot listen, because an earlier one has their address."""
    for index, listen in enumerate(config.listen):
        first = next((one for one in config.listen[:index] if one.bind.collides_with(listen.bind)), None)
        if first is not None:
            yield taken((*listen.path, "bind"), listen.bind, first.bind, f"in {first.place}")


def taken(path: Path, bind: Address, earlier: Address, where: str) -> Problem:
    """Make the error for an address of which an earlier one, written `where`, has a part."""
    covers = ""
    if earlier.host != bind.host:
        covers = next((f"; {_covering(each)}" for each in (earlier, bind) if _covering(each)), "")
        if earlier.takes_ipv4_of(bind):
            covers = "; [::] takes IPv4 clients too"
    return error(path, f"this address is already used {where}{covers}")


def _covering(bind: Address) -> str:
    """Say what an address includes beside what is written; empty for a single address."""
    if bind.is_wildcard:
        return f"{bind.host} stands for every address of its kind"
    return "localhost stands for 127.0.0.1 and [::1]" if bind.host == "localhost" else ""


def check_ipv6(config: Config) -> Iterator[Problem]:
    """Find listeners at [::] that get no IPv4 clients, because another one has an IPv4 address."""
    for listen in config.listen:
        ipv4 = next((other for other in config.listen if listen.bind.takes_ipv4_of(other.bind)), None)
        if ipv4 is not None and not ipv4.bind.is_wildcard:
            remedy = f'to serve every IPv4 address, write "{replace(ipv4.bind, host="0.0.0.0")}" in {ipv4.place}'  # noqa: S104 - advice
            what = f"takes IPv6 clients only, because {ipv4.place} has an IPv4 address with the same port"
            yield warning((*listen.path, "bind"), what, remedy)


def check_shared_ports(config: Config) -> Iterator[Problem]:
    """Find listeners that need a socket of their own in the socket unit.

    That opens the lower ports, by default at every address: such a socket is for one listener.
    """
    for index, listen in enumerate(config.listen):
        first = next((other for other in config.listen[:index] if listen.bind.has_port_of(other.bind)), None)
        is_low = listen.bind.port < _FIRST_FREE_PORT
        if first is not None and is_low and not listen.bind.collides_with(first.bind):
            what = f"the service does not start with it and {first.place}, unless modbus-gateway.socket names both"
            remedy = 'its [::] takes clients of every address; for both see "Other addresses" in docs/service.md'
            yield warning((*listen.path, "bind"), what, remedy)


def check_own_listeners(config: Config, failed: frozenset[str]) -> Iterator[Problem]:
    """Find listeners for a line or an upstream that does not exist, or that their other keys do not fit."""
    lines = {line.label: line for line in client_lines(config)}
    known = {"line": [*lines], "upstream": [upstream.label for upstream in config.upstream]}
    for listen in config.listen:
        for key, name in (("line", listen.line), ("upstream", listen.upstream)):
            if name is not None and name not in known[key] and key not in failed:
                yield error((*listen.path, key), *_no_such(key, name, known, config))
        if listen.line in lines:
            yield from _check_reach(listen, lines[listen.line])
        yield from _check_keys(listen)


def numbers_on(part: Line | Upstream) -> frozenset[int]:
    """List what a listener for this part leads to: addresses on the wire of a line, units of a server."""
    if isinstance(part, Upstream):
        return frozenset(range(256))
    if part.devices is None:
        return frozenset(range(FIRST_UNIT, LAST_UNIT + 1))
    return frozenset(unit for row in part.devices for unit in row.units) - {BROADCAST_UNIT}


def _no_such(key: str, name: str, known: Mapping[str, list[str]], config: Config) -> tuple[str, str]:
    """Make the error and the remedy. `known` are the names of client lines and of upstreams."""
    other = next((each for each in known if name in known[each]), None)
    if other is not None:
        return f'there is no {key} "{name}"', f'write {other} = "{name}"'
    if any(line.label == name for line in monitor_lines(config)):
        return f'line "{name}" only listens: nobody can ask there', "put its values in a mirror, and ask that"
    if any(line.label == name for line in config.line):
        return f'line "{name}" is a server line', f"leave {key} out: every listener leads to the units that it serves"
    return f'there is no {key} "{name}"', did_you_mean(name, known[key])


def _check_keys(listen: Listen) -> Iterator[Problem]:
    leads_to = [key for key in ("line", "upstream", "site") if getattr(listen, key) is not None]
    if len(leads_to) > 1:
        remedy = "take one of them out, and write a [[listen]] for each"
        yield error((*listen.path, leads_to[-1]), f"cannot be combined with {leads_to[0]}", remedy)
    if listen.upstream is not None and listen.has("unit0"):
        what = "unit 0 is a unit of that server here, with a response"
        yield error((*listen.path, "unit0"), what, "take it out")


def _check_reach(listen: Listen, line: Line) -> Iterator[Problem]:
    addresses = numbers_on(line)
    if not addresses:
        what = f'no device of line "{line.label}" has an address, so nothing can be asked'
        yield error((*listen.path, "line"), what, "name its address as unit, or leave line out")
    elif isinstance(listen.unit0, int) and listen.unit0 not in addresses:
        what = f'{listen.unit0} is not an address on line "{line.label}"'
        yield error((*listen.path, "unit0"), what, f"its addresses: {show_units(addresses)}")
    if listen.unit0 == "broadcast" and not line.broadcast:
        yield warning((*listen.path, "unit0"), f'line "{line.label}" takes no broadcasts', "see its key broadcast")
