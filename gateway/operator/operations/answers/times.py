"""Measured response times of a device."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class MeasuredRow:
    """Normal responses of one function with the same number of items.

    `count` is since the start. `times_ms` are the latest, oldest first: from the end of the request to the beginning of
    the response, which is calculated from its end and the line's rate. `longest_ms` is the longest since the start.
    `limit_ms` is the present limit, and `allowed_ms` the part of it for the device.
    """

    function: int
    items: int
    count: int
    times_ms: tuple[float, ...]
    longest_ms: float
    limit_ms: float
    allowed_ms: float


@dataclass(frozen=True, slots=True)
class Measured:
    """A device and its response times. Behind another server `mode` is tcp, without `baud` (0) and `format` (empty)."""

    unit: int | None
    name: str
    source: str
    profile: str
    mode: str
    baud: int
    format: str
    margin: float
    timeout_ms: float
    rows: tuple[MeasuredRow, ...]
