"""Gateways of other sites, by the names of their sites."""

import re
from dataclasses import dataclass
from typing import Final

from gateway.config.problem import NotText, WrongValue
from gateway.config.values.address import Address, parse_address

_SITE = re.compile(r"[A-Za-z0-9_-]{1,64}")
#: What a site may be called: its name is a part of subjects and a key of buckets.
SITE_RULE: Final = "letters, digits, - and _ are allowed, at most 64"


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
