"""What `[fleet]` and the file of `fleet hub` name: the servers of NATS, sites and leases."""

from typing import Final

from gateway.config.problem import NotText, WrongValue
from gateway.config.values.address import Address, parse_address
from gateway.config.values.files import check_path
from gateway.config.values.site import parse_lease_name, parse_site

#: Where NATS listens unless the address says otherwise.
NATS_PORT: Final = 4222
_SCHEMES: Final = ("nats", "tls")
_EXAMPLE: Final = '["nats://127.0.0.1:4222"]'


def parse_servers(value: object) -> tuple[Address, ...]:
    """Parse the addresses of NATS servers."""
    if not isinstance(value, list) or not value:
        raise WrongValue("must be a list of servers", f"write it as {_EXAMPLE}")
    return tuple(map(parse_server, value))


def parse_server(value: object) -> Address:
    """Parse the address of a NATS server."""
    if not isinstance(value, str):
        raise NotText
    if "@" in value:
        what = "contains a user, which everybody who sees the config can see"
        raise WrongValue(what, "write user and password as keys of their own")
    scheme, mark, rest = value.partition("://")
    host, _, port = rest.rpartition(":")
    has_port = bool(host) and port.rstrip("/").isdecimal()
    address = value if has_port or not mark else f"{scheme}://{rest.removesuffix('/')}:{NATS_PORT}"
    return parse_address(address, _SCHEMES)


def parse_control(value: object) -> tuple[str, ...]:
    """Parse the site that may ask all others, or a list of several."""
    names = tuple(map(parse_site, value if isinstance(value, list) else [value]))
    if not names:
        raise WrongValue("names no site", 'such as control = "control"')
    return names


def parse_site_lease(value: object) -> str:
    """Parse a lease that belongs to a site: SITE.NAME."""
    name = parse_lease_name(value)
    if "." not in name:
        raise WrongValue(
            f'"{name}" does not say whose lease it is', f"write SITE.{name}, also in the config of the site"
        )
    return name


def parse_hub_address(value: object) -> Address:
    """Parse the host, and perhaps the port, of the hub."""
    if not isinstance(value, str):
        raise NotText
    if "://" in value:
        raise WrongValue("has a protocol", "write only HOST or HOST:PORT; with certificate and key it is tls://")
    address = parse_server(f"nats://{value}")
    if not address.port:
        raise WrongValue("port 0 is not the port of a server")
    return address


def parse_plain_path(value: object) -> str:
    """Parse the absolute path of a file or folder on another machine."""
    if not isinstance(value, str):
        raise NotText
    if not value.startswith("/"):
        raise WrongValue("is not an absolute path", "write it from / on, as it is on the machine that uses it")
    return check_path(value)
