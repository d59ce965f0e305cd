"""Gateways of other sites, by the names of their sites; and networks and addresses of clients, beside them."""

import re
from dataclasses import dataclass
from ipaddress import IPv4Network, IPv6Network, ip_interface, ip_network
from typing import Final

from gateway.config.problem import NotText, WrongValue
from gateway.config.values.address import Address, parse_address

_SITE = re.compile(r"[A-Za-z0-9_-]{1,64}")
#: What a site may be called: its name is a part of subjects and a key of buckets.
SITE_RULE: Final = "letters, digits, - and _ are allowed, at most 64"
_IPV4_MAPPED: Final = IPv6Network("::ffff:0:0/96")


@dataclass(frozen=True, slots=True)
class Site:
    """Another gateway of the fleet, by its site."""

    name: str
    scheme = "fleet"

    def __str__(self) -> str:
        return f"fleet://{self.name}"


def is_site(name: str) -> bool:
    """Tell whether a gateway of the fleet can have this site."""
    return _SITE.fullmatch(name) is not None


def parse_other_servers(value: object) -> tuple[Address | Site, ...]:
    """Parse the address of another Modbus TCP server, or several of the same one, or a gateway of the fleet."""
    several = value if isinstance(value, list) else [value]
    servers = tuple(map(_parse_other_server, several))
    if not servers:
        raise WrongValue("names no server", 'such as "tcp://10.1.0.5:502"')
    twice = next((server for index, server in enumerate(servers) if server in servers[:index]), None)
    if twice is not None:
        raise WrongValue(f"names {twice} twice")
    if len(servers) > 1 and any(isinstance(server, Site) for server in servers):
        raise WrongValue("a site has one address", "write each site as an upstream of its own")
    return servers


def _parse_other_server(value: object) -> Address | Site:
    if isinstance(value, str) and value.startswith("fleet://"):
        name = value.removeprefix("fleet://").removesuffix("/")
        if not is_site(name):
            raise WrongValue(f'"{name}" is not the name of a site', f"write fleet://SITE: {SITE_RULE}")
        return Site(name)
    return parse_address(value, ("tcp", "tls", "fleet"))


def parse_site(value: object) -> str:
    """Parse the name of a site."""
    if not isinstance(value, str):
        raise NotText
    if not is_site(value):
        raise WrongValue(f'"{value}" is not the name of a site', SITE_RULE)
    return value


def parse_lease_name(value: object) -> str:
    """Parse the name of a lease, which is a key of a bucket."""
    if not isinstance(value, str):
        raise NotText
    if not all(map(is_site, value.split("."))):
        raise WrongValue(f'"{value}" is not the name of a lease', f"{SITE_RULE} between two dots")
    return value


def parse_networks(value: object) -> tuple[IPv4Network | IPv6Network, ...]:
    """Parse networks such as "10.2.0.0/24", or single addresses."""
    return tuple(map(_network, _list(value)))


def parse_networks_or_sites(value: object) -> tuple[IPv4Network | IPv6Network | Site, ...]:
    """Parse networks, single addresses, or the names of sites."""
    return tuple(
        Site(each) if isinstance(each, str) and is_site(each) and not each.isdecimal() else _network(each)
        for each in _list(value)  # one of digits only is an address with its dots forgotten
    )


def _list(value: object) -> list[object]:
    if not isinstance(value, list):
        raise WrongValue("must be a list", 'write it as ["10.2.0.0/24"]')
    return value


def _network(text: object) -> IPv4Network | IPv6Network:
    if not isinstance(text, str):
        raise WrongValue(f"{text} is not a valid network", 'write it as "10.2.0.0/24"')
    try:
        interface = ip_interface(text)
    except ValueError as wrong:
        raise WrongValue(f'"{text}" is not a valid network', 'write it as "10.2.0.0/24" or "10.2.0.7"') from wrong
    network = interface.network
    if interface.ip != network.network_address:
        what = f'"{text}" is an address in the network {network}, and not that network'
        raise WrongValue(what, f'write "{network}" for all of it, or "{interface.ip}" for that address')
    return _plain_ipv4(network)


def _plain_ipv4(network: IPv4Network | IPv6Network) -> IPv4Network | IPv6Network:
    """Turn IPv4 networks that are written as IPv6 ones into IPv4: such clients of an IPv6 listener are IPv4 clients."""
    if network.version == 6 and network.prefixlen >= _IPV4_MAPPED.prefixlen and network.subnet_of(_IPV4_MAPPED):
        return ip_network((int(network.network_address) & 0xFFFFFFFF, network.prefixlen - _IPV4_MAPPED.prefixlen))
    return network
