"""Reject clients even when the process has no file descriptors left."""

import os
import socket
from contextlib import suppress

from gateway.listeners.sockets import join_host_port


class SpareDescriptor:
    """A reserved descriptor. When no other is left, it is used to accept a client and disconnect it at once.

    A waiting client would keep the listening socket readable, and the event loop busy.
    """

    def __init__(self) -> None:
        self._descriptor: int | None = None

    def hold(self) -> None:
        """Reserve a descriptor, if one is left."""
        if self._descriptor is None:
            with suppress(OSError):
                self._descriptor = os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)

    def release(self) -> None:
        """Give the reserved descriptor up."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None

    def send_away(self, listening: socket.socket) -> str | None:
        """Accept and close the first waiting connection of `listening`; its peer, or None if that failed."""
        self.release()
        try:
            client, address = listening.accept()
            client.close()
        except OSError:
            return None
        finally:
            self.hold()
        return join_host_port(*address[:2])
