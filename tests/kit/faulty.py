"""Devices that answer rightly, on a line that does not: each request may meet a fault, and the line notes which.

    line = FaultyLine(timing, FaultyDevice(1, number=7), share=0.2, seed=4)
    for delay, data in line.received(b"...", now):
        loop.call_later(delay, port.deliver, data)
    line.last.fault

Without I/O; the same seed and the same requests give the same bytes. What a device holds says whose it is: the value of
a register or the pattern of coils is unlike that of any other device, area or address, see `word` and `bit`.

Faults that nobody can detect are left out: an answer that comes later than the late window; a frame that fits a request
to the same unit with the same function, while such a request is on the line or may still be answered (a duplicate, an
unasked frame); and damage that the check sum does not show, one case in 65536 for a CRC, one in 256 for an LRC.
"""

import random
from collections import Counter, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from math import inf
from typing import Final

from gateway.modbus import ascii as ascii_framing
from gateway.modbus import rtu
from gateway.modbus.ascii import lrc
from gateway.modbus.codes import Area, FunctionCode
from gateway.modbus.frame import Frame
from gateway.modbus.pdu import RequestPdu, parse_request
from gateway.modbus.rtu import crc_fits
from gateway.timing.characters import LineTiming
from kit.chance import Chance
from kit.device import Answer, SimulatedDevice
from kit.noise import flipped

#: So much later than it was delivered a chunk may be handed over, in seconds.
_MARGIN: Final = 0.010
#: Items of each area of a device; `number` of devices: together they fill the 16 bits of a register.
ITEMS: Final = 512
NUMBERS: Final = 64
#: A function of the devices that no specification knows: the answer is the device's number and what was sent.
OWN_FUNCTION: Final = 65

_READS = frozenset({1, 2, 3, 4})
_FOREIGN_FUNCTIONS = (1, 2, 3, 4, 5, 6, 15, 16)
EXCEPTION_CODES = (2, 4, 5, 6, 8)
#: The longest time a device thinks, and the longest pause between two chunks of a frame that is not late, in seconds.
_THINKING = 0.005
_PAUSE = 0.004


def word(number: int, area: Area, address: int) -> int:
    """What register `address` of device `number` holds until it is written."""
    return number << 10 | (area is Area.INPUT) << 9 | address


def bit(number: int, area: Area, address: int) -> bool:
    """What coil or discrete input `address` of device `number` holds until it is written."""
    mixed = (number * 2 + (area is Area.DISCRETE)) * 0x9E3779B1 + address * 0x85EBCA6B & 0xFFFFFFFF
    return bool((mixed ^ mixed >> 15) * 0xC2B2AE35 >> 20 & 1)


def counter(number: int, sub_function: int) -> int:
    """What device `number` responds to this sub-function of 08."""
    return (number + sub_function) % 2 * (number << 8 | sub_function)


class Fault(StrEnum):
    """What can happen to one exchange."""

    NONE = "no fault"
    EXCEPTION = "exception"
    LATE = "late"
    LATE_EXCEPTION = "late exception"
    NOISE_THEN_LATE = "noise, then late"
    HALF_LATE = "half in time, half late"
    DUPLICATE = "duplicate at once"
    STALE = "duplicate in another exchange"
    FOREIGN_UNIT = "foreign unit"
    FOREIGN_FUNCTION = "foreign function"
    WRONG_SIZE = "wrong size"
    WRONG_ECHO = "wrong echo fields"
    CUT = "cut"
    FLIPPED = "bits flipped"
    NOISE_BEFORE = "noise before"
    NOISE_BEHIND = "noise behind"
    NOISE_BETWEEN = "noise between"
    HOLES = "holes"
    SILENT = "silent"
    BABBLE = "babble"
    OTHER_CLIENT = "other client"
    ECHO_LOST = "echo lost"
    ECHO_DAMAGED = "echo damaged"
    ECHO_ALONE = "echo alone"


#: Only where the adapter returns what is sent.
ECHO_FAULTS: Final = frozenset({Fault.ECHO_LOST, Fault.ECHO_DAMAGED, Fault.ECHO_ALONE})


@dataclass(frozen=True, slots=True)
class Injection:
    """What happened to one request: the fault, and the code if the device's answer is an exception."""

    fault: Fault
    code: int | None = None


