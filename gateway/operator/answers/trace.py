"""What passes on the lines, and the stories of requests that failed."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

#: A record as JSON has it, with `kind` and `time`; see gateway.operator.trace.
Fact = dict[str, Any]


@dataclass(frozen=True, slots=True)
class TracedLine:
    """A line, or an upstream, that facts may name. An upstream has no `baud` and no `format`."""

    name: str
    mode: str
    port: str
    baud: int = 0
    format: str = ""


@dataclass(frozen=True, slots=True)
class TracePage:
    """Facts, and the number to ask for `next`.

    `missed` is how many records before were gone already, `is_all` says that there are no more at the moment, and
    `reaches_back_s` is how old the oldest record is that is kept. `lines` are told to those who ask for them.
    """

    facts: Sequence[Any]
    next: int
    missed: int
    is_all: bool
    reaches_back_s: float
    lines: tuple[TracedLine, ...] = ()


@dataclass(frozen=True, slots=True)
class Stories:
    """Requests that failed, the newest first: of the `unit` that was named, if it was one.

    `clients_that_failed` are those of which any request has failed.
    """

    stories: Sequence[Fact]
    unit: int | None
    clients_that_failed: Sequence[str]
