"""A virtual unit on the table: its devices answer when the test says so, and time is a number."""

from gateway.images.image import Image, ImageSettings
from gateway.images.polling import DevicePolls, PolledUnit
from gateway.images.polls import Poll
from gateway.images.turns import PollTurns
from gateway.images.virtual.row import Source
from gateway.images.virtual.settings import MappedValue, VirtualSettings
from gateway.images.virtual.unit import VirtualUnit
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.holes import Holes
from gateway.profiles.profile import Profile
from gateway.profiles.read_rules import ReadRules
from gateway.request import Caller, Origin, Request
from gateway.trace.ring import Ring
from kit.target import CallingTarget

GENERIC = Profile("generic")


def holding(at: int, device: str, first: int, count: int = 1, **keys) -> MappedValue:
    """A row of holding registers as they are."""
    poll = Poll(Area.HOLDING, first, first + count - 1, 1.0)
    return MappedValue(Span(Area.HOLDING, at, count), device, poll, **keys)


def coils(at: int, device: str, first: int, count: int = 1, **keys) -> MappedValue:
    """A row of coils as they are."""
    return MappedValue(Span(Area.COILS, at, count), device, Poll(Area.COILS, first, first + count - 1, 1.0), **keys)


def value(at: int, device: str, point, target=None, **keys) -> MappedValue:
    """A row of a value, converted to the encoding of `target` if there is one; `at` is the place of the first item."""
    span, shape = point.read_span, target or point
    poll = Poll(span.area, span.start, span.end - 1, 1.0, width=point.width)
    place = Span(Area.COILS if shape.area in (Area.COILS, Area.DISCRETE) else Area.HOLDING, at, shape.count)
    return MappedValue(place, device, poll, point, target, **keys)


class Device(Origin):
    """A device of which requests wait until the test answers them; the Origin of its polls too."""

    def __init__(self, name: str, bench: "Bench", profile: Profile = GENERIC) -> None:
        self.caller = Caller.without_address("polls")
        self.holes = Holes()
        self.asked: list[Request] = []
        self.rests = False
        self._bench = bench
        self.polls = DevicePolls(
            PolledUnit(name, 1, ReadRules.of(profile)), self, self, PollTurns(), bench.events.append
        )
        self.source = Source(self.polls, CallingTarget(self.submit), profile)

    def submit(self, request, now, *, yields=False):
        assert yields == (request.origin is self)
        self.asked.append(request)

    def is_resting(self, now):
        return self.rests

    @property
    def questions(self) -> list[str]:
        return [request.pdu.hex(" ").upper() for request in self.asked]

    def answers(self, pdu: str | None, which: int = 0) -> None:
        """Answer a question, the oldest one unless said otherwise."""
        request = self.asked.pop(which)
        request.respond(bytes.fromhex(pdu)) if pdu is not None else request.end()

    def has(self, pdu: str) -> list[str]:
        """Let polls that are due be sent, and answer all of them so; what was asked."""
        asked = self._bench.poll(self)
        for _ in asked:
            self.answers(pdu)
        return asked

    # the origin of its polls

    def wants(self, request):
        return True

    def answer(self, request, pdu):
        self.polls.polled(request, pdu, self._bench.now)


class Bench:
    """A virtual unit with the devices that its rows name."""

    def __init__(self, *rows, own=None, stale=2.0, profile=GENERIC, profiles=(), **keys) -> None:
        self.events = []
        self.now = 0.0
        self.ring = Ring(100_000)
        names = dict.fromkeys(row.device for row in rows)
        self.devices = {name: Device(name, self, dict(profiles).get(name, GENERIC)) for name in names}
        self.unit = self.made(*rows, own=own, stale=stale, profile=profile, **keys)
        self.start()

    def made(self, *rows, own=None, stale=2.0, profile=GENERIC, fresh=(), ages=()) -> VirtualUnit:
        own = {area: _joined(ranges) for area, ranges in (own or {}).items()}
        areas = {area: [(span.start, span.end - 1) for span in self._places(rows, fresh, ages, area)] for area in Area}
        for area, ranges in own.items():
            areas[area] += ranges
        areas = {area: _joined(ranges) for area, ranges in areas.items()}
        settings = VirtualSettings(
            240, "hall", profile, areas, ImageSettings(240, "hall", profile, own), rows, fresh, ages, stale, "a.toml:9"
        )
        self.own = Image(settings.own, self.events.append, self.ring)
        sources = {name: device.source for name, device in self.devices.items()}
        return VirtualUnit(settings, sources, self.own, self, self.events.append, self.ring)

    def start(self) -> None:
        for device in self.devices.values():
            parts = tuple(part for polls, part in self.unit.wanted() if polls is device.polls)
            device.polls.change(parts, (), self.now)

    def reload(self, new: VirtualUnit) -> None:
        """Replace the unit as a reload does."""
        new.take_over(self.unit)
        for device in self.devices.values():
            gone = tuple(part for polls, part in self.unit.wanted() if polls is device.polls)
            device.polls.change((), gone, self.now)
        self.unit.close(self.now)
        self.unit = new
        self.start()

    def __getitem__(self, name: str) -> Device:
        return self.devices[name]

    def poll(self, device: Device) -> list[str]:
        """Send the polls of a device that are due; all that it is asked then."""
        deadline = device.polls.deadline()
        if deadline is not None and deadline <= self.now:
            device.polls.tick(self.now)
        return device.questions

    def passed(self, request, polls, sent, response):
        if polls is not None:
            self.unit.wrote(request, polls, sent, response, self.now)
        self.unit.passed(request, response, self.now)

    def client(self, name: str = "10.0.0.9:1") -> "Client":
        return Client(self, name)

    def _places(self, rows, fresh, ages, area):
        return [each.place for each in (*rows, *fresh, *ages) if each.place.area is area]


class Client(Origin):
    """A client: `came` is what it has got since it was last looked at."""

    def __init__(self, bench: Bench, name: str) -> None:
        self.caller = Caller(name, "127.0.0.1", "127.0.0.1")
        self.requests: list[Request] = []
        self._bench = bench
        self._came = []

    def wants(self, request):
        return True

    def answer(self, request, pdu):
        self._came.append(None if pdu is None else pdu.hex(" ").upper())

    def requested(self, pdu: bytes) -> None:
        """Ask; what has come is to be looked at later."""
        came = self.ask(pdu.hex())
        self._came += came

    def ask(self, pdu: str, in_one_turn: int = 0) -> list[str]:
        request = Request(240, bytes.fromhex(pdu), self, self._bench.now)
        request.in_one_turn = in_one_turn
        self.requests.append(request)
        self._bench.unit.submit(request, self._bench.now)
        return self.came()

    def came(self) -> list[str]:
        came, self._came = self._came, []
        return came

    @property
    def why(self) -> str:
        """Why its last request got an exception."""
        return str(self.requests[-1].error)


def _joined(ranges):
    found = []
    for first, last in sorted(ranges):
        if found and found[-1][1] + 1 == first:
            found[-1] = (found[-1][0], last)
        else:
            found.append((first, last))
    return tuple(found)
