"""The kinds of port that a line can have."""

from functools import partial

from gateway.ports.port import OpenPort, PortSettings, TcpSettings
from gateway.ports.serial import open_blocking, open_serial
from gateway.ports.tcp import open_tcp

__all__ = ["open_blocking", "opener"]


def opener(settings: PortSettings) -> OpenPort:
    """The function that opens a port with these settings."""
    return partial(open_tcp, settings) if isinstance(settings, TcpSettings) else partial(open_serial, settings)
