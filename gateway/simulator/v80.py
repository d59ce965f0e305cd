"""A V80 or PPC programmable controller ("V80 and PPC controllers, MODBUS protocol", version 1.2).

RTU or ASCII. A frame ends after 4.5 characters of silence (1.2). Its coils and registers have the values of the
examples in chapter 2, so each printed request gets the printed response.
"""

from collections.abc import Mapping
from typing import ClassVar, Final

from gateway.images.tables import Values
from gateway.modbus.codes import Area
from gateway.profiles.profile import Range
from gateway.registers.items import unpack_bits
from gateway.simulator.builtin import builtin_profile
from gateway.simulator.device import Device
from gateway.simulator.faults import NO_FAULTS, Faults

#: 2.1 names 1024 coils, all of which one request may read; the document gives no size for the other tables.
AREAS: Final[Mapping[Area, tuple[Range, ...]]] = dict.fromkeys(Area, ((0, 1023),))

#: 2.1: coils 20-56, which are addresses 19-55.
_COILS: Final[Values] = (0x13, unpack_bits(bytes.fromhex("CD 6B B2 0E 1B"), 37))
#: 2.2: registers 40108-40110 hold 555, 0 and 100; in unit 6, the example at the head of chapter 2, they hold 99.
_REGISTERS: Final[Values] = (0x6B, (555, 0, 100))
_REGISTERS_OF_UNIT_6: Final[Values] = (0x6B, (99, 99, 99))


class V80(Device):
    """A controller. Unit 6 has the values of the document's unit 6, any other the values of its unit 17."""

    broadcasts = frozenset({5, 6, 15, 16})
    answer_time: ClassVar[float] = 0.010

    def __init__(self, unit: int, *, baud: int | None = None, faults: Faults = NO_FAULTS) -> None:
        registers = _REGISTERS_OF_UNIT_6 if unit == 6 else _REGISTERS
        initial = {Area.COILS: [_COILS], Area.HOLDING: [registers]}
        super().__init__(unit, builtin_profile("v80"), AREAS, initial, baud=baud, faults=faults)
