"""A Mint motion controller ("Mint motion controllers as Modbus ASCII servers", application note).

ASCII only. Registers are the Comms locations 1-99, coils and inputs those of group 0. Its answer times are those in the
note's table, by function and number of items. Its exceptions are 01 for other functions, 02 for other addresses, and 03
for a coil value that is neither FF00 nor 0000. It executes broadcasts of 05 and 16, and ignores others.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar, Final

from gateway.modbus.codes import Area
from gateway.profiles.profile import Range
from gateway.simulator.builtin import builtin_profile
from gateway.simulator.device import Device
from gateway.simulator.faults import NO_FAULTS, Faults

#: "Comms locations are addressed 1-99"; the table of times ends with 16 outputs and 16 inputs.
AREAS: Final[Mapping[Area, tuple[Range, ...]]] = {
    Area.COILS: ((0, 15),),
    Area.DISCRETE: ((0, 15),),
    Area.HOLDING: ((1, 99),),
}


class Mint(Device):
    """A controller. All values are 0 at first."""

    modes = frozenset({"ascii"})
    broadcasts = frozenset({5, 16})
    #: The shortest time of its table.
    answer_time: ClassVar[float] = 0.010

    def __init__(self, unit: int, *, baud: int | None = None, faults: Faults = NO_FAULTS) -> None:
        # Too many locations go beyond 99: for the controller that is an illegal address, not an illegal value.
        profile = replace(builtin_profile("mint"), limits={})
        super().__init__(unit, profile, AREAS, {}, baud=baud, faults=faults)
