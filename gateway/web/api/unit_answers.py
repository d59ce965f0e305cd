"""What the pages of a unit and of an image ask of the gateway behind them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.profile import Range
from gateway.timing.verdict import Verdict


@dataclass(frozen=True, slots=True)
class FunctionTimes:
    """How long the valid responses to one function took, and whether their limit suits them.

    `counts` are those of the buckets below `bounds_ms`, and of one more for all longer times. `share_p99` is the part
    of its limit that 99 of 100 responses needed at most. `late` responses came after theirs, the slowest after
    `latest_ms`, when it was `latest_limit_ms`. `limit_ms` is the present limit, None before the first request.
    `proposed_ms` is what `calibrate` would make of it; None without enough responses, or where no timing table applies.
    """

    function: int
    responses: int
    timeouts: int
    late: int
    latest_ms: float
    latest_limit_ms: float
    bounds_ms: tuple[float, ...]
    counts: tuple[int, ...]
    p50_ms: float | None
    p99_ms: float | None
    share_p99: float | None
    limit_ms: float | None
    proposed_ms: float | None
    verdict: Verdict


@dataclass(frozen=True, slots=True)
class Failure:
    """A request that failed, and its story in sentences. `time` is in seconds since 1970.

    `not_sent` is how many others were not sent because of it, or for the same reason, by result.
    """

    time: float
    client: str
    asked: str
    story: str
    not_sent: tuple[tuple[str, int], ...] = ()


@dataclass(frozen=True, slots=True)
class Kept:
    """Coils or registers that the gateway has without asking anybody: those of an image, or of the mirror `name`.

    A mirror's have an age; None while they are unknown.
    """

    name: str
    items: bytes
    age_ms: float | None
    is_stale: bool


@dataclass(frozen=True, slots=True)
class PolledAge:
    """Addresses that a mirror polls, and how old their values are; None while they are unknown."""

    span: Span
    every_ms: float
    age_ms: float | None


@dataclass(frozen=True, slots=True)
class Written:
    """The last write to these addresses."""

    span: Span
    client: str
    ago_ms: float


@dataclass(frozen=True, slots=True)
class ImageWindow:
    """Some addresses of an image or mirror: `parts` are those that exist, with two bytes for a register, one for a bit.

    A mirror has a `stale` and `ages`. `writes` are the last ones, the newest first.
    """

    unit: int
    name: str
    of: str
    persist: str
    stale_ms: float | None
    areas: Mapping[Area, tuple[Range, ...]]
    parts: Sequence[tuple[Span, bytes]]
    ages: Sequence[PolledAge]
    writes: Sequence[Written]


class UnitAnswers(Protocol):
    """See gateway.web.api.answers."""

    def may(self, unit: int, function: int, host: str) -> bool:
        """Whether [[access]] gives a client at this address the right to a function of a unit."""

    def target(self, unit: int) -> object:
        """What answers for a unit: the same object until a reload changes it; None if nothing does."""

    def answer_times(self, unit: int) -> Sequence[FunctionTimes]:
        """Those of a device, by function; none of a unit that the gateway answers itself."""

    def failures(self, unit: int, host: str) -> Sequence[Failure]:
        """The last failures of a unit that a reader at this address may see, the newest first, with what followed."""

    def kept(self, unit: int, spans: Sequence[Span]) -> Sequence[Kept | None]:
        """What is there of each span without a request: of an image, of a mirror, or of a device that has a mirror."""

    def mirrors_of(self, unit: int) -> Sequence[str]:
        """The names of the mirrors of a device."""

    def image(self, unit: int, span: Span) -> ImageWindow | None:
        """The part of an image or mirror at the addresses of `span`; None if the unit is neither."""
