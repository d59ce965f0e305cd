"""The kinds of port that a line can have."""

from functools import partial

from gateway.ports.port import OpenPort, PortSettings, TcpSettings
from gateway.ports.serial import open_blocking, open_serial
from gateway.ports.tcp import open_tcp
from gateway.tls.store import TlsStore

__all__ = ["open_blocking", "opener"]


def opener(settings: PortSettings, store: TlsStore | None = None) -> OpenPort:
    """The function that opens a port with these settings. One with TLS has its context from `store`."""
    if not isinstance(settings, TcpSettings):
        return partial(open_serial, settings)
    tls = settings.tls
    if tls is None or store is None:
        return partial(open_tcp, settings)
    return lambda user: open_tcp(settings, user, store[tls].context)
