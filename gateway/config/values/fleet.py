"""What `[fleet]` names: the servers of NATS."""

from typing import Final

from gateway.config.problem import NotText, WrongValue
from gateway.config.values.address import Address, parse_address

#: Where NATS listens unless the address says otherwise.
NATS_PORT: Final = 4222
_SCHEMES: Final = ("nats", "tls")
_EXAMPLE: Final = '["nats://127.0.0.1:4222"]'


def parse_servers(value: object) -> tuple[Address, ...]:
    """Parse the addresses of NATS servers.

    Raises:
        WrongValue: one of them is not valid, or there are none.
    """
    if not isinstance(value, list) or not value:
        raise WrongValue("must be a list of servers", f"write it as {_EXAMPLE}")
    return tuple(map(parse_server, value))


def parse_server(value: object) -> Address:
    """Parse the address of a NATS server.

    Raises:
        WrongValue: it is not valid.
    """
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
