"""An accepted TCP connection in the event loop: bytes are received into the buffer of its user. Compiled.

It is a reduced transport of asyncio, with half the instructions.
"""

import asyncio
import os
import socket
from typing import Final

from gateway.clock.exact_loop import ExactLoop
from gateway.clock.system_calls import read_into, write
from gateway.listeners.connection import TcpConnection

#: Looking them up in their module would cost as much as calling them.
_read_into: Final = read_into
_write: Final = write


class TcpStream:
    """A connection on a non-blocking socket. Nothing is received before `resume_reading`."""

    def __init__(self, loop: asyncio.AbstractEventLoop, connected: socket.socket, user: TcpConnection) -> None:
        self._loop = loop
        self._socket = connected
        self._descriptor = connected.fileno()
        self._user: TcpConnection | None = user
        #: Bytes that the client has not read, and the number of them above which the user is told.
        self._unsent = bytearray()
        self._limit = 0
        self._is_blocked = False
        #: Whether it receives, and whether the loop watches the socket: for a pause, an exact loop only ignores it.
        self._is_reading = False
        self._is_known = False
        self._exact = loop if isinstance(loop, ExactLoop) else None
        self._has_peer_ended = False
        self._is_closing = False
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def is_closing(self) -> bool:
        """Tell whether it is closed, or being closed."""
        return self._is_closing

    def set_write_buffer_limits(self, high: int) -> None:
        """Call `pause_writing` when more than `high` bytes wait, `resume_writing` at a quarter of it."""
        self._limit = high

    def pause_reading(self) -> None:
        """Receive nothing until `resume_reading`."""
        if self._is_reading and self._exact is not None:
            self._is_reading = False
            self._exact.mask(self._descriptor)
        elif self._is_reading:
            self._forget()

    def resume_reading(self) -> None:
        """Receive again."""
        if not (self._is_reading or self._has_peer_ended or self._is_closing):
            self._is_reading = True
            if self._is_known and self._exact is not None:
                self._exact.unmask(self._descriptor)
            else:
                self._is_known = True
                self._loop.add_reader(self._socket, self._receive)

    def receive(self, room: memoryview) -> int:
        """Copy received bytes into `room`. Return their number. The end of the stream is left to the loop."""
        if self._is_closing:
            return 0
        try:
            return max(0, _read_into(self._descriptor, room))
        except OSError as error:
            self._abort(error)
            return 0

    def write(self, data: bytes) -> None:
        """Send `data`; bytes that the client does not take at once are kept."""
        if self._is_closing:
            return
        if self._unsent:
            self._keep(data)
            return
        try:
            sent = _write(self._descriptor, data)
        except OSError as error:
            self._abort(error)
            return
        if sent < len(data):
            self._loop.add_writer(self._socket, self._send_kept)
            self._keep(data[sent:])

    def close(self) -> None:
        """Close once everything is sent."""
        if self._is_closing:
            return
        self._is_closing = True
        self._forget()
        if not self._unsent:
            self._loop.call_soon(self._end, None)

    def abort(self) -> None:
        """Close now, and drop unsent bytes."""
        self._abort(None)

    def _receive(self) -> None:
        user = self._user
        if user is None:
            return
        if not self._is_reading:  # masked: it is lost, or was ready before that
            if number := self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
                self._abort(OSError(number, os.strerror(number)))
            return
        room = user.get_buffer()
        if not len(room):
            return  # not the end: the user has yet to process its bytes
        try:
            count = _read_into(self._descriptor, room)
        except OSError as error:
            self._abort(error)
            return
        if count > 0:
            user.buffer_updated(count)
            return
        if count < 0:
            return  # nothing yet, all the same
        self._has_peer_ended = True
        self._forget()
        user.eof_received()

    def _forget(self) -> None:
        """Receive nothing, and have the loop watch the socket no more."""
        self._is_reading = False
        if self._is_known:
            self._is_known = False
            self._loop.remove_reader(self._socket)

    def _keep(self, data: bytes) -> None:
        """Keep `data` until the client reads."""
        self._unsent += data
        if len(self._unsent) > self._limit and not self._is_blocked and self._user is not None:
            self._is_blocked = True
            self._user.pause_writing()

    def _send_kept(self) -> None:
        try:
            sent = _write(self._descriptor, self._unsent)
        except OSError as error:
            self._abort(error)
            return
        del self._unsent[:sent]
        if self._is_blocked and len(self._unsent) <= self._limit // 4 and self._user is not None:
            self._is_blocked = False
            self._user.resume_writing()
        if not self._unsent:
            self._loop.remove_writer(self._socket)
            if self._is_closing:
                self._end(None)

    def _abort(self, error: OSError | None) -> None:
        if self._user is None:
            return  # another connection may have the descriptor
        self._is_closing = True
        self._forget()
        if self._unsent:
            self._unsent.clear()
            self._loop.remove_writer(self._socket)
        self._loop.call_soon(self._end, error)

    def _end(self, error: OSError | None) -> None:
        """Close the socket, and tell the user, once."""
        if self._user is None:
            return
        user, self._user = self._user, None
        self._descriptor = -1  # another connection may soon have its number
        self._socket.close()
        user.connection_lost(error)

    def __repr__(self) -> str:
        state = "closing" if self._is_closing else "open"
        return f"<TcpStream {state}, {len(self._unsent)} bytes to send>"
