"""Checks an address of a listener without binding it."""

import errno
import socket
from contextlib import suppress


def address_trouble(host: str) -> str | None:
    """What keeps this machine from listening at the IP address `host` now, or None. Names are not looked up."""
    with suppress(socket.gaierror):
        found = socket.getaddrinfo(host, 0, type=socket.SOCK_DGRAM, flags=socket.AI_NUMERICHOST)
        family, kind, _, _, address = found[0]
        try:
            with socket.socket(family, kind) as probe:
                probe.bind(address)
        except OSError as error:
            if error.errno in {errno.EADDRNOTAVAIL, errno.EAFNOSUPPORT, errno.ENODEV}:
                return f"this machine has no address {host} at the moment"
    return None
