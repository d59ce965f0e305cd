"""The latest known values of points."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from gateway.modbus.codes import Area
from gateway.operator.operations.answers.values import IF_KNOWN, Address, Bit, Register, Told

#: Whether a value is known, and as young as it should be; what is `invalid` says that there is none.
ValueState = Literal["fresh", "stale", "invalid", "never"]


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownValue:
    """What was last heard of the `point` of the device `name`, which clients know as `unit`, if at all.

    `value` is in the `measure`, such as kg, and `text` is how it is shown, without that. It was asked for at `time`,
    which is RFC 3339 text, `age_ms` ago, by the client `source`. What was never heard has no value and no age. What is
    older than `stale_ms` is stale.
    """

    unit: int | None
    name: str
    point: str
    area: Area
    address: Address
    reference: str
    bits: Sequence[Bit] | None = field(default=None, metadata=IF_KNOWN)
    value: Told
    text: str
    measure: str | None = field(default=None, metadata=IF_KNOWN)
    registers: Sequence[Register]
    state: ValueState
    age_ms: float | None
    time: str | None
    source: str | None
    stale_ms: float


@dataclass(frozen=True, slots=True)
class KnownValues:
    """The latest known values of the points that the asker may read, by device, in the order of the config.

    `hint` says what to do if no device has a point; else it is empty.
    """

    values: Sequence[KnownValue]
    hint: str = ""
