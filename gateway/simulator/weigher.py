"""A weighing transducer ("MODBUS protocol" of the transducer).

| address     | read                                         | write                                                  |
|-------------|----------------------------------------------|--------------------------------------------------------|
| 0000-0001   | 1: weight, float32, high word first          |                                                        |
| 0010        | 3: its own address                           |                                                        |
| 0020-0021   | 2: its rate, float32                         |                                                        |
| 0100        |                                              | 7, 8: its address; **the response comes from the new** |
| 0200-0201   |                                              | 5, 6: its rate, float32; answers, then changes         |
| 1A00 = 00BB |                                              | 4: takes the present weight as zero                    |

RTU, functions 03 and 16, exceptions 01, 02 and 03. It responds to function 03 at address 0, from its real address. The
document does not mention other requests to address 0: a write is a broadcast as in any Modbus device.
"""

from collections.abc import Callable, Mapping
from math import sin
from struct import Struct
from typing import Final

from gateway.errors import IllegalValue
from gateway.modbus.codes import BROADCAST_UNIT, FIRST_UNIT, LAST_UNIT, Area, FunctionCode
from gateway.modbus.frame import Frame
from gateway.modbus.pdu import RequestPdu
from gateway.profiles.profile import Range, covers
from gateway.simulator.builtin import builtin_profile
from gateway.simulator.device import Device
from gateway.simulator.faults import NO_FAULTS, Faults

#: The rates that it can be set to.
BAUDS: Final = (9600, 14400, 19200)

WEIGHT: Final = 0x0000
OWN_ADDRESS: Final = 0x0010
OWN_BAUD: Final = 0x0020
SET_ADDRESS: Final = 0x0100
SET_BAUD: Final = 0x0200
TAKE_ZERO: Final = 0x1A00
ZERO_KEY: Final = 0x00BB

READABLE: Final[Mapping[Area, tuple[Range, ...]]] = {
    Area.HOLDING: ((WEIGHT, WEIGHT + 1), (OWN_ADDRESS, OWN_ADDRESS), (OWN_BAUD, OWN_BAUD + 1))
}
WRITABLE: Final[tuple[Range, ...]] = (
    (SET_ADDRESS, SET_ADDRESS),
    (SET_BAUD, SET_BAUD + 1),
    (TAKE_ZERO, TAKE_ZERO),
)

#: The amplitude of a moving weight, and its radians per second.
_SWING: Final = 1.5
_PACE: Final = 0.8

_FLOAT = Struct(">f")
_TWO_WORDS = Struct(">HH")

#: The weight in the document's example (1): 4999.6645. The 4975 printed beside it is a mistake.
(PRINTED_WEIGHT,) = _FLOAT.unpack(bytes.fromhex("45 9C 3D 51"))


class Weigher(Device):
    """A transducer with `weight` on it, which is constant or `moves` a little.

    A weight of 4999.66 becomes the one of the document's example, 45 9C 3D 51.

    Raises:
        ValueError: it cannot be set to `baud`.
    """

    modes = frozenset({"rtu"})
    broadcasts = frozenset({16})

    def __init__(
        self,
        unit: int,
        *,
        weight: float = PRINTED_WEIGHT,
        moves: bool = False,
        baud: int | None = None,
        faults: Faults = NO_FAULTS,
    ) -> None:
        if baud not in (None, *BAUDS):
            raise ValueError(f"a weigher cannot be set to {baud} baud, only to 9600, 14400 and 19200")
        super().__init__(unit, builtin_profile("weigher"), READABLE, {}, baud=baud, faults=faults)
        self.weight = PRINTED_WEIGHT if round(weight, 2) == round(PRINTED_WEIGHT, 2) else weight
        self.moves = moves
        self._zero = 0.0

    def is_meant(self, frame: Frame) -> bool:
        """Tell whether it acts on `frame`: also on a read at address 0 (3)."""
        return super().is_meant(frame) or _is_broadcast_read(frame)

    def answers(self, frame: Frame) -> bool:
        """Tell whether it responds to `frame`: also to a read at address 0, from its real address (3)."""
        return super().answers(frame) or _is_broadcast_read(frame)

    def has(self, asked: RequestPdu) -> bool:
        """Tell whether all addresses exist: each is either for reading or for writing."""
        return super().has(asked) if asked.write is None else covers(WRITABLE, asked.write)

    def perform(self, asked: RequestPdu, now: float, baud: int) -> bytes:
        """Return the present values, or execute a command."""
        if asked.write is None:
            self._show(now, baud)
            return super().perform(asked, now, baud)
        self._obey(asked.write.start, asked.data[6:], now)
        return asked.response_head

    def _show(self, now: float, baud: int) -> None:
        holding = self.tables[Area.HOLDING]
        holding.assign(WEIGHT, _words(self._present(now) - self._zero))
        holding.assign(OWN_ADDRESS, (self.unit,))
        holding.assign(OWN_BAUD, _words(self.baud or baud))

    def _present(self, now: float) -> float:
        """Return the weight on it, regardless of the zero point."""
        return self.weight + (_SWING * sin(_PACE * now) if self.moves else 0.0)

    def _obey(self, address: int, data: bytes, now: float) -> None:
        command, size = _COMMANDS.get(address, (None, 0))
        if command is None or len(data) != size:
            raise IllegalValue("the second word of a rate cannot be set without the first, nor that alone")
        command(self, data, now)

    def _set_address(self, data: bytes, now: float) -> None:  # noqa: ARG002 - a command
        address = int.from_bytes(data)
        if not FIRST_UNIT <= address <= LAST_UNIT:
            raise IllegalValue(f"{address} is not a valid address")
        self.unit = address

    def _set_baud(self, data: bytes, now: float) -> None:  # noqa: ARG002 - a command
        (baud,) = _FLOAT.unpack(data)
        if baud not in BAUDS:
            raise IllegalValue(f"{baud} is not a rate of a weigher")
        self.baud = int(baud)

    def _take_zero(self, data: bytes, now: float) -> None:
        if int.from_bytes(data) != ZERO_KEY:
            raise IllegalValue(f"{data.hex()} does not take the zero")
        self._zero = self._present(now)


#: Each command, by the address it is written to, with the size of its value in bytes.
_COMMANDS: Final[dict[int, tuple[Callable[[Weigher, bytes, float], None], int]]] = {
    SET_ADDRESS: (Weigher._set_address, 2),  # noqa: SLF001 - its own
    SET_BAUD: (Weigher._set_baud, 4),  # noqa: SLF001
    TAKE_ZERO: (Weigher._take_zero, 2),  # noqa: SLF001
}


def _is_broadcast_read(frame: Frame) -> bool:
    return frame.unit == BROADCAST_UNIT and frame.pdu[0] == FunctionCode.READ_HOLDING_REGISTERS


def _words(value: float) -> tuple[int, int]:
    """Encode a float32 as two registers, the high word first."""
    high, low = _TWO_WORDS.unpack(_FLOAT.pack(value))
    return high, low
