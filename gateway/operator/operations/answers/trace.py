"""Results of `trace`, `why` and `meaning`."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from gateway.registers.datatypes import Value

#: A record as a JSON object, with `kind` and `time`; see gateway.operator.trace.trace.
Fact = dict[str, Any]


@dataclass(frozen=True, slots=True)
class TracedLine:
    """A line or upstream that facts may name. An upstream has no `baud` and no `format`."""

    name: str
    mode: str
    port: str
    baud: int = 0
    format: str = ""


@dataclass(frozen=True, slots=True)
class TracePage:
    """Facts, and the number to ask for `next`.

    `missed` counts earlier records that were gone already. `is_all`: there are no more at the moment. `reaches_back_s`
    is the age of the oldest record kept. `lines` is empty unless asked for.
    """

    facts: Sequence[Any]
    next: int
    missed: int
    is_all: bool
    reaches_back_s: float
    lines: tuple[TracedLine, ...] = ()


@dataclass(frozen=True, slots=True)
class Meant:
    """The `value` of a point in a request or response, and as `text` with its unit of measure.

    The value is null if the device says that there is none.
    """

    point: str
    value: Value | None
    text: str


@dataclass(frozen=True, slots=True)
class Meanings:
    """What a request and its response mean: the points that they cover, those written first."""

    points: tuple[Meant, ...]


@dataclass(frozen=True, slots=True)
class Stories:
    """Failed requests, newest first: of the `unit` that was named, if it was one.

    `clients_that_failed` are clients with any failed request.
    """

    stories: Sequence[Fact]
    unit: int | None
    clients_that_failed: Sequence[str]
