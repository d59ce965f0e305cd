"""Accepts clients, also when the process has no file descriptors left."""

import asyncio
import os
import socket
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Final

from gateway.listeners.hosts import join_host_port
from gateway.listeners.sockets import explain

#: The pause after accepting has failed, in seconds.
PAUSE: Final = 0.1

#: Takes a connected socket, the listening one, and the host and port of the client.
Connect = Callable[[socket.socket, socket.socket, str, int], Awaitable[None]]
#: Takes a client that was disconnected at once, and the reason.
Rejected = Callable[[str, str], None]


class Acceptor:
    """Accepts the clients of one listener, at most one in each iteration of the event loop.

    One descriptor is reserved. When no other is left, it is used to accept a client and disconnect it at once: a
    waiting client would keep the listening socket readable, and the event loop busy.
    """

    def __init__(self, connect: Connect, rejected: Rejected, pause: float) -> None:
        """Accept for `connect`; after one client the next one waits for at least `pause` seconds."""
        self._connect = connect
        self._rejected = rejected
        self._pause = pause
        #: The listening sockets.
        self.sockets: list[socket.socket] = []
        self._tasks: list[asyncio.Task[None]] = []
        self._reserved: int | None = None

    def hold(self, sockets: list[socket.socket]) -> None:
        """Keep these bound sockets until `stop`, and reserve a descriptor."""
        self.sockets = sockets
        self._reserve()

    def start(self, name: str) -> None:
        """Accept clients in tasks named `name`. The sockets must be listening."""
        self._tasks = [asyncio.create_task(self._accept(each), name=name) for each in self.sockets]

    def stop(self) -> None:
        """Accept no more clients, and close the sockets."""
        loop = asyncio.get_running_loop()
        for task in self._tasks:
            task.cancel()
        for listening in self.sockets:
            loop.remove_reader(listening)  # now: when the task runs, the descriptor may be reused
            listening.close()
        self._tasks, self.sockets = [], []
        self._release()

    async def _accept(self, listening: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        while True:
            try:
                sock, address = await loop.sock_accept(listening)
            except OSError as error:
                await self._reject_next(listening, explain(error))
            else:
                await self._connect(sock, listening, *address[:2])
            await asyncio.sleep(self._pause)

    async def _reject_next(self, listening: socket.socket, reason: str) -> None:
        """Reject the next waiting client after accepting has failed, probably for lack of descriptors."""
        client = self._close_next(listening)
        self._rejected(client or "unknown", reason)
        if client is None:
            await asyncio.sleep(PAUSE)

    def _close_next(self, listening: socket.socket) -> str | None:
        """Accept and close the first waiting connection. Return its peer, or None if that failed."""
        self._release()
        try:
            client, address = listening.accept()
            client.close()
        except OSError:
            return None
        finally:
            self._reserve()
        return join_host_port(*address[:2])

    def _reserve(self) -> None:
        """Reserve a descriptor, if one is left."""
        if self._reserved is None:
            with suppress(OSError):
                self._reserved = os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)

    def _release(self) -> None:
        if self._reserved is not None:
            os.close(self._reserved)
            self._reserved = None