class FaultyDevice(SimulatedDevice):
    """A device whose values say that they are its own. `timeout` is what the gateway allows it, in seconds.

    It sleeps when it was not asked for `sleeps_after` seconds: the first request only wakes it.
    """

    def __init__(self, unit: int, *, number: int, timeout: float = 0.05, sleeps_after: float = inf) -> None:
        super().__init__(unit)
        self.number = number
        self.timeout = timeout
        self.sleeps_after = sleeps_after
        self.asked_at = 0.0
        self.dead_until = 0.0
        self.holding = [word(number, Area.HOLDING, address) for address in range(ITEMS)]
        self.input = [word(number, Area.INPUT, address) for address in range(ITEMS)]
        self.coils = [bit(number, Area.COILS, address) for address in range(ITEMS)]
        self.discrete = [bit(number, Area.DISCRETE, address) for address in range(ITEMS)]

    def respond(self, pdu: bytes) -> bytes:
        """Act on a request; the right answer."""
        if pdu[0] == OWN_FUNCTION:
            return bytes((OWN_FUNCTION, self.number)) + pdu[1:]
        if pdu[0] == FunctionCode.DIAGNOSTICS:
            return pdu[:3] + counter(self.number, pdu[2]).to_bytes(2)
        return self._respond(pdu)


@dataclass(frozen=True, slots=True)
class _Exchange:
    """A request, its right answer, and when what would happen; times in seconds from the request's first byte."""

    device: FaultyDevice
    asked: RequestPdu
    sent: bytes
    now: float
    left: float
    fails_at: float
    limit: float

    @property
    def unit(self) -> int:
        return self.device.unit


