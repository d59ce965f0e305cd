"""A simulated device: returns the response to a request and the time until it. It has no line and no clock."""

from collections.abc import Iterable, Mapping
from typing import ClassVar, Literal, NamedTuple

from gateway.errors import IllegalAddress, IllegalFunction, RequestError
from gateway.images.tables import Values, make_tables, perform
from gateway.modbus.codes import BROADCAST_UNIT, Area
from gateway.modbus.frame import Frame
from gateway.modbus.functions import BROADCAST_FUNCTIONS, TABLE_FUNCTIONS
from gateway.modbus.pdu import RequestPdu, exception_response
from gateway.profiles.profile import Profile, Range
from gateway.simulator.faults import NO_FAULTS, Faults

Mode = Literal["rtu", "ascii"]


class Answer(NamedTuple):
    """A frame that a device begins to send `delay` seconds after it has detected the end of the request."""

    delay: float
    frame: Frame


class Device:
    """Four tables of values and the rules of a profile. Each kind of device adds its own rules.

    `unit` and `faults` may be changed at any time. `baud` is the rate of the device; None means any rate of the port.
    `tables` holds the values, by area.
    """

    #: The modes that this kind of device has.
    modes: frozenset[Mode] = frozenset({"rtu", "ascii"})
    #: The functions that it executes as broadcasts.
    broadcasts: frozenset[int] = BROADCAST_FUNCTIONS
    #: Seconds from a request to the answer, for functions that are not in the profile's table.
    answer_time: ClassVar[float] = 0.005

    def __init__(
        self,
        unit: int,
        profile: Profile,
        areas: Mapping[Area, tuple[Range, ...]],
        initial: Mapping[Area, Iterable[Values]],
        *,
        baud: int | None = None,
        faults: Faults = NO_FAULTS,
    ) -> None:
        self.unit = unit
        self.profile = profile
        self.tables = make_tables(areas, initial)
        self.baud = baud
        self.faults = faults

    def receive(self, frame: Frame, now: float, baud: int) -> Answer | None:
        """Process a frame that has ended at `now`; None if the device does not respond to it.

        `baud` is the rate at which the frame was sent.
        """
        if self.faults.silent or not self.is_meant(frame):
            return None
        delay, response = self._act(frame.pdu, now, baud)
        if not self.answers(frame):
            return None
        return Answer(self.faults.delay(delay, self._allowed(frame.pdu)), Frame(self.unit, response))

    def is_meant(self, frame: Frame) -> bool:
        """Tell whether the device acts on `frame`."""
        if frame.unit == BROADCAST_UNIT:
            return frame.pdu[0] in self.broadcasts
        return frame.unit == self.unit

    def answers(self, frame: Frame) -> bool:
        """Tell whether the device responds to a frame that it has acted on."""
        return frame.unit != BROADCAST_UNIT

    def has(self, asked: RequestPdu) -> bool:
        """Tell whether all addresses of the request exist."""
        return all(span is None or self.tables[span.area].has(span) for span in (asked.read, asked.write))

    def perform(self, asked: RequestPdu, now: float, baud: int) -> bytes:  # noqa: ARG002 - some kinds change with time
        """Execute a checked request; return the response PDU.

        Raises:
            RequestError: the device refuses the values.
        """
        return perform(self.tables, asked)

    def _act(self, pdu: bytes, now: float, baud: int) -> tuple[float, bytes]:
        """Execute a request; return the seconds until the response, and the response PDU."""
        try:
            asked = self._check(pdu)
            time = self.profile.timing.time(asked.function, asked.items)
            return self.answer_time if time is None else time, self.perform(asked, now, baud)
        except RequestError as error:
            return self.answer_time, exception_response(pdu[0], error.code)

    def _allowed(self, pdu: bytes) -> float:
        """Return the seconds that the profile allows for an answer."""
        try:
            asked = self._check(pdu)
        except RequestError:
            return self.profile.timeout
        time = self.profile.timing.time(asked.function, asked.items)
        return self.profile.timeout if time is None else self.profile.margin * time

    def _check(self, pdu: bytes) -> RequestPdu:
        if pdu[0] not in TABLE_FUNCTIONS:
            raise IllegalFunction(f"no device has function {pdu[0]}")
        asked = self.profile.check(pdu)
        if not self.has(asked):
            raise IllegalAddress(f"{self!r} does not have all of {asked!r}")
        return asked

    def __repr__(self) -> str:
        return f"<{type(self).__name__} unit={self.unit}>"
