"""A profile: the rules that a request to a kind of device must satisfy before it is sent."""

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields

from gateway.errors import IllegalAddress, IllegalFunction, IllegalValue
from gateway.modbus.codes import Area, FunctionCode
from gateway.modbus.functions import BROADCAST_FUNCTIONS, WIDE
from gateway.modbus.pdu import ADDRESSES, RequestPdu, Span, parse_request, parse_sent, parse_wide, spans_of
from gateway.profiles.guards import NO_GUARDS, Guards
from gateway.profiles.identity import Identity
from gateway.profiles.point import Point
from gateway.registers.items import REGISTER, WIDE_REGISTER
from gateway.registers.masks import read_before, write_after, written_bits
from gateway.timing.table import TimingTable

#: First and last address of a range.
Range = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Profile:
    """What a kind of device accepts.

    `functions` None allows all; `limits` is the most items for a function; `areas` are the addresses that exist; an
    area that is not named has all. `idle_chars` is the silence that ends a frame for this device. With `any_coil`, 05
    may have other values than FF00 and 0000. `quirks` are its other deviations from the protocol. It sleeps after
    `wake` seconds without a request; 0 for never. Registers in `wide` have four bytes. Points are read together over
    gaps of at most `max_gap` addresses, none of them `only_written`. `guarding` makes one whose `guards` hold.
    """

    name: str
    title: str = ""
    maker: str = ""
    functions: frozenset[int] | None = None
    limits: dict[int, int] = field(default_factory=dict)
    areas: Mapping[Area, tuple[Range, ...]] = field(default_factory=dict)
    idle_chars: float = 3.5
    timing: TimingTable = field(default_factory=TimingTable)
    margin: float = 1.5
    timeout: float = 1.0
    any_coil: bool = False
    quirks: frozenset[str] = frozenset()
    wake: float = 0.0
    wide: Mapping[Area, tuple[Range, ...]] = field(default_factory=dict)
    max_gap: int = 0
    only_written: tuple[Span, ...] = ()
    identity: Identity | None = None
    guards: Guards = NO_GUARDS

    def guarding(self, points: Iterable[Point]) -> "Profile":
        """Make the profile of a device that has these points, of which those with limits are guarded."""
        guards = Guards.of(points)
        kind = GuardedProfile if guards else Profile
        return kind(**{each.name: getattr(self, each.name) for each in fields(self)} | {"guards": guards})

    def check(self, pdu: bytes) -> RequestPdu:
        """Parse `pdu`, and check that this kind of device accepts it.

        The order is that of the specification (A 7): function, then structure and quantity, then addresses.

        Raises:
            IllegalFunction: the device does not know the function.
            IllegalValue: the structure is wrong, or there are more items than the device allows.
            IllegalAddress: an address does not exist.
        """
        if not self.knows(pdu[0]):
            raise IllegalFunction(f"profile {self.name} has no function {pdu[0]}")
        try:
            asked = parse_wide(pdu) if self.wide and self._is_for_wide(pdu) else parse_request(pdu)
        except IllegalValue:
            if not self.any_coil or pdu[0] != FunctionCode.WRITE_SINGLE_COIL:
                raise
            asked = parse_sent(pdu)
        limit = self.limits.get(asked.function)
        if limit is not None and asked.items > limit:
            raise IllegalValue(f"profile {self.name} allows {limit} items of function {asked.function}")
        if self.areas:
            self._check_addresses(asked)
        return asked

    def check_in_one_turn(self, pdu: bytes, function: int) -> RequestPdu:
        """Parse a PDU of function 22, and check that this kind of device accepts a read, and a write with `function`.

        That write must be checked again when it is known.

        Raises:
            RequestError: as `check`.
        """
        asked = parse_request(pdu)
        for part in (read_before(pdu), write_after(pdu, 0, function)):
            Profile.check(self, part)  # the guards are for the register as it will be
        return asked

    def masks(self, pdu: bytes) -> bool:
        """Tell whether a PDU of function 22 that the gateway itself has made is sent as it is."""
        return self.names(pdu[0])

    def has_wide(self, span: Span) -> bool:
        """Tell whether one of the items has four bytes."""
        return width_at(self.wide, span) != REGISTER

    def names(self, function: int) -> bool:
        """Tell whether the profile says that the device has this function."""
        return self.functions is not None and function in self.functions

    def knows(self, function: int) -> bool:
        """Tell whether the device has this function."""
        return self.functions is None or function in self.functions

    @property
    def broadcasts(self) -> frozenset[int]:
        """The functions that the device executes as broadcasts."""
        return BROADCAST_FUNCTIONS if self.functions is None else BROADCAST_FUNCTIONS & self.functions

    def _is_for_wide(self, pdu: bytes) -> bool:
        """Tell whether a request is for registers of four bytes: all of them are, and it is 03, 04 or 16.

        Raises:
            IllegalFunction: another function does not know such registers.
            IllegalAddress: only some of the registers have four bytes.
        """
        span = next((span for span in spans_of(pdu) if self.has_wide(span)), None)
        if span is None:
            return False
        if pdu[0] not in WIDE:
            raise IllegalFunction(f"function {pdu[0]} is not for registers of four bytes such as {span.addresses}")
        if not covers(self.wide[span.area], span):
            raise IllegalAddress(f"only some of {span.area} {span.addresses} have four bytes")
        return True

    def _check_addresses(self, asked: RequestPdu) -> None:
        for span in (asked.read, asked.write):
            if span is not None and not covers(self.areas.get(span.area), span):
                raise IllegalAddress(f"profile {self.name} has no {span.area} {span.addresses}")


class GuardedProfile(Profile):
    """A profile with guards. Others do not look at the values that are written, so they need no time for it."""

    __slots__ = ()

    def check(self, pdu: bytes) -> RequestPdu:
        """Parse and check `pdu`, and what it writes.

        Raises:
            RequestError: as `Profile.check`; IllegalValue if a guard does not hold.
        """
        asked = Profile.check(self, pdu)
        if asked.write is not None:
            self.guards.check(asked)
        return asked

    def check_in_one_turn(self, pdu: bytes, function: int) -> RequestPdu:
        """Check a read and a write, and the guards of the bits. See `Profile.check_in_one_turn`."""
        asked = Profile.check_in_one_turn(self, pdu, function)
        if asked.write is not None:
            self.guards.check_bits(asked.write, *written_bits(pdu))
        return asked

    def masks(self, pdu: bytes) -> bool:
        """Tell whether a PDU of function 22 is sent as it is: not where a guard needs to see the register."""
        return Profile.masks(self, pdu) and not any(self.guards.touch(span) for span in spans_of(pdu))


def width_at(wide: Mapping[Area, tuple[Range, ...]] | Mapping[str, tuple[Range, ...]], span: Span) -> int | None:
    """Return how many bytes the registers of a span have, of which `wide` ones have four; None if some have two."""
    ranges = wide.get(span.area, ())
    if covers(ranges, span):
        return WIDE_REGISTER
    before_end = bisect_left(ranges, (span.end, 0))
    return None if before_end and span.start <= ranges[before_end - 1][1] else REGISTER


def covers(ranges: tuple[Range, ...] | None, span: Span) -> bool:
    """Tell whether all of `span` is in one of `ranges` (ascending, adjacent ones joined); None is no limit."""
    if ranges is None:
        return True
    begun = bisect_right(ranges, (span.start, ADDRESSES))
    return begun > 0 and span.end - 1 <= ranges[begun - 1][1]
