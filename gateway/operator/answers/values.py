"""Values of a unit: what was read or written, and what an image has."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Final, Literal

from gateway.modbus.codes import Area
from gateway.operator.parameters import Within

#: Metadata of a field that is not told while it is None.
IF_KNOWN: Final[Mapping[str, Any]] = {"if_known": True}

Address = Annotated[int, Within(0, 65535)]
Register = Annotated[int, Within(0, 65535)]
#: A number, or text. None stands for a number that JSON cannot have, such as an infinite one.
Told = float | str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Value:
    """A value. A `point` has a name and mostly a `unit`. `reference` is its number in many manuals: holding 0 is 40001.

    `old` is what was there before a write, where that was asked for.
    """

    point: str | None = field(default=None, metadata=IF_KNOWN)
    area: Area | None = field(default=None, metadata=IF_KNOWN)
    address: Address
    reference: str
    value: Told
    old: Told = field(default=None, metadata=IF_KNOWN)
    unit: str | None = field(default=None, metadata=IF_KNOWN)
    registers: Sequence[Register]


@dataclass(frozen=True, slots=True, kw_only=True)
class Failure:
    """Addresses that could not be read, and the exception in place of their values."""

    area: Area
    address: Address
    count: int
    exception: int
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Values:
    """Values of a unit: of one `area`, or points, which each have their own. `elapsed_ms` is how long requests took."""

    unit: int
    name: str
    area: Area | None = field(default=None, metadata=IF_KNOWN)
    values: Sequence[Value]
    elapsed_ms: float
    errors: Sequence[Failure] | None = field(default=None, metadata=IF_KNOWN)


@dataclass(frozen=True, slots=True, kw_only=True)
class Points(Values):
    """All points of a unit that can be read, which were read `age_ms` ago."""

    age_ms: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """A value of an image or mirror, as the page shows it in `text`.

    A mirror's has an age. `writer` is the client that has written last, if that is known, `written_ms` ago.
    """

    address: Address
    reference: str
    value: Told
    unit: str | None = field(default=None, metadata=IF_KNOWN)
    registers: Sequence[Register]
    text: str
    state: Literal["fine", "stale", "unknown"]
    age_ms: float | None = field(default=None, metadata=IF_KNOWN)
    writer: str | None = field(default=None, metadata=IF_KNOWN)
    written_ms: float | None = field(default=None, metadata=IF_KNOWN)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cells:
    """Addresses of an image or mirror. Clients get no values of a mirror that are older than `stale_ms`."""

    unit: int
    name: str
    area: Area
    stale_ms: float | None
    values: Sequence[Cell]
