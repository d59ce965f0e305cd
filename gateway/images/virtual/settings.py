"""What a virtual unit consists of: rows of values, bits and ages of their sources, and registers of its own."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from gateway.images.image import ImageSettings
from gateway.images.polls import Poll
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.point import Point
from gateway.profiles.profile import Profile, Range

#: What a read gets of a stale value: exception 0B, the last value, or a number in each of its registers or coils.
WhenStale = Literal["exception", "hold"] | int


@dataclass(frozen=True, slots=True)
class MappedValue:
    """A row: `place` in the virtual unit has what `poll` reads of a device, or of an image, with one request.

    With a `point` it is the value of that, encoded as `target` says; without a `target`, its registers as the device
    has them. Without a point it is all that is read; `swap` turns each pair of registers, as for points. Only with
    `write` do writes go to the device.
    """

    place: Span
    device: str
    poll: Poll
    point: Point | None = None
    target: Point | None = None
    swap: str = "none"
    write: bool = False
    when_stale: WhenStale = "exception"
    source: str = field(default="", compare=False)


@dataclass(frozen=True, slots=True)
class FreshBits:
    """One bit for each device, 1 while all of its rows are fresh: bits of registers, the lowest first, or coils."""

    place: Span
    devices: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class SourceAge:
    """A register with the seconds since the device's last answer; 65535 if there was none."""

    place: Span
    device: str


@dataclass(frozen=True, slots=True)
class VirtualSettings:
    """A virtual unit. `areas` are all of its addresses, `own` the image of those that are its own registers.

    Values older than `stale` seconds are not sent, unless a row says otherwise.
    """

    unit: int
    name: str
    profile: Profile
    areas: Mapping[Area, tuple[Range, ...]]
    own: ImageSettings
    values: tuple[MappedValue, ...]
    fresh: tuple[FreshBits, ...] = ()
    ages: tuple[SourceAge, ...] = ()
    stale: float = 2.0
    source: str = field(default="", compare=False)

    @property
    def label(self) -> str:
        """What logs and the trace call it: the client of its polls."""
        return f"virtual unit {self.name}"

    @property
    def devices(self) -> tuple[str, ...]:
        """The names of its sources, each once, in the order of the config."""
        return tuple(dict.fromkeys(each.device for each in self.values))
