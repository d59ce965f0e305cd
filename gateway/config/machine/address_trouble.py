"""Checks an address of a listener without binding it."""

import errno
import socket


def address_trouble(host: str) -> str | None:
    """Say what keeps this machine from listening at the IP address `host` now; None if nothing does, or for a name."""
    try:
        found = socket.getaddrinfo(host, 0, type=socket.SOCK_DGRAM, flags=socket.AI_NUMERICHOST)
    except socket.gaierror:
        interface = host.partition("%")[2]
        return f"this machine has no network interface {interface} at the moment" if interface else None
    family, kind, _, _, address = found[0]
    try:
        with socket.socket(family, kind) as probe:
            probe.bind(address)
    except OSError as error:
        if error.errno in {errno.EADDRNOTAVAIL, errno.EAFNOSUPPORT, errno.ENODEV}:
            return f"this machine has no address {host} at the moment"
    return None
