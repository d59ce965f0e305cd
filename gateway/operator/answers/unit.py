"""A unit, as clients have to know it."""

from collections.abc import Mapping
from dataclasses import dataclass

from gateway.profiles.point import Point
from gateway.profiles.profile import Range


@dataclass(frozen=True, slots=True)
class UnitHead:
    """A unit for clients: what answers for it, and what it accepts.

    `kind` is device, upstream, image, mirror or gateway. It knows all `functions` where they are None. `limits` are the
    most items of a function. `areas` are the first and last address of each range that exists, by area; all if an area
    is not there. A response takes `longest_wait_ms` at most; 0 for a unit that the gateway answers itself.
    """

    unit: int
    name: str
    kind: str
    profile: str
    functions: tuple[int, ...] | None
    limits: Mapping[int, int]
    areas: Mapping[str, tuple[Range, ...]]
    longest_wait_ms: float


@dataclass(frozen=True, slots=True)
class UnitPicture(UnitHead):
    """A unit for clients, and its points."""

    points: tuple[Point, ...]


@dataclass(frozen=True, slots=True)
class Units:
    """Every unit, by its number."""

    units: tuple[UnitHead, ...]


@dataclass(frozen=True, slots=True)
class RequestAnswer:
    """What became of a request: the response `pdu` in hexadecimal, None if there is none, and how long it took.

    `sent` and `received` are the frames on the line, if there were any. For an exception of the gateway's own, `result`
    and `reason` say why.
    """

    unit: int
    pdu: str | None
    elapsed_ms: float
    sent: str = ""
    received: str = ""
    result: str = ""
    reason: str = ""
