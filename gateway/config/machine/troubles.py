"""Checks a port without opening it, and an address of a listener without binding it."""

import errno
import os
import socket
import stat
from pathlib import Path
from typing import Final

from gateway.hardware.device_files import VIRTUAL_MAJORS, advise_on_permission, find_group
from gateway.ports.port import PortSettings, SerialSettings, Wire, resolve_wire

_OF_GROUP: Final = stat.S_IRGRP | stat.S_IWGRP


def port_trouble(path: str) -> str | None:
    """Say why this user cannot use the serial port at `path` at the moment; None if there is no reason."""
    try:
        mode = Path(path).stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return "there is no such port at the moment"
    except OSError as error:
        return f"cannot be checked: {error.strerror}"
    if not stat.S_ISCHR(mode):
        return "is not a serial port"
    if not os.access(path, os.R_OK | os.W_OK):
        return _why_not_permitted(path, mode)
    return None


def _why_not_permitted(path: str, mode: int) -> str:
    if find_group(path) == "dialout" and mode & _OF_GROUP == _OF_GROUP:  # as of the service, whose config this may be
        return "this user may not open it, the service may: it is in the group dialout"
    return f"this user may not open it: {advise_on_permission(path)}"


def predict_wire(wire: Wire, port: PortSettings) -> Wire:
    """Predict what `wire` will be on this port; `auto` while a serial port is not there."""
    is_virtual = True  # a device server carries bytes at once
    if isinstance(port, SerialSettings):
        try:
            is_virtual = os.major(Path(port.port).stat().st_rdev) in VIRTUAL_MAJORS
        except OSError:
            return wire
    return resolve_wire(wire, is_virtual=is_virtual)


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
