"""Values of a unit: read, written, or held by an image."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Final, Literal

from gateway.modbus.codes import Area
from gateway.operator.operations.parameters import Within

#: Metadata of a field that is left out while it is None.
IF_KNOWN: Final[Mapping[str, Any]] = {"if_known": True}

Address = Annotated[int, Within(0, 65535)]
#: Of two bytes, or of four where the profile says so.
Register = Annotated[int, Within(0, 2**32 - 1)]
#: A number, or text. None is no value: the device says that it has none, or the registers hold no number.
Told = float | str | None
Bit = Annotated[int, Within(0, 63)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Value:
    """A value. A `point` has a name and often a `unit`. `reference` is its number in many manuals: holding 0 is 40001.

    With `bits`, the first and the last, it is only these of its registers; 0 is the lowest. `old` is the value before a
    write, if that was asked for and there was one. After a write to bits of registers, the `registers` are not known.
    """

    point: str | None = field(default=None, metadata=IF_KNOWN)
    area: Area | None = field(default=None, metadata=IF_KNOWN)
    address: Address
    reference: str
    bits: Sequence[Bit] | None = field(default=None, metadata=IF_KNOWN)
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
    """Values of a unit: of one `area`, or of points, which each name theirs. Requests took `elapsed_ms` in all."""

    unit: int | None
    name: str
    area: Area | None = field(default=None, metadata=IF_KNOWN)
    values: Sequence[Value]
    elapsed_ms: float
    errors: Sequence[Failure] | None = field(default=None, metadata=IF_KNOWN)


@dataclass(frozen=True, slots=True, kw_only=True)
class Points(Values):
    """All points of a unit that can be read; they were read `age_ms` ago."""

    age_ms: float


#: Whether clients get a value; what is invalid is none, or does not fit.
CellState = Literal["fresh", "stale", "unknown", "invalid"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """A value of an image or mirror; `text` is how the page shows it.

    Only a value that is polled has an age; `source` is where that of a virtual unit is from: `meter-1 power`. `writer`
    is the client that wrote it last, `written_ms` ago, if known.
    """

    address: Address
    reference: str
    value: Told
    unit: str | None = field(default=None, metadata=IF_KNOWN)
    registers: Sequence[Register]
    text: str
    state: CellState
    source: str | None = field(default=None, metadata=IF_KNOWN)
    age_ms: float | None = field(default=None, metadata=IF_KNOWN)
    writer: str | None = field(default=None, metadata=IF_KNOWN)
    written_ms: float | None = field(default=None, metadata=IF_KNOWN)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cells:
    """Addresses of an image or mirror. What was polled is stale once it is older than `stale_ms`."""

    unit: int | None
    name: str
    area: Area
    stale_ms: float | None
    values: Sequence[Cell]
