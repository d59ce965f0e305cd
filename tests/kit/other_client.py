"""Another client on a FaultyLine, and an adapter that splits bytes anywhere.

    other_client = OtherClient(line, seed=4)
    for delay, data in other_client.asks(now):
        loop.call_later(delay, adapter.take, data)

It asks the devices that we ask, mostly for what we ask too, and writes registers of its own. Its answers may be late,
damaged or missing like ours. Like every client it begins on a quiet line only, and its request takes its time on the
wire; see `may_ask_at`.

Left out is what cannot be detected: frames that fit its request although no device sent them as the response, and
requests that the gateway received only in part.
"""

import random
from collections.abc import Callable
from typing import Final

from gateway.modbus.codes import COUNTERS, FunctionCode
from gateway.modbus.pdu import parse_request
from kit.device import Answer
from kit.faulty import FaultyDevice, FaultyLine
from kit.noise import flipped

#: Registers that only this client writes, and what it reads.
_OWN: Final = range(480, 488)
_SPANS: Final = [(0, 1), (0, 4), (16, 4), (32, 4), (7, 1), (9, 1), (60, 1), (192, 4), (100, 100)]
_BITS: Final = [(0, 16), (40, 20), (784, 24), (800, 20), (776, 17)]
#: Addresses and quantities that the gateway never requests: an exception to them is never its response.
_REFUSED: Final = {b"\x00\x3c\x00\x01", b"\x00\xc0\x00\x04"}
#: The size of its PDUs.
_REQUEST: Final = 5
#: The longest time a device thinks, in seconds.
_THINKING: Final = 0.008


class OtherClient:
    """Another client. `silent` is the share of its requests without response; `late` and `damaged` likewise."""

    def __init__(
        self, line: FaultyLine, *, seed: int, silent: float = 0.03, late: float = 0.05, damaged: float = 0.03
    ) -> None:
        self.asked = 0
        self._line = line
        self._dice = random.Random(seed)
        self._fates = ["right", "silent", "late", "damaged"]
        self._weights = [1.0 - silent - late - damaged, silent, late, damaged]

    @property
    def may_ask_at(self) -> float:
        """When its request may have come: on a quiet line, and no frame that fits by chance is on its way."""
        line = self._line
        return max(line.spurious_until, line.heard_at + 2 * line.timing.t35) + line.timing.frame(_REQUEST)

    def asks(self, now: float) -> list[Answer]:
        """Its request to one device, and the response."""
        self.asked += 1
        device = self._dice.choice(self._line.devices)
        pdu = self._pdu()
        request = self._line.encode(device.unit, pdu)
        (fate,) = self._dice.choices(self._fates, self._weights)
        response = self._line.encode(device.unit, self._response(device, pdu))
        if fate == "silent":
            return [Answer(0.0, request)]
        if fate == "damaged":
            response = flipped(response, self._dice.randrange(8 * len(response)))
        at = self._when(device, pdu, is_late=fate == "late")
        self._line.will_answer_other_client(device.unit, pdu[0], now + at)
        return [Answer(0.0, request), Answer(at, response)]

    def _pdu(self) -> bytes:
        if self._dice.random() < 0.15:
            return self._write()
        if self._dice.random() < 0.05:
            return bytes((FunctionCode.DIAGNOSTICS, 0, self._dice.choice(COUNTERS), 0, 0))
        function = self._dice.choice((3, 3, 3, 4, 1, 2))
        start, count = self._dice.choice(_SPANS if function > 2 else _BITS)
        return bytes((function,)) + start.to_bytes(2) + count.to_bytes(2)

    def _write(self) -> bytes:
        """A write of up to three coils or registers, with any function."""
        dice, address, count = self._dice, self._dice.choice(_OWN).to_bytes(2), self._dice.randint(1, 3)
        registers = address + count.to_bytes(2) + bytes((2 * count,)) + dice.randbytes(2 * count)
        return dice.choice(
            (
                b"\x06" + address + dice.randbytes(2),
                b"\x0f" + address + count.to_bytes(2) + b"\1" + dice.randbytes(1),
                b"\x10" + registers,
                b"\x16" + address + dice.randbytes(4),
                b"\x17" + address + count.to_bytes(2) + registers,
            )
        )

    def _response(self, device: FaultyDevice, pdu: bytes) -> bytes:
        if pdu[1:] in _REFUSED and self._dice.random() < 0.3:
            return bytes((pdu[0] | 0x80, 4))
        return device.respond(pdu)

    def _when(self, device: FaultyDevice, pdu: bytes, *, is_late: bool) -> float:
        """When the response is complete, from the end of the request: as late as one to the gateway may be."""
        if not is_late:
            return self._dice.uniform(0.0003, _THINKING)
        limit, window = self._line.limit(device, parse_request(pdu))
        return limit + self._dice.uniform(0.0, 0.95 * window)


class Adapter:
    """Hands over what a line delivers a little later, in chunks that ignore where frames end.

    `later(delay, call)` calls back; `deliver` takes the chunks.
    """

    def __init__(
        self, later: Callable[[float, Callable[[], None]], object], deliver: Callable[[bytes], None], *, seed: int
    ) -> None:
        self._later = later
        self._deliver = deliver
        self._dice = random.Random(seed)
        self._data = b""
        self._waits = False

    def take(self, data: bytes, *, at_once: bool) -> None:
        """The line delivers `data`. With `at_once` nothing is held back."""
        self._data += data
        if at_once:
            self._hand_over(len(self._data))
        else:
            self._wait()

    def drop(self) -> None:
        """The adapter is unplugged."""
        self._data = b""

    def _wait(self) -> None:
        if self._data and not self._waits:
            self._waits = True
            self._later(self._dice.choice((0.0, 0.0005, 0.002)), self._wake)

    def _wake(self) -> None:
        self._waits = False
        size = len(self._data)
        self._hand_over(self._dice.randint(1, size) if size and self._dice.random() < 0.3 else size)

    def _hand_over(self, size: int) -> None:
        chunk, self._data = self._data[:size], self._data[size:]
        if chunk:
            self._deliver(chunk)
        self._wait()
