"""Mirrors and virtual units with many ranges of one device, or of many, which answers when it is told to."""

import sys
from collections import Counter, deque
from collections.abc import Callable, Iterator
from itertools import count

from gateway.events import discard_event
from gateway.images.image import Image, ImageSettings
from gateway.images.mirror import Mirror
from gateway.images.ordered import OrderedUnit
from gateway.images.polling import DevicePolls, PolledUnit
from gateway.images.polls import MirrorSettings, Poll
from gateway.images.turns import PollTurns
from gateway.images.virtual.row import Source
from gateway.images.virtual.settings import FreshBits, MappedValue, SourceAge, VirtualSettings
from gateway.images.virtual.unit import VirtualUnit
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.holes import Holes
from gateway.profiles.profile import Profile
from gateway.profiles.read_rules import ReadRules
from gateway.request import Caller, Origin, Request, Target

#: Each range has so many registers, and so many addresses between it and the next one.
SIZE = 10
APART = 13
EVERY = 60.0
STALE = 1000.0
UNIT = 200
READ, WRITE = 3, 6


class Polled(Target):
    """A device named `name`, and the polls that it was `asked`."""

    def __init__(self, name: str, turns: PollTurns) -> None:
        self.holes = Holes()
        self.asked: deque[Request] = deque()
        self.written: deque[Request] = deque()
        self.rests = False
        self.now = 0.0
        self.polls = DevicePolls(PolledUnit(name, 1, ReadRules()), self, Poller(self, name), turns, discard_event)

    def submit(self, request: Request, now: float, *, yields: bool = False) -> None:
        (self.asked if yields else self.written).append(request)

    def is_resting(self, now: float) -> bool:
        return self.rests

    def answer_one(self, pdu: bytes | None = None) -> None:
        """Answer the oldest poll, with zeros or with what is given."""
        request = self.asked.popleft()
        size = 2 * request.pdu[4]
        request.origin.answer(request, bytes((READ, size)) + bytes(size) if pdu is None else pdu)


class Poller(Origin):
    """The origin of the polls of a device."""

    def __init__(self, polled: Polled, name: str) -> None:
        self.caller = Caller.without_address(f"polls of {name}")
        self._polled = polled

    def wants(self, request: Request) -> bool:
        return True

    def answer(self, request: Request, pdu: bytes | None) -> None:
        self._polled.polls.polled(request, pdu, self._polled.now)


class Client(Origin):
    """It counts its answers, and keeps the last one."""

    def __init__(self, name: str = "10.0.0.9:1") -> None:
        self.caller = Caller(name, "127.0.0.1", "127.0.0.1")
        self.answers = 0
        self.last: bytes | None = None

    def wants(self, request: Request) -> bool:
        return True

    def answer(self, request: Request, pdu: bytes | None) -> None:
        self.answers += 1
        self.last = pdu


