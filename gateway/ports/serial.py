"""Opens serial ports with pyserial.

A module for another library must pass tests/system/test_serial_contract.py. See docs/adr/0015-serial-transport.md.
"""

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager

from serial import PARITY_NONE, Serial

from gateway.clock.threads import ThreadPerCall
from gateway.errors import PortError
from gateway.hardware.ioctls import set_input_flags
from gateway.ports.opening import OpenDevice, close_device, open_device
from gateway.ports.port import Port, PortUser, SerialSettings
from gateway.ports.serial_port import SerialPort
from gateway.timing.characters import CharacterFormat

#: Ports whose driver is still opening them, perhaps after the attempt was cancelled.
_being_opened: set[str] = set()


class ConfiguredOnce(Serial):
    """pyserial's port, which is configured only when it is opened.

    pyserial configures a port whenever a setting is assigned, and pyserial-asyncio assigns two in the event loop, where
    a USB adapter that hangs would stop everything for seconds. It also leaves parity unchecked; this corrects it.
    """

    def _reconfigure_port(self, force_update: bool = False) -> None:  # noqa: FBT001, FBT002 - pyserial's signature
        if force_update and self.fd is not None:
            super()._reconfigure_port(force_update=True)  # type: ignore[misc]  # private, so not in the stubs
            set_input_flags(self.fd, checks_parity=self.checks_parity)

    @property
    def checks_parity(self) -> bool:
        """Whether characters have a parity bit."""
        return bool(self.parity != PARITY_NONE)

    def change_baud(self, baud: int) -> None:
        """Change the rate."""
        self.baudrate = baud
        self._reconfigure_port(force_update=True)


def configured(settings: SerialSettings, format_: CharacterFormat) -> ConfiguredOnce:
    """Open, lock and configure a port; may block as long as its driver takes. Raises what pyserial raises."""
    return ConfiguredOnce(
        port=settings.port,
        baudrate=settings.baud,
        bytesize=format_.data_bits,
        parity=format_.parity,
        stopbits=format_.stop_bits,
        exclusive=True,
        # VMIN 1, VTIME 0: reading an idle port fails with EAGAIN; only a port that hung up returns end of file.
        inter_byte_timeout=0,
    )


async def open_serial(settings: SerialSettings, user: PortUser) -> Port:
    """Open a serial port for `user` and discard earlier bytes. If cancelled, nothing stays open.

    Raises:
        PortError: the port cannot be used; the message says why and what to do.
    """
    if settings.port in _being_opened:
        raise PortError(f"{settings.port}: its driver hangs in an earlier attempt to open it")
    loop = asyncio.get_running_loop()
    _being_opened.add(settings.port)
    opening = loop.run_in_executor(ThreadPerCall(f"open {settings.port}"), open_device, settings, configured)
    opening.add_done_callback(lambda _: _being_opened.discard(settings.port))
    try:
        device = await asyncio.shield(opening)
    except asyncio.CancelledError:
        opening.add_done_callback(_close_unwanted)
        raise
    return SerialPort(loop, device, user)


@contextmanager
def open_blocking(settings: SerialSettings, timeout: float) -> Iterator[Serial]:
    """A serial port without an event loop, for a library that reads and writes it.

    It is opened, locked and closed as for a line. `timeout` is for each read and write, in seconds.

    Raises:
        PortError: the port cannot be used; the message says why and what to do.
    """
    device = open_device(settings, configured)
    try:
        set_input_flags(device.serial.fileno(), checks_parity=False)  # its reader does not know marked characters
        device.serial.timeout = device.serial.write_timeout = timeout
        yield device.serial
    finally:
        if device.serial.is_open:  # the library closes a lost port
            close_device(device, lost=False)


def _close_unwanted(opening: asyncio.Future[OpenDevice[ConfiguredOnce]]) -> None:
    """Close a port after its opening was cancelled."""
    if opening.cancelled() or opening.exception() is not None:
        return
    device = opening.result()
    ThreadPerCall(f"close {device.port}").submit(close_device, device, lost=True)
