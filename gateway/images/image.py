"""A local register image: a unit that the gateway itself answers for."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from gateway.errors import IllegalDataAddress, IllegalFunction, RequestError
from gateway.images.functions import FUNCTIONS, perform
from gateway.images.tables import make_tables
from gateway.modbus.codes import Area
from gateway.modbus.pdu import RequestPdu
from gateway.profiles.profile import Profile, Range
from gateway.request import Request


@dataclass(frozen=True, slots=True)
class ImageSettings:
    """One image: the addresses that exist in each area, and the values they start with (area -> address -> values).

    `persist` says what of its values outlives the gateway: nothing, all but the last second, or every write that was
    answered.
    """

    unit: int
    name: str
    profile: Profile
    areas: Mapping[Area, tuple[Range, ...]]
    initial: Mapping[Area, tuple[tuple[int, tuple[int, ...]], ...]] = field(default_factory=dict)
    persist: Literal["never", "interval", "always"] = "never"
    source: str = ""


@dataclass(slots=True)
class Counts:
    """What an image has done: requests taken, and exception responses among the answers."""

    requests: int = 0
    exceptions: int = 0


class Image:
    """Four tables behind the rules of a profile; a Target that finishes every request before `submit` returns.

    The profile narrows what an image can do (functions, limits, addresses), so that an image with a device's profile
    answers as the device would. `tables` holds the values, by area.
    """

    def __init__(self, settings: ImageSettings) -> None:
        self.settings = settings
        self.tables = make_tables(settings.areas, settings.initial)
        self.counts = Counts()
        self._profile = settings.profile

    def submit(self, request: Request, now: float) -> None:  # noqa: ARG002 - an image acts at once, whenever that is
        """Answer `request`."""
        self.counts.requests += 1
        try:
            response = perform(self.tables, self._check(request.pdu))
        except RequestError as error:
            self.counts.exceptions += 1
            request.fail(error)
        else:
            request.respond(response)

    def _check(self, pdu: bytes) -> RequestPdu:
        """What `pdu` asks for; nothing was changed yet. The order is that of the specification (A 7).

        Raises:
            RequestError: the function (01), the structure or a limit (03), or an address (02) does not fit.
        """
        if pdu[0] not in FUNCTIONS:
            raise IllegalFunction(f"an image has no function {pdu[0]}")
        asked = self._profile.check(pdu)
        for span in (asked.read, asked.write):
            if span is not None and not self.tables[span.area].has(span):
                raise IllegalDataAddress(f"{self.settings.name} has no {span.area} {span.start}-{span.end - 1}")
        return asked

    def __repr__(self) -> str:
        counts = f"requests={self.counts.requests} exceptions={self.counts.exceptions}"
        return f"<Image {self.settings.name} unit={self.settings.unit} {counts}>"
