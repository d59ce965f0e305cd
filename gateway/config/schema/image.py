"""The keys of `[[image]]`: register images and mirrors."""

from typing import Annotated, Literal

from pydantic import Field

from gateway.config.schema.profile import Limit
from gateway.config.schema.table import Table
from gateway.config.values.key_types import (
    Item,
    ListOf,
    LongerDuration,
    Name,
    OwnUnit,
    PointAddresses,
    Ranges,
)
from gateway.registers.datatypes import DataType, Swap

#: What a read gets of a stale value.
WhenStale = Literal["exception", "hold"] | Annotated[int, Field(ge=0, le=65535)]


class Polled(Table):
    """A range of addresses that a mirror polls."""

    holding: Ranges | None = Field(None, description="Holding registers to read.")
    input: Ranges | None = Field(None, description="Input registers to read.")
    coils: Ranges | None = Field(None, description="Coils to read.")
    discrete: Ranges | None = Field(None, description="Discrete inputs to read.")
    every: LongerDuration = Field(description="Time from one poll to the next.")


class Mapped(Table):
    """A row of a virtual unit: a value or a range of a device, the freshness of devices, or the age of one."""

    at: Annotated[int, Field(ge=0, le=65535)] | str = Field(
        description="First address in this unit; with a profile also the name of one of its points."
    )
    area: Literal["holding", "input", "coils", "discrete"] = Field("holding", description="Area in this unit.")
    device: str | None = Field(None, description="Name of the device, or of a local image.")
    point: str | None = Field(
        None, description="Name of a point of the device; `*` for all of its points, one behind the other."
    )
    holding: PointAddresses | None = Field(None, description="Holding registers of the device, as they are.")
    input: PointAddresses | None = Field(None, description="Input registers of the device, as they are.")
    coils: PointAddresses | None = Field(None, description="Coils of the device.")
    discrete: PointAddresses | None = Field(None, description="Discrete inputs of the device.")
    every: LongerDuration | None = Field(None, description="Time from one read of it to the next.")
    type: DataType | None = Field(
        None, description="Type in which the value of a point is written here. Default: its registers as they are."
    )
    swap: Swap | None = Field(None, description="Order of words and bytes here; of a range, in each pair of registers.")
    scale: Limit | None = Field(None, description="The register here is (value - offset) / scale, rounded.")
    offset: Limit | None = Field(None, description="See `scale`.")
    write: bool = Field(False, description="Writes to it go to the device.")
    when_stale: WhenStale | None = Field(None, description="As for the whole unit, for this row.")
    fresh: Annotated[tuple[str, ...], ListOf] = Field(
        (), description="One bit for each of these devices, the lowest first: 1 while all of its rows are fresh."
    )
    age: str | None = Field(None, description="Seconds since the last answer of this device; 65535: none yet.")


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
    """A unit that the gateway answers itself: a register image, or with `of` a mirror of a device."""

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
        (), description="Makes it a virtual unit: where its registers come from."
    )
    stale: LongerDuration = Field(
        2.0, description="Mirrors and virtual units: older values are answered with exception 0B."
    )
    when_stale: WhenStale = Field(
        "exception",
        description="Virtual units: what a read gets of stale values: `exception` 0B, `hold` (the last value), or a "
        "number in each register or coil.",
    )

    @property
    def label(self) -> str:
        """Give its name, or its default name."""
        return self.name or f"image-{self.unit}"
