# pyserial-asyncio 0.6 has no types. Only what gateway/ports/serial_transport.py and serial_port.py use, private members
# included: it is pinned, and tests/ports/test_serial_asyncio.py fails when a version drops one of them.
import asyncio
from collections.abc import Callable

from serial import Serial

class SerialTransport(asyncio.Transport):
    _loop: asyncio.AbstractEventLoop
    _serial: Serial
    _closing: bool
    _has_reader: bool
    _read_ready: Callable[[], None]
    _write_buffer: list[bytes]
    def __init__(
        self, loop: asyncio.AbstractEventLoop, protocol: asyncio.BaseProtocol, serial_instance: Serial
    ) -> None: ...
    def _write_ready(self) -> None: ...
    def _remove_writer(self) -> None: ...
    def _close(self, exc: Exception | None = None) -> None: ...
    def _abort(self, exc: Exception | None) -> None: ...
    def _call_connection_lost(self, exc: Exception | None) -> None: ...
