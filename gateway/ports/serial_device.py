"""Serial devices of pyserial, opened for reading and writing, or so that they cannot send. All of it may block."""

import fcntl
import os
import termios

from serial import PARITY_NONE, Serial

from gateway.hardware.ioctls import lower_modem_lines, set_input_flags, stop_echo


class ConfiguredOnce(Serial):
    """pyserial's port, configured only when it is opened.

    pyserial configures a port whenever a setting is assigned, and pyserial-asyncio assigns two in the event loop, where
    a USB adapter that hangs would block everything for seconds. pyserial also leaves parity unchecked; this class
    corrects it.
    """

    def _reconfigure_port(self, force_update: bool = False) -> None:  # noqa: FBT001, FBT002 - pyserial's signature
        if force_update and self.fd is not None:
            super()._reconfigure_port(force_update=True)  # type: ignore[misc]  # private, so not in the stubs
            set_input_flags(self.fd, checks_parity=self.checks_parity)

    @property
    def checks_parity(self) -> bool:
        """Whether characters have a parity bit; then damaged ones are marked (see `MarkedInput`)."""
        return bool(self.parity != PARITY_NONE)

    def change_baud(self, baud: int) -> None:
        """Set the rate. Raises ValueError or a DriverError if that fails."""
        self.baudrate = baud
        self._reconfigure_port(force_update=True)


class ListeningDevice(ConfiguredOnce):
    """A port that cannot send: open for reading only, RTS and DTR low, and without the terminal's echo.

    Opening raises RTS and DTR in most drivers, and a terminal that nobody has set echoes. Both end before anything
    else; the echo first, because that is no matter of the hardware.
    """

    def open(self) -> None:
        """Open and configure the port.

        Raises:
            OSError, termios.error, ValueError: it cannot be used.
        """
        descriptor = os.open(str(self.port), os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)  # else another program's lines would be lowered
            stop_echo(descriptor)
            lower_modem_lines(descriptor)
            self.fd = descriptor
            self._reconfigure_port(force_update=True)
            termios.tcflush(descriptor, termios.TCIFLUSH)
        except BaseException:
            self.fd = None
            os.close(descriptor)
            raise
        self.is_open = True

    def close(self) -> None:
        """Close the port."""
        if self.fd is not None:
            os.close(self.fd)
        self.fd, self.is_open = None, False

    def _reconfigure_port(self, force_update: bool = False) -> None:  # noqa: FBT001, FBT002 - pyserial's signature
        super()._reconfigure_port(force_update=force_update)
        if self.fd is not None:
            lower_modem_lines(self.fd)  # a driver raises them with the first rate after none (B0)
