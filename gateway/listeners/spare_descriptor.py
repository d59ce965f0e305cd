"""A way out when no descriptors are left."""

import os
import socket
from contextlib import suppress

from gateway.listeners.sockets import written


class SpareDescriptor:
    """A descriptor kept back. When there are no others, it makes room to take a client and send it away at once.

    A client that is left waiting would keep the listening socket readable, and the event loop busy.
    """

    def __init__(self) -> None:
        self._descriptor: int | None = None

    def hold(self) -> None:
        """Keep one back, if there is one."""
        if self._descriptor is None:
            with suppress(OSError):
                self._descriptor = os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)

    def release(self) -> None:
        """Keep none back."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None

    def send_away(self, listening: socket.socket) -> str | None:
        """Close the connection that waits first at `listening`; who it was, or None when that could not be done."""
        self.release()
        try:
            client, address = listening.accept()
            client.close()
        except OSError:
            return None
        finally:
            self.hold()
        return written(*address[:2])
