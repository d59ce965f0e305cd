"""A silo on load cells, which another program weighs."""

from collections.abc import Sequence

from gateway import Area, CustomUnit, IllegalAddress, IllegalValue


class Silo(CustomUnit):
    """Holding register 0 is its weight in kilogrammes; coil 0 sets that to zero."""

    def __init__(self, weight: int = 1200) -> None:
        self.weight = weight

    async def read(self, area: Area, address: int, count: int) -> Sequence[int]:
        """Read the weight."""
        if (area, address, count) != (Area.HOLDING, 0, 1):
            raise IllegalAddress("there is only holding register 0")
        return [self.weight]

    async def write(self, area: Area, address: int, values: Sequence[int]) -> None:
        """Set it to zero."""
        if (area, address) != (Area.COILS, 0):
            raise IllegalAddress("there is only coil 0")
        if values != [1]:
            raise IllegalValue("only 1 does something")
        self.weight = 0
