"""Simulated devices on a serial line, without I/O: bytes of requests in, delayed bytes of answers out.

    line = SimulatedLine("rtu", SimulatedDevice(unit=17, delay=0.02))
    for delay, data in line.received(b"..."):
        loop.call_later(delay, port.deliver, data)

A device of its own right: it shares the framers with the gateway, but none of the code that answers for a local image.
"""

from collections import deque
from collections.abc import Callable
from struct import pack
from typing import Literal, NamedTuple

from gateway.errors import IllegalAddress, IllegalFunction, RequestError
from gateway.modbus import ascii as ascii_framing
from gateway.modbus import rtu
from gateway.modbus.codes import Area
from gateway.modbus.frame import Frame
from gateway.modbus.pdu import RequestPdu, exception_response, parse_request


class Answer(NamedTuple):
    """Bytes that the line delivers `delay` seconds after the request."""

    delay: float
    data: bytes


class SimulatedDevice:
    """Holds 200 items of each area (all 0) and answers functions 01-06, 15, 16, 22 and 23 after `delay` seconds.

    What it does wrong is set by the test, at any time: `silent`; `refuses` (function: exception code); `script`, one
    list of answers for each of the next requests: any bytes at any time, [] for none; `absent`, the items that it does
    not have, refused with `code_of_absent`. `heard` is all it was asked.
    """

    def __init__(self, unit: int = 1, *, delay: float = 0.01, items: int = 200) -> None:
        self.unit = unit
        self.delay = delay
        self.silent = False
        self.refuses: dict[int, int] = {}
        self.absent: set[tuple[Area, int]] = set()
        self.code_of_absent = IllegalAddress.code
        self.script: deque[list[Answer]] = deque()
        self.heard: list[Frame] = []
        self.answers_unit_0 = False
        self.coils, self.discrete = [False] * items, [False] * items
        self.holding, self.input = [0] * items, [0] * items

    def ask(self, frame: Frame, encode: Callable[[int, bytes], bytes]) -> list[Answer]:
        """What the device sends on hearing `frame`; a broadcast is acted on and not answered."""
        self.heard.append(frame)
        if self.script:
            return [Answer(*answer) for answer in self.script.popleft()]
        response = self._respond(frame.pdu)
        if self.silent or (frame.unit == 0 and not self.answers_unit_0):
            return []
        return [Answer(self.delay, encode(self.unit, response))]

    def _respond(self, pdu: bytes) -> bytes:
        try:
            if pdu[0] in self.refuses:
                return exception_response(pdu[0], self.refuses[pdu[0]])
            asked = parse_request(pdu)
            if asked.function not in _FUNCTIONS:
                raise IllegalFunction(f"no function {asked.function}")
            if self._lacks(asked):
                return exception_response(pdu[0], self.code_of_absent)
        except RequestError as error:
            return exception_response(pdu[0], error.code)
        return _FUNCTIONS[asked.function](self, asked)

    def _lacks(self, asked: RequestPdu) -> bool:
        for span in (asked.read, asked.write):
            if span is None:
                continue
            wanted = {(span.area, address) for address in range(span.start, span.end)}
            if span.end > len(getattr(self, span.area)) or wanted & self.absent:
                return True
        return False

    def _read_bits(self, asked: RequestPdu) -> bytes:
        bits = self._read(asked)
        octets = [bits[at : at + 8] for at in range(0, len(bits), 8)]
        packed = bytes(sum(bit << place for place, bit in enumerate(octet)) for octet in octets)
        return bytes((asked.function, len(packed))) + packed

    def _read_registers(self, asked: RequestPdu) -> bytes:
        values = self._read(asked)
        return pack(f">BB{len(values)}H", asked.function, 2 * len(values), *values)

    def _write_coil(self, asked: RequestPdu) -> bytes:
        self._write(asked, [asked.data[3] == 0xFF])
        return asked.data

    def _write_register(self, asked: RequestPdu) -> bytes:
        self._write(asked, _words(asked.data[3:]))
        return asked.data

    def _write_coils(self, asked: RequestPdu) -> bytes:
        bits = [bool(octet >> place & 1) for octet in asked.data[6:] for place in range(8)]
        self._write(asked, bits[: asked.items])
        return asked.data[:5]

    def _write_registers(self, asked: RequestPdu) -> bytes:
        self._write(asked, _words(asked.data[6:]))
        return asked.data[:5]

    def _mask_register(self, asked: RequestPdu) -> bytes:
        address, and_mask, or_mask = _words(asked.data[1:])
        self.holding[address] = (self.holding[address] & and_mask) | (or_mask & ~and_mask)
        return asked.data

    def _write_and_read_registers(self, asked: RequestPdu) -> bytes:
        self._write(asked, _words(asked.data[10:]))
        return self._read_registers(asked)

    def _read(self, asked: RequestPdu) -> list[int]:
        return getattr(self, asked.read.area)[asked.read.start : asked.read.end]

    def _write(self, asked: RequestPdu, values: list[int]) -> None:
        getattr(self, asked.write.area)[asked.write.start : asked.write.end] = values


class SimulatedLine:
    """Devices side by side on one line; each hears all, the one that is asked answers."""

    def __init__(self, mode: Literal["rtu", "ascii"], *devices: SimulatedDevice) -> None:
        self.devices = {device.unit: device for device in devices}
        self._framer = rtu.RtuFramer(silence=0.0) if mode == "rtu" else ascii_framing.AsciiFramer()

    def received(self, data: bytes, now: float = 0.0) -> list[Answer]:
        """Take what was written in one go (silence follows it); the answers it brings."""
        frames = self._framer.received(data, now) + self._framer.tick(now)
        return [answer for frame in frames for device in self._asked(frame.unit) for answer in self._ask(device, frame)]

    def _asked(self, unit: int) -> list[SimulatedDevice]:
        return [device for device in self.devices.values() if unit in (0, device.unit)]

    def _ask(self, device: SimulatedDevice, frame: Frame) -> list[Answer]:
        return device.ask(frame, self._framer.encode)


def _words(data: bytes) -> list[int]:
    return [int.from_bytes(data[at : at + 2]) for at in range(0, len(data), 2)]


_FUNCTIONS: dict[int, Callable[[SimulatedDevice, RequestPdu], bytes]] = {
    1: SimulatedDevice._read_bits,
    2: SimulatedDevice._read_bits,
    3: SimulatedDevice._read_registers,
    4: SimulatedDevice._read_registers,
    5: SimulatedDevice._write_coil,
    6: SimulatedDevice._write_register,
    15: SimulatedDevice._write_coils,
    16: SimulatedDevice._write_registers,
    22: SimulatedDevice._mask_register,
    23: SimulatedDevice._write_and_read_registers,
}