class FaultyLine:
    """Devices on one line. `share` of the requests meet a fault, one of `faults` by its weight.

    `latency` is what the gateway allows its port, `late_window` how long it awaits late answers (None: "auto").
    With `echo` the adapter returns what is sent.
    """

    def __init__(
        self,
        timing: LineTiming,
        *devices: FaultyDevice,
        share: float,
        seed: int,
        faults: Mapping[Fault, float] | None = None,
        echo: bool = False,
        latency: float = 0.005,
        late_window: float | None = None,
    ) -> None:
        self.injected: Counter[Fault] = Counter()
        self.last = Injection(Fault.NONE)
        #: The latest requests and what happened to them, the last one included.
        self.latest: deque[tuple[bytes, Injection]] = deque(maxlen=64)
        self.timing = timing
        self.devices = list(devices)
        self.chance = Chance(timing.mode)
        #: Until when frames may come that fit by chance what another client asks, and when something came last.
        self.spurious_until = self.heard_at = 0.0
        self._is_ascii = timing.mode == "ascii"
        self._devices = {device.unit: device for device in devices}
        self._share = share
        self._dice = random.Random(seed)
        possible = faults or dict.fromkeys((each for each in Fault if each is not Fault.NONE), 1.0)
        self._faults = [each for each in possible if echo or each not in ECHO_FAULTS]
        self._weights = [possible[each] for each in self._faults]
        self._echo = echo
        self._latency = latency
        self._late_window = late_window
        self._framer = ascii_framing.AsciiFramer() if self._is_ascii else rtu.RtuFramer(silence=0.0)
        self.encode: Callable[[int, bytes], bytes] = self._framer.encode
        #: Until when an answer of a unit, by function, may still be on its way; and one to another client.
        self._busy: dict[int, dict[int, float]] = {device.unit: {} for device in devices}
        self._strange_until: dict[int, float] = {}
        self._stale: tuple[Frame, bytes] | None = None

    def received(self, data: bytes, now: float) -> list[Answer]:
        """Take one request that was written; what the line delivers after it, in the order of time."""
        frames = self._framer.received(data, now) + self._framer.tick(now)
        return [answer for frame in frames for answer in self._exchange(frame, data, now)]

    def limit(self, device: FaultyDevice, asked: RequestPdu) -> tuple[float, float]:
        """How long the gateway awaits an answer of the device, and how long a late one."""
        longest = self.timing.frame(asked.response_size) if asked.response_size else 0.0
        limit = longest + device.timeout + self._latency
        return limit, 2 * limit if self._late_window is None else self._late_window

    def will_answer_other_client(self, unit: int, function: int, at: float) -> None:
        """Another client has been heard to ask `unit`, which answers at `at`."""
        self._strange_until[unit] = max(self._strange_until.get(unit, 0.0), at + _MARGIN)
        self._busy[unit][function] = max(self._busy[unit].get(function, 0.0), at + _MARGIN)

    def _exchange(self, frame: Frame, data: bytes, now: float) -> list[Answer]:
        left = len(data) * self.timing.character
        if frame.unit == 0:
            for device in self._devices.values():
                device.respond(frame.pdu)
            return [Answer(left, data)] if self._echo else []
        device = self._devices.get(frame.unit)
        if device is None:
            self.last = Injection(Fault.SILENT)
            return [Answer(left, data)] if self._echo else []
        asked = parse_request(frame.pdu)
        self.chance.asked = bytes((frame.unit, frame.pdu[0]))
        limit, _ = self.limit(device, asked)
        exchange = _Exchange(device, asked, data, now, left, left + limit, limit)
        fault = self._choose(exchange)
        answers = self._stale_copy(frame, now, left) + _FAULTS[fault](self, exchange)
        if fault in _SPURIOUS:
            self.spurious_until = max(self.spurious_until, now + max(answers)[0] + _MARGIN)
        self.injected[self.last.fault] += 1
        self.latest.append((data, self.last))
        if self._echo and fault not in ECHO_FAULTS:
            answers.append(Answer(left, data))
        if answers:
            busy = self._busy[frame.unit]
            busy[frame.pdu[0]] = max(busy.get(frame.pdu[0], 0.0), now + max(answers)[0])
        return sorted(answers, key=lambda answer: answer.delay)

    def _choose(self, exchange: _Exchange) -> Fault:
        fault, device = Fault.NONE, exchange.device
        is_asleep, device.asked_at = exchange.now - device.asked_at > device.sleeps_after, exchange.now
        if is_asleep or exchange.now < device.dead_until:
            fault = Fault.SILENT
        elif self._dice.random() < self._share:
            (fault,) = self._dice.choices(self._faults, self._weights)
        if fault in _ONLY and not _ONLY[fault](exchange.asked):
            fault = Fault.CUT
        if fault in _SPURIOUS and self._is_strange(exchange.unit, exchange.now):
            fault = Fault.NONE
        if fault in _TWICE and self._is_owed(exchange.unit, exchange.asked.function, exchange.now):
            fault = Fault.NONE
        self.last = Injection(fault)
        return fault

    # --- right answers ---

    def _answer(self, exchange: _Exchange) -> bytes:
        response = exchange.device.respond(exchange.asked.data)
        self.last = Injection(self.last.fault, response[1] if response[0] & 0x80 else None)
        return self._whole(exchange, response)

    def _refusal(self, exchange: _Exchange) -> bytes:
        code = self._dice.choice(EXCEPTION_CODES)
        self.last = Injection(self.last.fault, code)
        return self._whole(exchange, bytes((exchange.asked.function | 0x80, code)))

    def _whole(self, exchange: _Exchange, response: bytes) -> bytes:
        """A frame that is one even if it comes in pieces."""
        frame = self.encode(exchange.unit, response)
        self.chance.sent(frame)
        return frame

    def _arrival(self, exchange: _Exchange, data: bytes) -> float:
        """When all of `data` has come that a device sends at once."""
        return exchange.left + self._dice.uniform(0.0003, _THINKING) + len(data) * self.timing.character

    def _in_time(self, exchange: _Exchange, data: bytes) -> list[Answer]:
        return [Answer(self._arrival(exchange, data), data)]

    def _after_the_limit(self, exchange: _Exchange) -> float:
        window = 2 * exchange.limit if self._late_window is None else self._late_window
        return exchange.fails_at + self._dice.uniform(0.0001, 0.95 * window)

    def _right(self, exchange: _Exchange) -> list[Answer]:
        return self._in_time(exchange, self._answer(exchange))

    def _exception(self, exchange: _Exchange) -> list[Answer]:
        return self._in_time(exchange, self._refusal(exchange))

    # --- late ---

    def _late(self, exchange: _Exchange) -> list[Answer]:
        return [Answer(self._after_the_limit(exchange), self._answer(exchange))]

    def _late_exception(self, exchange: _Exchange) -> list[Answer]:
        return [Answer(self._after_the_limit(exchange), self._refusal(exchange))]

    def _noise_then_late(self, exchange: _Exchange) -> list[Answer]:
        (noise,) = self._in_time(exchange, self._noise())
        return [noise, *self._late(exchange)]

    def _half_late(self, exchange: _Exchange) -> list[Answer]:
        data = self._answer(exchange)
        at = self._dice.randrange(1, len(data))
        while self._misleads(exchange, data[:at], data):
            at = self._dice.randrange(1, len(data))
        return [Answer(self._arrival(exchange, data), data[:at]), Answer(self._after_the_limit(exchange), data[at:])]

    # --- too often, and of others ---

    def _duplicate(self, exchange: _Exchange) -> list[Answer]:
        data = self._answer(exchange)
        first = self._arrival(exchange, data)
        if self._is_ascii or self._dice.random() < 0.5:
            return [Answer(first, data + data)]
        return [Answer(first, data), Answer(first + self._dice.uniform(0.0, 0.9) * self.timing.t35, data)]

    def _stale_once(self, exchange: _Exchange) -> list[Answer]:
        data = self._answer(exchange)
        self._stale = Frame(exchange.unit, exchange.asked.data), data
        return self._in_time(exchange, data)

    def _stale_copy(self, frame: Frame, now: float, left: float) -> list[Answer]:
        """The last answer once more, if the next request cannot mistake it."""
        stale, self._stale = self._stale, None
        if stale is None or (stale[0].unit, stale[0].pdu[0]) == (frame.unit, frame.pdu[0]):
            return []
        if self._is_strange(stale[0].unit, now):
            return []
        self.spurious_until = now + left + _THINKING + _MARGIN
        return [Answer(left + self._dice.uniform(-0.5, 0.3) * min(left, _THINKING), stale[1])]

    def _foreign_unit(self, exchange: _Exchange) -> list[Answer]:
        quiet = [unit for unit in self._devices if unit != exchange.unit and self._is_quiet(unit, exchange.now)]
        unit = self._dice.choice([*quiet, self._dice.randrange(100, 248)])
        return self._wrong_one_first(exchange, lambda pdu: self.encode(unit, pdu))

    def _foreign_function(self, exchange: _Exchange) -> list[Answer]:
        others = [each for each in _FOREIGN_FUNCTIONS if self._may_be_heard(exchange, each)]
        function = self._dice.choice([*others, 99])
        return self._wrong_one_first(exchange, lambda pdu: self.encode(exchange.unit, bytes((function,)) + pdu[1:]))

    def _wrong_size(self, exchange: _Exchange) -> list[Answer]:
        def change(pdu: bytes) -> bytes:
            if exchange.asked.function not in _READS | {23}:
                return self.encode(exchange.unit, pdu[:-1] if self._dice.random() < 0.5 else pdu + b"\0")
            longer = self._dice.random() < 0.5 or pdu[1] < 3
            data = pdu[2:] + pdu[2:4] if longer else pdu[2:-2]
            return self.encode(exchange.unit, bytes((pdu[0], len(data))) + data)

        return self._wrong_one_first(exchange, change)

    def _wrong_echo(self, exchange: _Exchange) -> list[Answer]:
        def change(pdu: bytes) -> bytes:
            at = self._dice.randrange(1, len(pdu))
            return self.encode(exchange.unit, flipped(pdu, 8 * at + self._dice.randrange(8)))

        return self._wrong_one_first(exchange, change)

    def _wrong_one_first(self, exchange: _Exchange, change: Callable[[bytes], bytes]) -> list[Answer]:
        """A frame that is not the answer, and in half of all cases the answer behind it."""
        right = self._answer(exchange)
        response = self._pdu(right)
        wrong = change(response)
        (answer,) = self._in_time(exchange, wrong)
        if self._dice.random() < 0.5:
            return [answer]
        return [answer, Answer(answer.delay + self._dice.uniform(0.0, _PAUSE), right)]

    def _pdu(self, adu: bytes) -> bytes:
        return bytes.fromhex(adu[3:-4].decode()) if self._is_ascii else adu[1:-2]

    def _is_quiet(self, unit: int, now: float) -> bool:
        return all(until < now for until in self._busy[unit].values())

    def _is_owed(self, unit: int, function: int, now: float) -> bool:
        """Whether an answer is still on its way: a frame that fits could be taken for it."""
        return self._busy[unit].get(function, 0.0) >= now

    def _is_strange(self, unit: int, now: float) -> bool:
        """Whether another client awaits an answer of the unit: a frame that fits could be taken for it."""
        return self._strange_until.get(unit, 0.0) >= now

    def _may_be_heard(self, exchange: _Exchange, function: int) -> bool:
        return function != exchange.asked.function and not self._is_owed(exchange.unit, function, exchange.now)

    def _other_client(self, exchange: _Exchange) -> list[Answer]:
        """Somebody else has asked the same unit, and its answer to them comes before the one to us."""
        asked = exchange.asked
        if asked.function in _READS:
            start, count = asked.read.start, asked.read.count
            address = start + self._dice.randrange(1, 50) if start + count < 200 else self._dice.randrange(start)
            pdu = bytes((asked.function,)) + address.to_bytes(2) + count.to_bytes(2)
        else:
            if not self._may_be_heard(exchange, 3):
                self.last = Injection(Fault.NOISE_BEFORE)
                return self._noise_before(exchange)
            pdu = bytes((3,)) + self._dice.randrange(200).to_bytes(2) + b"\0\1"
        theirs = self.encode(exchange.unit, exchange.device.respond(pdu))
        (answer,) = self._in_time(exchange, theirs)
        ours = Answer(answer.delay + self._dice.uniform(0.0, _PAUSE), self._answer(exchange))
        heard_at = self._dice.uniform(0.0, answer.delay)
        return [Answer(heard_at, self.encode(exchange.unit, pdu)), answer, ours]

    # --- damaged ---

    def _cut(self, exchange: _Exchange) -> list[Answer]:
        return self._damaged(exchange, lambda data: data[: self._dice.randrange(1, len(data))])

    def _flipped(self, exchange: _Exchange) -> list[Answer]:
        """As many bits as the check sum is sure to notice: three for a CRC, one for an LRC."""

        def flip(data: bytes) -> bytes:
            count = 1 if self._is_ascii else self._dice.randint(1, 3)
            for place in self._dice.sample(range(8 * len(data)), count):
                data = flipped(data, place)
            return data

        return self._damaged(exchange, flip)

    def _noise_before(self, exchange: _Exchange) -> list[Answer]:
        return self._with_noise(exchange, is_before=True)

    def _noise_behind(self, exchange: _Exchange) -> list[Answer]:
        return self._with_noise(exchange, is_before=False)

    def _noise_between(self, exchange: _Exchange) -> list[Answer]:
        def insert(data: bytes) -> bytes:
            at = self._dice.randrange(1, len(data))
            return data[:at] + self._noise() + data[at:]

        return self._damaged(exchange, insert)

    def _with_noise(self, exchange: _Exchange, *, is_before: bool) -> list[Answer]:
        data = self._answer(exchange)
        (answer,) = self._in_time(exchange, data)
        noise = self._noise()
        while self._misleads(exchange, noise + data if is_before else data + noise, data):
            noise = self._noise()
        if self._dice.random() < 0.5:
            return [Answer(answer.delay, noise + data if is_before else data + noise)]
        way = -1 if is_before else 1
        return [answer, Answer(max(0.0, answer.delay + way * self._dice.uniform(0.0001, 2 * _PAUSE)), noise)]

    def _damaged(self, exchange: _Exchange, damage: Callable[[bytes], bytes]) -> list[Answer]:
        data = self._answer(exchange)
        damaged = damage(data)
        while self._misleads(exchange, damaged, data):
            damaged = damage(data)
        return self._in_time(exchange, damaged)

    def _misleads(self, exchange: _Exchange, data: bytes, right: bytes) -> bool:
        """Whether a frame of the unit and the function, other than the right one, stands in `data` by chance."""
        if self._is_ascii:
            texts = [text.rpartition(b":")[2] for text in bytes(byte & 0x7F for byte in data).split(b"\r\n")]
            return any(_is_frame(text) and text.upper() not in right for text in texts[:-1])
        size = exchange.asked.response_size
        ends = [(exchange.asked.function, None if size is None else size + 3), (exchange.asked.function | 0x80, 5)]
        frames = [
            data[at : len(data) if size is None else at + size]
            for function, size in ends
            for at in range(len(data) - 1)
            if data[at : at + 2] == bytes((exchange.unit, function))
        ]
        whole = right.rstrip(b"\0")  # NUL bytes behind a frame leave its CRC right: that is not left out
        shorter = whole if size is None and whole != right else None  # but that is: its NUL bytes are missing
        return any(
            len(frame) > 3 and (frame == shorter or frame.rstrip(b"\0") != whole) and crc_fits(frame)
            for frame in frames
        )

    def _holes(self, exchange: _Exchange) -> list[Answer]:
        data = self._answer(exchange)
        at, answers = self._arrival(exchange, data), []
        while data:
            size = self._dice.randint(1, 8)
            answers.append(Answer(at, data[:size]))
            data = data[size:]
            at += self._dice.uniform(0.0, _PAUSE)
        return answers

    def _silent(self, exchange: _Exchange) -> list[Answer]:
        """It has heard the request, or not; sometimes it is dead for seconds."""
        device = exchange.device
        if exchange.now >= device.dead_until:
            if self._dice.random() < 0.03:
                device.dead_until = exchange.now + self._dice.uniform(1.0, 10.0)
            if self._dice.random() < 0.5:
                device.respond(exchange.asked.data)
        return []

    def _babble(self, exchange: _Exchange) -> list[Answer]:
        """Noise, and frames of a unit that does not exist, before, during and after the answer."""
        answers = self._right(exchange)
        (answer,) = answers
        for _ in range(self._dice.randint(2, 8)):
            at = self._dice.uniform(0.0, 3 * answer.delay)
            data = self._noise()
            if self._dice.random() < 0.3:
                data = self.encode(self._dice.randrange(100, 248), bytes((3, 2)) + self._dice.randbytes(2))
            answers.append(Answer(at, data))
        return answers

    def _noise(self) -> bytes:
        if self._dice.random() < 0.1:
            return bytes(self._dice.randint(1, 4))
        return self._dice.randbytes(self._dice.randint(1, 24))

    # --- the echo ---

    def _echo_lost(self, exchange: _Exchange) -> list[Answer]:
        return self._right(exchange)

    def _echo_damaged(self, exchange: _Exchange) -> list[Answer]:
        bits = 7 if self._is_ascii else 8  # the eighth is no part of an ASCII character
        echo = flipped(exchange.sent, 8 * self._dice.randrange(len(exchange.sent)) + self._dice.randrange(bits))
        return [Answer(exchange.left, echo), *self._right(exchange)]

    def _echo_alone(self, exchange: _Exchange) -> list[Answer]:
        return [Answer(exchange.left, exchange.sent)]


