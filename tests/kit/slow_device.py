"""A device server with one slow device, which keeps the log of the wire."""

import socket
import threading
import time
from typing import NamedTuple, Self

from gateway.modbus import rtu


class Heard(NamedTuple):
    """A frame that was on the wire, when it had come, by time.monotonic."""

    at: float
    pdu: bytes


class SlowDevice:
    """Answers reads with zeros and writes with a copy, `delay` seconds later. In its context it listens at `port`."""

    def __init__(self, delay: float = 0.02) -> None:
        self.delay = delay
        self.heard: list[Heard] = []
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self._connections: list[socket.socket] = []
        self._threads = [threading.Thread(target=self._accept, name="slow device")]

    def __enter__(self) -> Self:
        self._threads[0].start()
        return self

    def __exit__(self, *_: object) -> None:
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        for connection in self._connections:
            connection.close() if connection.fileno() < 0 else connection.shutdown(socket.SHUT_RDWR)
        for thread in self._threads:
            thread.join()

    def writes(self, address: int) -> list[float]:
        """When a single register at this address was to be written."""
        return [each.at for each in self.heard if each.pdu[0] == 6 and each.pdu[1] << 8 | each.pdu[2] == address]

    def _accept(self) -> None:
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return
            self._connections.append(connection)
            thread = threading.Thread(target=self._serve, args=(connection,), name="slow device: connection")
            self._threads.append(thread)
            thread.start()

    def _serve(self, connection: socket.socket) -> None:
        with connection:
            try:
                while data := connection.recv(256):
                    pdu = data[1:-2]
                    self.heard.append(Heard(time.monotonic(), pdu))
                    time.sleep(self.delay)
                    answer = pdu if pdu[0] == 6 else bytes((pdu[0], 2 * pdu[4])) + bytes(2 * pdu[4])
                    connection.sendall(rtu.encode(data[0], answer))
            except OSError:
                return
