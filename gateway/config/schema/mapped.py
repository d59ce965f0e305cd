"""The keys of a row of a virtual unit: `[[image]] map`."""

from typing import Annotated, Literal

from pydantic import Field

from gateway.config.schema.profile import Limit
from gateway.config.schema.table import Table
from gateway.config.values.key_types import ListOf, LongerDuration, MapPlace, Name, PointAddresses, WhenStale
from gateway.registers.datatypes import DataType, Swap


class Mapped(Table):
    """A row of a virtual unit: a point or a range of a device, the freshness of devices, or the age of one."""

    at: MapPlace = Field(
        description="Its first address in this unit; where the profile of the unit has points, also the name of one: "
        "then place, type, order and scale are those of that point."
    )
    area: Literal["holding", "input", "coils", "discrete"] = Field("holding", description="Its area in this unit.")
    device: Name | None = Field(None, description="The name of a device, or of an image: where its values come from.")
    point: Name | None = Field(
        None,
        description="The name of a point of the device; `*` for all of its points, one behind the other: those of "
        "registers, or with `area` `coils` or `discrete` the others.",
    )
    holding: PointAddresses | None = Field(
        None, description='Holding registers of the device, as they are: an address, or a range `"100-109"`.'
    )
    input: PointAddresses | None = Field(None, description="The same for input registers.")
    coils: PointAddresses | None = Field(None, description="The same for coils.")
    discrete: PointAddresses | None = Field(None, description="The same for discrete inputs.")
    every: LongerDuration | None = Field(
        None,
        description="Time from one read to the next. Required with `device`; one request reads the whole row. Not for "
        "devices of a monitor line: their values come when all of the row is heard in one answer.",
    )
    type: DataType | None = Field(
        None,
        description="With `point`: how its value is written here. Default: its registers as the device has them; bits "
        "and bytes of a register, coils and discrete inputs are one register with their number.",
    )
    swap: Swap | None = Field(
        None, description="With `type`: as for points. Of a range: each pair of registers is turned so."
    )
    scale: Limit | None = Field(
        None,
        description="With `type`: the number in the registers here is (value - `offset`) / `scale`, rounded. Default: "
        "1.",
    )
    offset: Limit | None = Field(None, description="See `scale`. Default: 0.")
    write: bool = Field(
        False, description="Writes to it go to the device. Only of holding registers and coils, here and there."
    )
    when_stale: WhenStale | None = Field(None, description="As for the whole unit, for this row.")
    fresh: Annotated[tuple[Name, ...], ListOf] = Field(
        (),
        description="Instead of `device`: one bit for each of these, the lowest first, 16 in a register: 1 while all "
        "of its rows are fresh.",
    )
    age: Name | None = Field(
        None,
        description="Instead of `device`: a register with the seconds since the last answer of this one; 65535: none "
        "yet.",
    )
