"""The addresses that count as one: with IPv6 a customer's network, unless it is on a link of this machine.

A remote host with an IPv6 address usually has all of its /64 and can connect from any address in it. On a link of this
machine, each address may be another machine.
"""

from collections.abc import Callable, Iterator
from contextlib import suppress
from ipaddress import IPv6Address, IPv6Network
from math import inf
from pathlib import Path
from typing import Final

#: The routes of this process, one per line, and the most characters that are read.
ROUTES: Final = "/proc/self/net/ipv6_route"
MOST_READ: Final = 64 * 1024
#: They are read again after this many seconds.
KEPT: Final = 10.0

#: The smallest network of a customer, and the largest site (RFC 6177): a larger one without a router is a tunnel.
_CUSTOMER: Final = 64
_SITE: Final = 48
#: The flag of a route through a router, RTF_GATEWAY; and an interface that is not a link.
_ROUTER: Final = 0x2
_LOOPBACK: Final = "lo"


def read_routes() -> str:
    """Read the beginning of ROUTES; return an empty text without IPv6."""
    with suppress(OSError), Path(ROUTES).open(encoding="ascii") as file:
        return file.read(MOST_READ)
    return ""


class ShareKeys:
    """The share keys of clients. `read` returns the content of ROUTES."""

    def __init__(self, read: Callable[[], str] = read_routes) -> None:
        self._read = read
        self._links: tuple[IPv6Network, ...] = ()
        self._read_at = -inf

    def of(self, host: str, now: float) -> str:
        """Return the share key of a client from `host`, at `now`: `10.0.0.7`, `2001:db8:1:2::/64`."""
        if ":" not in host:
            return host
        if now - self._read_at >= KEPT:
            self._links, self._read_at = tuple(_parse_links(self._read())), now
        address = IPv6Address(host)
        if address.is_loopback or any(address in link for link in self._links):
            return host
        return str(IPv6Network((int(address), _CUSTOMER), strict=False))


def _parse_links(routes: str) -> Iterator[IPv6Network]:
    """Yield the networks that are reached without a router."""
    for line in routes.splitlines():
        fields = line.split()
        if len(fields) == 10 and fields[9] != _LOOPBACK and not int(fields[8], 16) & _ROUTER:
            network = IPv6Network((int(fields[0], 16), int(fields[1], 16)), strict=False)
            if network.prefixlen >= _SITE:
                yield network
