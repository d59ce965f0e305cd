"""The keys of `[[image]]`: register images, mirrors, virtual units and their rows, and units made in Python."""

from typing import Annotated, Literal

from pydantic import Field

from gateway.config.schema.profile import Limit
from gateway.config.schema.table import Table
from gateway.config.values.key_types import (
    Item,
    ListOf,
    LongerDuration,
    MapPlace,
    Name,
    OwnUnit,
    PointAddresses,
    PythonClass,
    Ranges,
    WhenStale,
)
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


class Polled(Table):
    """A range of addresses that a mirror polls."""

    holding: Ranges | None = Field(None, description="Holding registers to read.")
    input: Ranges | None = Field(None, description="Input registers to read.")
    coils: Ranges | None = Field(None, description="Coils to read.")
    discrete: Ranges | None = Field(None, description="Discrete inputs to read.")
    every: LongerDuration | None = Field(
        None,
        description="Time from one poll to the next. Required, but for a device of a monitor line: that is never "
        "polled, and its values come when they are heard.",
    )


class InitialValues(Table):
    """Initial values from one address on."""

    at: Annotated[int, Field(ge=0, le=65535)] = Field(description="Address of the first value.")
    values: Annotated[tuple[Item, ...], ListOf] = Field(description="The values: 0-65535, or `true` and `false`.")


class Initial(Table):
    """Initial values of an image; all others are 0."""

    holding: Annotated[tuple[InitialValues, ...], ListOf] = Field((), description="Holding registers.")
    input: Annotated[tuple[InitialValues, ...], ListOf] = Field((), description="Input registers.")
    coils: Annotated[tuple[InitialValues, ...], ListOf] = Field((), description="Coils.")
    discrete: Annotated[tuple[InitialValues, ...], ListOf] = Field((), description="Discrete inputs.")


class Image(Table):
    """A unit that the gateway answers itself: a register image, with `of` a mirror, with `map` a virtual unit.

    A virtual unit gathers registers of many devices in one block. `holding`, `input`, `coils` and `discrete` are those
    of its own, beside them; addresses that are neither are answered with exception 02. With `python` it is a
    [unit made in Python](images.md#a-unit-made-in-python).
    """

    unit: OwnUnit = Field(
        description="Its unit ID for clients, 1-247; or 255, which many Modbus TCP clients use for the server itself."
    )
    name: Name | None = Field(None, description="Its name in logs. Default: `image-` and the unit ID.")
    profile: str = Field("generic", description="What it accepts: functions, limits, addresses.")
    holding: Ranges = Field((), description="Its holding registers.")
    input: Ranges = Field((), description="Its input registers.")
    coils: Ranges = Field((), description="Its coils.")
    discrete: Ranges = Field((), description="Its discrete inputs.")
    persist: Literal["never", "interval", "always"] = Field(
        "never",
        description="`interval`: a crash loses at most 1 s of writes, a normal stop none. `always`: each write is on "
        "disk before it is acknowledged.",
    )
    initial: Initial = Field(
        Initial(), description="Initial values, such as `initial.holding = [{ at = 0, values = [1, 2, 3] }]`."
    )
    of: str | None = Field(
        None, description="Makes it a mirror: the name of the device to poll, once for any number of clients."
    )
    read: Annotated[tuple[Polled, ...], ListOf] = Field((), description="Mirrors: what to poll, and how often.")
    map: Annotated[tuple[Mapped, ...], ListOf] = Field(
        (), description="Makes it a virtual unit: rows that say where its registers come from."
    )
    stale: LongerDuration = Field(
        2.0, description="Mirrors and virtual units: older values are answered with exception 0B."
    )
    when_stale: WhenStale = Field(
        "exception",
        description="Virtual units: what a read gets of stale values: `exception` (0B), `hold` (the last value; 0B as "
        "long as there was none), or a number in each register or coil. All but `exception` needs a `fresh` bit for "
        "each device.",
    )

    python: PythonClass | None = Field(
        None,
        description="Makes it a unit made in Python: the module and its class, which is found among what is installed "
        "for the Python of the gateway, then beside the config file. It has all addresses, unless `holding`, `input`, "
        "`coils` or `discrete` name some, or its profile does.",
    )
    timeout: LongerDuration = Field(
        1.0, description="Units made in Python: how long a request may take; then it is answered with exception 0B."
    )

    @property
    def label(self) -> str:
        """Give its name, or its default name."""
        return self.name or f"image-{self.unit}"
