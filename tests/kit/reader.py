"""A Modbus TCP client at a real socket that asks one register after the other."""

import socket

from gateway.modbus.mbap import encode
from kit.process import PATIENCE


class Reader:
    """It is connected to this port of this machine, and checks that each answer is that to its request."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE)
        self._transaction = 0

    def ask(self, unit: int, pdu: str) -> str:
        """The response in hex."""
        self._transaction += 1
        self._socket.sendall(encode(self._transaction, unit, bytes.fromhex(pdu)))
        head = self._socket.recv(7, socket.MSG_WAITALL)
        assert (int.from_bytes(head[:2]), head[6]) == (self._transaction, unit)
        return self._socket.recv(int.from_bytes(head[4:6]) - 1, socket.MSG_WAITALL).hex(" ").upper()

    def read(self, unit: int, address: int) -> str:
        """The response to a read of one holding register."""
        return self.ask(unit, f"03 {address:04X} 0001")

    def close(self) -> None:
        """Leave."""
        self._socket.close()
