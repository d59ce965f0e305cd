"""Any Modbus device: a hundred coils, inputs, input and holding registers, and all ten functions."""

from collections.abc import Mapping
from typing import Final

from gateway.modbus.codes import Area
from gateway.profiles.profile import Range
from gateway.simulator.builtin import builtin_profile
from gateway.simulator.device import Device
from gateway.simulator.faults import NO_FAULTS, Faults

AREAS: Final[Mapping[Area, tuple[Range, ...]]] = dict.fromkeys(Area, ((0, 99),))


class Generic(Device):
    """A device without rules of its own. All values are 0 at first."""

    def __init__(self, unit: int, *, baud: int | None = None, faults: Faults = NO_FAULTS) -> None:
        super().__init__(unit, builtin_profile("generic"), AREAS, {}, baud=baud, faults=faults)