def _is_frame(digits: bytes) -> bool:
    try:
        body = bytes.fromhex(digits.decode())
    except ValueError:
        return False
    return len(body) > 2 and lrc(body[:-1]) == body[-1]


def _answers_with_size(asked: RequestPdu) -> bool:
    return asked.response_size is not None


def _is_write(asked: RequestPdu) -> bool:
    return asked.write is not None and asked.function != 23


#: Faults that make more than one frame of one shape.
_TWICE = frozenset({Fault.DUPLICATE, Fault.STALE, Fault.OTHER_CLIENT})
#: Faults whose frames could be taken for the answer to another client.
_SPURIOUS = frozenset(
    {Fault.DUPLICATE, Fault.STALE, Fault.FOREIGN_UNIT, Fault.FOREIGN_FUNCTION, Fault.WRONG_SIZE, Fault.WRONG_ECHO}
)

#: Faults that not every request can meet; others are cut instead.
_ONLY: dict[Fault, Callable[[RequestPdu], bool]] = {
    Fault.WRONG_SIZE: _answers_with_size,
    Fault.WRONG_ECHO: _is_write,
}

_FAULTS: dict[Fault, Callable[[FaultyLine, _Exchange], list[Answer]]] = {
    Fault.NONE: FaultyLine._right,
    Fault.EXCEPTION: FaultyLine._exception,
    Fault.LATE: FaultyLine._late,
    Fault.LATE_EXCEPTION: FaultyLine._late_exception,
    Fault.NOISE_THEN_LATE: FaultyLine._noise_then_late,
    Fault.HALF_LATE: FaultyLine._half_late,
    Fault.DUPLICATE: FaultyLine._duplicate,
    Fault.STALE: FaultyLine._stale_once,
    Fault.FOREIGN_UNIT: FaultyLine._foreign_unit,
    Fault.FOREIGN_FUNCTION: FaultyLine._foreign_function,
    Fault.WRONG_SIZE: FaultyLine._wrong_size,
    Fault.WRONG_ECHO: FaultyLine._wrong_echo,
    Fault.CUT: FaultyLine._cut,
    Fault.FLIPPED: FaultyLine._flipped,
    Fault.NOISE_BEFORE: FaultyLine._noise_before,
    Fault.NOISE_BEHIND: FaultyLine._noise_behind,
    Fault.NOISE_BETWEEN: FaultyLine._noise_between,
    Fault.HOLES: FaultyLine._holes,
    Fault.SILENT: FaultyLine._silent,
    Fault.BABBLE: FaultyLine._babble,
    Fault.OTHER_CLIENT: FaultyLine._other_client,
    Fault.ECHO_LOST: FaultyLine._echo_lost,
    Fault.ECHO_DAMAGED: FaultyLine._echo_damaged,
    Fault.ECHO_ALONE: FaultyLine._echo_alone,
}