class ManyRanges:
    """A `unit` with so many ranges, spread over `devices`, and all of its values are known at first."""

    def __init__(self, ranges: int, *, devices: int = 1, is_mapped: bool = False, is_polled: bool = True) -> None:
        self.ranges = ranges
        self.size = 2 if is_mapped else SIZE
        self.step = self.size if is_mapped else APART
        self.now = 0.0
        turns = PollTurns()
        self.devices = {f"meter-{number}": Polled(f"meter-{number}", turns) for number in range(devices)}
        #: The first of them.
        self.device = self.devices["meter-0"]
        self.client = Client()
        self.unit = self._virtual() if is_mapped else self._mirror()
        found: dict[DevicePolls, list] = {}
        for polls, part in self.unit.wanted():
            found.setdefault(polls, []).append(part)
        for polls, parts in found.items():
            polls.change(parts, (), self.now)
        self._numbers = count()
        if is_polled:
            self.poll_all()

    def passed(self, request, polls, sent, response):
        self.unit.wrote(request, polls, sent, response, self.now)
        self.unit.passed(request, response, self.now)

    def spend(self, seconds: float) -> None:
        """Let time pass; what is due then is not sent yet."""
        self.now += seconds
        for device in self.devices.values():
            device.now = self.now

    def tick(self) -> int:
        """Send what is due. Return how many steps of the loop that took."""
        steps = 0
        for device in self.devices.values():
            while (due := device.polls.deadline()) is not None and due <= self.now:
                device.polls.tick(self.now)
                steps += 1
        return steps

    def answers(self) -> Iterator[Callable[..., None]]:
        """Yield what answers the polls in progress, until there are none."""
        while any(device.asked for device in self.devices.values()):
            for device in self.devices.values():
                if device.asked:
                    yield device.answer_one

    def poll_all(self) -> int:
        """Poll all that is due once; return how many polls that were."""
        polls = 0
        while self.tick() or any(device.asked for device in self.devices.values()):
            for answer in self.answers():
                answer()
                polls += 1
        return polls

    def poll_one(self) -> None:
        """Answer a poll of the first device; all is due again once all was polled."""
        if not self.device.asked:
            self.spend(EVERY)
            self.tick()
        self.device.answer_one()

    def forget_reads(self) -> None:
        """Remember no read, as after many others."""
        self.unit._reads.clear()

    def read(self, number: int | None = None, client: Client | None = None, size: int | None = None) -> None:
        """A client's read of one range, the next one each time."""
        number = next(self._numbers) * 7919 % self.ranges if number is None else number
        self.ask(READ, number * self.step, size or self.size, client)

    def ask(self, function: int, start: int, number: int, client: Client | None = None) -> None:
        """A client's request."""
        pdu = bytes((function, *start.to_bytes(2, "big"), *number.to_bytes(2, "big")))
        self.unit.submit(Request(UNIT, pdu, client or self.client, self.now), self.now)

    def write(self, number: int | None = None) -> None:
        """A client's write of one register, which the device answers."""
        number = next(self._numbers) * 7919 % self.ranges if number is None else number
        self.ask(WRITE, number * self.step, 1)
        for device in self.devices.values():
            while device.written:
                sent = device.written.popleft()
                sent.origin.answer(sent, sent.pdu)

    def _mirror(self) -> OrderedUnit:
        (device,) = self.devices.values()
        ranges = tuple((at * APART, at * APART + SIZE - 1) for at in range(self.ranges))
        polls = tuple(Poll(Area.HOLDING, first, last, EVERY) for first, last in ranges)
        areas = {Area.HOLDING: ranges}
        settings = MirrorSettings(UNIT, "silo", "meter-0", Profile("generic"), polls, areas, STALE)
        return Mirror(settings, device.polls, device, self, discard_event)

    def _virtual(self) -> OrderedUnit:
        """Rows of two registers, and behind them what tells of freshness: a coil of each device, and an age."""
        names, profile = tuple(self.devices), Profile("generic")
        values = tuple(
            MappedValue(
                Span(Area.HOLDING, self.size * row, self.size),
                names[row % len(names)],
                Poll(Area.HOLDING, row // len(names) * APART, row // len(names) * APART + 1, EVERY),
                write=True,
            )
            for row in range(self.ranges)
        )
        areas = {
            Area.HOLDING: ((0, self.size * self.ranges - 1),),
            Area.COILS: ((0, len(names) - 1),),
            Area.INPUT: ((0, 0),),
        }
        own = ImageSettings(UNIT, "own", profile, {})
        fresh = (FreshBits(Span(Area.COILS, 0, len(names)), names),)
        ages = (SourceAge(Span(Area.INPUT, 0, 1), names[0]),)
        settings = VirtualSettings(UNIT, "hall", profile, areas, own, values, fresh, ages, STALE)
        sources = {name: Source(device.polls, device, profile) for name, device in self.devices.items()}
        return VirtualUnit(settings, sources, Image(own), self, discard_event)


def calls_for(step: Callable[[], object], times: int = 1) -> float:
    """How many functions each step calls, those in C too."""
    calls: Counter[str] = Counter()
    sys.setprofile(lambda frame, event, argument: calls.update([event]))
    try:
        for _ in range(times):
            step()
    finally:
        sys.setprofile(None)
    return (calls["call"] + calls["c_call"]) / times
