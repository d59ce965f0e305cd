"""When values were sampled that a unit has answered: those of mirrors and virtual units are from earlier polls."""

import asyncio
from typing import Final

from gateway.modbus.codes import EXCEPTION_BIT, Area
from gateway.modbus.pdu import Span, parse_sent
from gateway.operator.images.kept import sampled
from gateway.operator.operations.operation import Asker
from gateway.operator.units.reached import image_of
from gateway.operator.values.requests import AwaitedOrigin
from gateway.request import Request
from gateway.runtime.gateway import Gateway


class Sampled:
    """The times when the values of a unit were sampled, of all addresses in the answers to `asker` so far."""

    def __init__(self, gateway: Gateway, unit: int, asker: Asker) -> None:
        self._image: Final = image_of(gateway, unit)
        self._asker = asker
        self._clock: Final = asyncio.get_running_loop().time
        self._times: dict[tuple[Area, int], float] = {}

    def origin(self) -> AwaitedOrigin:
        """Make the origin of a request."""
        return _SampledOrigin(self, self._asker)

    def answered(self, request: Request, pdu: bytes) -> None:
        """Note the times of values that are in a response. It comes now, before the next poll is answered."""
        span = None if pdu[0] & EXCEPTION_BIT else parse_sent(request.pdu).read
        if span is None:
            return
        now, times, area = self._clock(), self._times, span.area
        times.update(((area, at), now) for at in range(span.start, span.end))
        for place, time in () if self._image is None else sampled(self._image, span, now):
            for address in range(max(place.start, span.start), min(place.end, span.end)):
                times[area, address] = min(times[area, address], time)

    def age(self, span: Span) -> float:
        """Return how old the oldest of these values is now, in seconds."""
        return self._clock() - min(self._times[span.area, at] for at in range(span.start, span.end))


class _SampledOrigin(AwaitedOrigin):
    """The origin of one request."""

    def __init__(self, times: Sampled, asker: Asker) -> None:
        super().__init__(asker.is_there, asker.caller)
        self._sampled = times

    def answer(self, request: Request, pdu: bytes | None) -> None:
        """Take the response, and note the times of its values."""
        if pdu is not None and not self.outcome.done():
            self._sampled.answered(request, pdu)
        super().answer(request, pdu)
