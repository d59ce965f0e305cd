"""The systemd protocol of a service: readiness, status and watchdog messages; inherited sockets.

See sd_notify(3), sd_watchdog_enabled(3) and sd_listen_fds(3). Without systemd nothing happens.
"""

import os
import socket
import time
from collections.abc import Mapping
from contextlib import suppress
from typing import Final

#: The first descriptor that systemd hands over.
_FIRST_DESCRIPTOR: Final = 3


class Notifier:
    """Sends notifications to systemd. Failures to send are ignored."""

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        path = environment.get("NOTIFY_SOCKET", "")
        self._address = f"\0{path[1:]}" if path.startswith("@") else path
        #: The watchdog period in seconds; 0 for none.
        self.watchdog = _watchdog_period(environment)
        #: The last step, if it could not be sent yet.
        self._unsent = ""

    @property
    def is_service(self) -> bool:
        """Whether this process is a service of systemd."""
        return bool(self._address)

    def ready(self, status: str) -> None:
        """Tell that clients can connect, or that a reload is over, with a `status`."""
        self._step("READY=1")
        self.status(status)

    def reloading(self) -> None:
        """Tell that the config is read again, and since when, as Type=notify-reload wants; `ready` must follow."""
        self._step(f"RELOADING=1\nMONOTONIC_USEC={time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000}")

    def status(self, text: str) -> None:
        """Set the text that `systemctl status` shows. systemd ignores one that is longer than 4096 bytes."""
        self._repeat_step()
        self._tell(f"STATUS={text}")

    def alive(self) -> None:
        """Reset the watchdog."""
        self._repeat_step()
        self._tell("WATCHDOG=1")

    def stopping(self) -> None:
        """Tell that the service is stopping."""
        self._step("STOPPING=1")

    def _step(self, step: str) -> None:
        """Send a step now, or with the next message; only the last step matters."""
        self._unsent = step
        self._repeat_step()

    def _repeat_step(self) -> None:
        if self._unsent and self._tell(self._unsent):
            self._unsent = ""

    def _tell(self, line: str) -> bool:
        """Send a line; False if systemd's socket is full."""
        if not self._address:
            return True
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
            sock.setblocking(False)
            try:
                sock.sendto(line.encode(), self._address)
            except BlockingIOError:
                return False
        return True


def take_inherited_sockets(environment: Mapping[str, str] = os.environ) -> list[socket.socket]:
    """Take over the sockets that systemd has opened for this process (socket activation). Call it once."""
    if environment.get("LISTEN_PID") != str(os.getpid()):
        return []
    count = int(environment.get("LISTEN_FDS", "0"))
    sockets = [socket.socket(fileno=number) for number in range(_FIRST_DESCRIPTOR, _FIRST_DESCRIPTOR + count)]
    for sock in sockets:
        sock.set_inheritable(False)
    return sockets


def _watchdog_period(environment: Mapping[str, str]) -> float:
    if environment.get("WATCHDOG_PID", str(os.getpid())) != str(os.getpid()):
        return 0.0
    return int(environment.get("WATCHDOG_USEC", "0")) / 1e6
