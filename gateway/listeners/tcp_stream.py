"""An accepted TCP connection in the event loop: what arrives is received into the buffer of its user. Compiled.

As a transport of asyncio's, with what a client needs, at half its instructions.
"""

import asyncio
import socket
from fcntl import ioctl
from termios import FIONREAD
from typing import Final, Protocol

#: Where `ioctl` writes how many bytes are unread (bytes that it cannot write to cost it an error), and none.
_unread: Final = bytearray(4)
_NONE: Final = bytes(4)
#: To look them up in their modules costs as much as to call them.
_ask_system: Final = ioctl
_UNREAD: Final = FIONREAD


class StreamUser(Protocol):
    """The protocol of a connection, as asyncio.BufferedProtocol. Nothing in it raises."""

    def get_buffer(self) -> memoryview:
        """Return the buffer to receive into; empty if there is no room at the moment."""

    def buffer_updated(self, nbytes: int) -> None:
        """Take the bytes that have arrived in it."""

    def eof_received(self) -> bool:
        """Take no more: the client has closed its side."""

    def pause_writing(self) -> None:
        """Write no more: the client does not read."""

    def resume_writing(self) -> None:
        """Go on: the client reads again."""

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection: it has ended."""


class TcpStream:
    """A connection on a socket that does not block. Nothing is received before `resume_reading`."""

    def __init__(self, loop: asyncio.AbstractEventLoop, connected: socket.socket, user: StreamUser) -> None:
        self._loop = loop
        self._socket = connected
        self._descriptor = connected.fileno()
        self._user: StreamUser | None = user
        #: What the client has not read, and beyond how many bytes of it the user is told.
        self._unsent = bytearray()
        self._limit = 0
        self._is_blocked = False
        self._is_reading = False
        self._has_peer_ended = False
        self._is_closing = False
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def is_closing(self) -> bool:
        """Return True if it is closed, or being closed."""
        return self._is_closing

    def set_write_buffer_limits(self, high: int) -> None:
        """Call `pause_writing` when more than `high` bytes wait, `resume_writing` at a quarter of it."""
        self._limit = high

    def pause_reading(self) -> None:
        """Receive nothing until `resume_reading`."""
        if self._is_reading:
            self._is_reading = False
            self._loop.remove_reader(self._socket)

    def resume_reading(self) -> None:
        """Receive again."""
        if not (self._is_reading or self._has_peer_ended or self._is_closing):
            self._is_reading = True
            self._loop.add_reader(self._socket, self._receive)

    def receive(self, room: memoryview) -> int:
        """Copy what has arrived into `room`; return the number of bytes. The client's end is left to the loop."""
        if self._is_closing:
            return 0
        _ask_system(self._descriptor, _UNREAD, _unread)
        if _unread == _NONE:
            return 0  # to be told so by an error of `recv` takes ten times as many instructions
        try:
            return self._socket.recv_into(room)
        except (BlockingIOError, InterruptedError):
            return 0
        except OSError as error:
            self._abort(error)
            return 0

    def write(self, data: bytes) -> None:
        """Send `data`, or keep what the client does not take at once."""
        if self._is_closing:
            return
        if self._unsent:
            self._keep(data)
            return
        try:
            sent = self._socket.send(data)
        except (BlockingIOError, InterruptedError):
            sent = 0
        except OSError as error:
            self._abort(error)
            return
        if sent < len(data):
            self._loop.add_writer(self._socket, self._send_kept)
            self._keep(data[sent:])

    def close(self) -> None:
        """Close once everything was sent."""
        if self._is_closing:
            return
        self._is_closing = True
        self.pause_reading()
        if not self._unsent:
            self._loop.call_soon(self._end, None)

    def abort(self) -> None:
        """Close now, and drop what was not sent."""
        self._abort(None)

    def _receive(self) -> None:
        user = self._user
        if user is None:
            return
        room = user.get_buffer()
        if not len(room):
            return  # no end: what the user has is still to be processed
        try:
            count = self._socket.recv_into(room)
        except (BlockingIOError, InterruptedError):
            return
        except OSError as error:
            self._abort(error)
            return
        if count:
            user.buffer_updated(count)
            return
        self._has_peer_ended = True
        self.pause_reading()
        user.eof_received()

    def _keep(self, data: bytes) -> None:
        """Keep `data` until the client reads."""
        self._unsent += data
        if len(self._unsent) > self._limit and not self._is_blocked and self._user is not None:
            self._is_blocked = True
            self._user.pause_writing()

    def _send_kept(self) -> None:
        try:
            sent = self._socket.send(self._unsent)
        except (BlockingIOError, InterruptedError):
            return
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
        self.pause_reading()
        if self._unsent:
            self._unsent.clear()
            self._loop.remove_writer(self._socket)
        self._loop.call_soon(self._end, error)

    def _end(self, error: OSError | None) -> None:
        """Tell the user, once."""
        if self._user is None:
            return
        user, self._user = self._user, None
        self._socket.close()
        user.connection_lost(error)

    def __repr__(self) -> str:
        state = "closing" if self._is_closing else "open"
        return f"<TcpStream {state}, {len(self._unsent)} bytes to send>"
