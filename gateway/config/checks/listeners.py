"""Cross-checks of the addresses where clients connect."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from gateway.config.problem import Path, Problem, error, warning
from gateway.config.schema.config import Config
from gateway.config.values.address import Address

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
