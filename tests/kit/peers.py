"""Modbus TCP servers that others have written, each as a process. They have four units, 1 to 4, or know none.

Register `address` of `unit` holds 256 * `unit` + `address`, with libmodbus 256 + `address` in all units.
"""

import subprocess
import sys
from typing import Final, Self

_PYMODBUS: Final = """
import asyncio, sys, warnings
warnings.simplefilter("ignore")
from pymodbus.datastore import ModbusDeviceContext, ModbusSequentialDataBlock, ModbusServerContext
from pymodbus.server import StartAsyncTcpServer

units = {
    unit: ModbusDeviceContext(hr=ModbusSequentialDataBlock(1, [256 * unit + address for address in range(200)]))
    for unit in range(1, 5)
}
context = ModbusServerContext(devices=units, single=False)
asyncio.run(StartAsyncTcpServer(context, address=("127.0.0.1", int(sys.argv[1]))))
"""

_LIBMODBUS: Final = """
import ctypes, sys
from ctypes import POINTER, byref, c_char_p, c_int, c_uint8, c_uint16, c_void_p

class Mapping(ctypes.Structure):
    _fields_ = [(f"number_{at}", c_int) for at in range(8)]
    _fields_ += [("coils", c_void_p), ("discrete", c_void_p), ("input", c_void_p), ("holding", POINTER(c_uint16))]

library = ctypes.CDLL("libmodbus.so.5")
library.modbus_new_tcp.restype, library.modbus_mapping_new.restype = c_void_p, POINTER(Mapping)
context = c_void_p(library.modbus_new_tcp(c_char_p(b"127.0.0.1"), int(sys.argv[1])))
registers = library.modbus_mapping_new(0, 0, 200, 0)
for address in range(200):
    registers.contents.holding[address] = 256 + address
listener = c_int(library.modbus_tcp_listen(context, 4))
query = (c_uint8 * 260)()
while library.modbus_tcp_accept(context, byref(listener)) >= 0:
    while (size := library.modbus_receive(context, query)) >= 0:
        if size > 0:
            library.modbus_reply(context, query, size, registers)
    library.modbus_close(context)
"""


class _Peer:
    """A server at 127.0.0.1, port `number`, while in its context."""

    _script: str

    def __init__(self, number: int) -> None:
        self._number = number

    def __enter__(self) -> Self:
        command = [sys.executable, "-c", self._script, str(self._number)]
        self._process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()


class Pymodbus(_Peer):
    """pymodbus' server. It answers one of several requests that come in one segment."""

    _script = _PYMODBUS


class Libmodbus(_Peer):
    """libmodbus' server, one connection at a time. It answers to any unit; needs libmodbus5."""

    _script = _LIBMODBUS
