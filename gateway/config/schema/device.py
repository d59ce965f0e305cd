"""The keys of devices: of those on a line, and of the units behind another server."""

from typing import Annotated, Literal

from pydantic import Field

from gateway.config.schema.profile import PointTable
from gateway.config.schema.table import Table
from gateway.config.values.key_types import Duration, DurationOrZero, ListOf, Name, UnitsFrom0, UnitsOrNone


class Device(Table):
    """A device on a line or behind another server, or several alike in one row."""

    units: UnitsFrom0 = Field(
        alias="unit",
        description="Its unit ID on the wire, 1-247; a set means several devices. 248-255 are reserved by the "
        "specification, but some devices have them. On a line, 0 is for a single device with an unknown address; only "
        "its holding registers can be read. Behind another server, 0-255 are its units.",
    )
    known_as: UnitsOrNone | None = Field(
        None,
        alias="as",
        description="Its unit ID for clients, 1-255; as many as in `unit`. Default: the same; or none, if other "
        "devices have it too, listeners are for one line or upstream each, and no row of `[[access]]` means it. "
        "`none`: it has none, and only a listener for its line or upstream leads to it, and its name; a gateway can "
        "have any number of those. "
        "Of the rows of `[[access]]` without `listen`, only those for all units count for it.",
    )
    name: Name | None = Field(
        None,
        description="Its name in logs; `*` stands for the unit ID for clients, or without one for `unit`. Default: the "
        "name of the line or upstream, and this number.",
    )
    profile: str | None = Field(None, description="The kind of device. Default: the `profile` of the line or upstream.")
    priority: Literal["normal", "high"] = Field(
        "normal",
        description="Who waits for a device with high priority is the first in each round of those who wait for its "
        "line or upstream, like who waits with a write.",
    )
    timeout: Duration | None = Field(
        None, description="How long it may take to begin its response, regardless of its profile."
    )
    wake: DurationOrZero | None = Field(
        None, description="See `wake` of the line. Default: that of its profile, then that of the line."
    )
    points: Annotated[tuple[PointTable, ...], ListOf] = Field(
        (), description="What its registers mean, in addition to the points of its profile."
    )

    @property
    def client_units(self) -> tuple[int, ...]:
        """Give the units that clients use for `units`, in the same order; none if they have none."""
        return self.units if self.known_as is None else self.known_as

    @property
    def numbers(self) -> tuple[int, ...]:
        """Give the numbers that are part of names: the units that clients use, or else those on the wire."""
        return self.client_units or self.units
