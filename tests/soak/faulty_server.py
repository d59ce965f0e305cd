"""A Modbus TCP server whose answers come late, twice, never, in any order, mislabelled or cut, and which hangs up.

It may need manners, too: pauses, one request at a time, to be woken, to be left alone.

What nobody can detect is left out: an answer under the identifier of another request that it fits too. Where
answers have identifier 0, that is a second answer to a request, while another one that it fits too is under way.
"""

import random
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf
from typing import Final

from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.mbap import MbapFramer, TcpFrame, encode
from gateway.modbus.pdu import parse_request
from kit.faulty import EXCEPTION_CODES
from kit.memory import MemoryLine
from kit.other_client import Adapter
from soak.dated import DatedDevice
from soak.dated_world import DatedWorld

#: How long an answer takes, one that is late, and a copy, in seconds. The gateway allows `TIMEOUT`.
TIMEOUT: Final = 0.1
_THINKING, _LATE, _LATER = (0.0, 0.08), (0.1, 0.4), (0.1, 8.0)
_COPY = ((0.0, 0.1), (0.0, 8.0))
#: For so long it may be away after it hung up; and so long nobody asks before it hangs up for that, in seconds.
_AWAY, _IDLE = ((0.0, 0.0), (0.0, 0.0), (0.0, 1.5)), (0.0, 0.05)
#: This share of what comes is noticed later than it comes, by so many seconds.
_UNREAD, _NOTICING = 0.1, (0.0, 0.005)
#: The identifier of one of so many requests before or behind it may be on an answer.
_NEAR: Final = 40
#: The units in the answers of servers that know none.
_NO_UNIT: Final = (0, 255)
_NO_MODBUS: Final = b"HTTP/1.1 400 Bad Request\r\n\r\n"
#: What a length in a header is too large by, at most.
_TOO_LARGE: Final = 60
#: So much that has passed is told when something is wrong.
_TOLD: Final = 24

#: What was done at this moment may be on either side of it, in seconds.
_A_MOMENT: Final = 1e-6

#: Makes another frame of a right one.
Spoil = Callable[[TcpFrame], TcpFrame]


@dataclass(frozen=True, kw_only=True)
class Manners:
    """What a server needs, and how it behaves without any fault. Times in seconds."""

    knows_units: bool = True
    #: The share of answers with identifier 0.
    zeros: float = 0.0
    #: The share of answers that come again soon.
    repeats: float = 0.0
    #: A request that comes sooner after an answer is lost, and so is the next one while another is being worked on.
    gap: float | None = None
    #: A connection is closed in order after so long without a request.
    idle: float = inf
    #: The first request to a unit after so long is lost.
    sleeps_after: float = inf
    #: How long it takes to connect, at most.
    opens_in: float = 0.0


class FaultyServer:
    """The server behind `line`, with these devices by unit. `share` of the requests meet a fault.

    While it `is_deaf`, it answers none.
    """

    def __init__(
        self,
        world: DatedWorld,
        line: MemoryLine,
        devices: Mapping[int, DatedDevice],
        *,
        share: float,
        seed: int,
        manners: Manners | None = None,
    ) -> None:
        self.is_deaf = False
        self._world = world
        self._line = line
        self._devices = devices
        self._share = share
        self._dice = random.Random(seed)
        self._manners = manners or Manners()
        self._later = world.loop.call_later
        self._adapter = Adapter(self._later, line.deliver, seed=seed)
        #: The last request with each identifier, and the last of all.
        self._asked: dict[int, TcpFrame] = {}
        self._last: TcpFrame | None = None
        #: When each unit was asked last, and anything; when an answer came last, and how many requests it works on.
        self._asked_at: dict[int, float] = {}
        self._last_at = self._said_at = -inf
        self._works = 0
        self._passed: deque[str] = deque(maxlen=_TOLD)
        world.passed |= dict.fromkeys((device.number for device in devices.values()), self._passed)
        line.on_write = self._received
        line.opened = self._connected

    def _received(self, data: bytes) -> None:
        self._line.written.clear()
        for asked in MbapFramer().cut(data):
            fault = self._dice.choice(_CHOICE) if self._dice.random() < self._share else "no fault"
            fault = self._lost_for(asked) or fault
            self._world.tally.transactions += 1
            self._world.tally.injected[fault] += 1
            self._note(">>", data, fault)
            self._asked[asked.transaction] = self._last = asked
            if asked.unit in self._devices:
                _FAULTS[fault](self, asked)
        self._leave_when_idle()

    def _connected(self) -> None:
        """A connection is new: nothing of an earlier one comes on it."""
        self._adapter.drop()
        self._last_at = self._said_at = -inf
        self._works = 0
        self._line.opens_in = self._in((0.0, self._manners.opens_in))
        self._leave_when_idle()

    def _leave_when_idle(self) -> None:
        last, connection = self._last, self._line.openings

        def leave() -> None:
            if last is self._last and connection == self._line.openings and self._line.is_open:
                self._world.tally.counts["left in order"] += 1
                self._adapter.drop()
                self._line.hang_up(unread=self._is_unread())

        if self._manners.idle < inf:
            self._later(self._manners.idle, leave)

    def _lost_for(self, asked: TcpFrame) -> str:
        """Say why it does not hear a request, if so."""
        now, manners = self._world.loop.time(), self._manners
        silent_for = now - self._asked_at.get(asked.unit, -inf)
        last_at, self._last_at, self._asked_at[asked.unit] = self._last_at, now, now
        if self.is_deaf:
            return "deaf"
        if manners.gap is not None and (self._works or now < self._said_at + manners.gap - _A_MOMENT):
            if now < last_at + TIMEOUT - _A_MOMENT:  # later, it may have been given up
                self._world.tally.complain(f"at {now:.6f} s {self._line.name} was asked too soon")
            return "too soon"
        return "asleep" if silent_for > manners.sleeps_after else ""

    # --- what it does ---

    def _right(self, asked: TcpFrame) -> None:
        first = self._in(_THINKING)
        is_repeated = self._manners.repeats and self._dice.random() < self._manners.repeats
        self._answer(asked, first, *([first + self._in(_COPY[0])] if is_repeated else []))

    def _answer_late(self, asked: TcpFrame) -> None:
        self._answer(asked, self._in(self._dice.choice((_LATE, _LATER))))

    def _answer_twice(self, asked: TcpFrame) -> None:
        first = self._in(self._dice.choice((_THINKING, _LATER)))
        self._answer(asked, first, first + self._in(self._dice.choice(_COPY)))

    def _answer_twice_at_once(self, asked: TcpFrame) -> None:
        self._answer(asked, self._in(_THINKING), copies=2)

    def _keep_silent(self, asked: TcpFrame) -> None:
        self._answer(asked)

    def _refuse(self, asked: TcpFrame) -> None:
        refusal = bytes((asked.pdu[0] | EXCEPTION_BIT, self._dice.choice(EXCEPTION_CODES)))
        delay = self._in(self._dice.choice((_THINKING, _THINKING, _LATER)))
        self._later(delay, self._say, asked, self._frame(asked, refusal), self._line.openings)

    def _mistake_identifier(self, asked: TcpFrame) -> None:
        other = (asked.transaction + self._dice.randint(-_NEAR, _NEAR)) & 0xFFFF
        self._mistake(asked, lambda frame: TcpFrame(other, frame.unit, frame.pdu))

    def _mistake_unit(self, asked: TcpFrame) -> None:
        other = self._dice.choice([unit for unit in (*self._devices, 99) if unit != asked.unit])
        self._mistake(asked, lambda frame: TcpFrame(frame.transaction, other, frame.pdu))

    def _mistake_function(self, asked: TcpFrame) -> None:
        other = self._dice.choice([each for each in (3, 4, 6, 16) if each != asked.pdu[0]])
        self._mistake(asked, lambda frame: TcpFrame(frame.transaction, frame.unit, bytes((other,)) + frame.pdu[1:]))

    def _mistake_size(self, asked: TcpFrame) -> None:
        def longer(frame: TcpFrame) -> TcpFrame:
            size = frame.pdu[1] + 2 * (frame.pdu[1] == len(frame.pdu) - 2)
            return TcpFrame(frame.transaction, frame.unit, bytes((frame.pdu[0], size)) + frame.pdu[2:] + bytes(2))

        self._mistake(asked, longer)

    def _mistake(self, asked: TcpFrame, spoil: Spoil) -> None:
        """Answer with this instead, and rightly behind that or never."""
        first = self._in(self._dice.choice((_THINKING, _LATER)))
        rightly = [first + self._in(_THINKING)] * self._dice.randrange(2)
        self._answer(asked, first, *rightly, spoil=spoil)

    def _hang_up_soon(self, asked: TcpFrame) -> None:
        self._answer(asked, self._in(_THINKING))
        self._later(self._in(_THINKING), self._hang_up)

    def _hang_up_when_idle(self, asked: TcpFrame) -> None:
        def hang_up_if_idle() -> None:
            if asked is self._last:
                self._hang_up()

        self._answer(asked, self._in(_THINKING))
        self._later(_THINKING[1] + self._in(_IDLE), hang_up_if_idle)

    def _hang_up_in_the_middle(self, asked: TcpFrame) -> None:
        adu = encode(*self._frame(asked, self._devices[asked.unit].respond(asked.pdu)))
        self._adapter.take(adu[: self._dice.randrange(1, len(adu))], at_once=True)
        self._hang_up()

    def _tell_too_large_a_length(self, asked: TcpFrame) -> None:
        adu = bytearray(encode(*self._frame(asked, self._devices[asked.unit].respond(asked.pdu))))
        adu[5] += self._dice.randint(1, _TOO_LARGE)
        self._adapter.take(bytes(adu), at_once=False)

    def _say_no_modbus(self, asked: TcpFrame) -> None:
        self._answer(asked)
        self._adapter.take(_NO_MODBUS, at_once=False)

    # --- how ---

    def _in(self, span: tuple[float, float]) -> float:
        return self._dice.uniform(*span)

    def _frame(self, asked: TcpFrame, response: bytes) -> TcpFrame:
        manners = self._manners
        identifier = 0 if manners.zeros and self._dice.random() < manners.zeros else asked.transaction
        return TcpFrame(identifier, asked.unit if manners.knows_units else self._dice.choice(_NO_UNIT), response)

    def _answer(self, asked: TcpFrame, *delays: float, spoil: Spoil | None = None, copies: int = 1) -> None:
        """Answer after each of these times, the first time with a spoilt frame. The device acts now, or then."""
        device, connection = self._devices[asked.unit], self._line.openings
        response = device.respond(asked.pdu) if self._dice.random() < 0.5 else b""

        def answer(number: int) -> None:
            nonlocal response
            response = response or device.respond(asked.pdu)
            frame = self._frame(asked, response)
            spoilt = frame if spoil is None or number else spoil(frame)
            if not self._misleads(asked, spoilt, is_copy=number > 0):
                self._say(asked, spoilt, connection, copies)

        self._works += bool(delays)
        for number, delay in enumerate(delays):
            self._later(delay, answer, number)

    def _say(self, asked: TcpFrame, frame: TcpFrame, connection: int, copies: int = 1) -> None:
        """Send this, if the connection on which it was asked for is still there."""
        if connection == self._line.openings and self._line.is_open:
            self._note("<<", encode(*frame))
            if asked is self._last:
                self._said_at, self._works = self._world.loop.time(), 0
            self._is_unread()
            self._adapter.take(encode(*frame) * copies, at_once=self._manners.zeros > 0 or copies > 1)

    def _is_unread(self) -> bool:
        """Let the gateway notice a moment later what comes now; tell whether that is so."""
        is_unread = self._dice.random() < _UNREAD
        if is_unread:
            self._line.leave_unread()
            self._later(self._in(_NOTICING), self._line.notice)
        return is_unread

    def _misleads(self, asked: TcpFrame, frame: TcpFrame, *, is_copy: bool) -> bool:
        """Whether it fits another request than `asked`, whose identifier it has."""
        if self._manners.zeros and frame.transaction == 0:
            other = self._last if is_copy else None
            if is_copy and self._line.written:
                return True  # the next request is on its way
        else:
            other = self._asked.get(frame.transaction)
        if other is None or other is asked:
            return False
        return frame.unit in (other.unit, *_NO_UNIT) and parse_request(other.pdu).accepts(frame.pdu)

    def _hang_up(self) -> None:
        self._adapter.drop()
        self._line.pull("the other server hung up")
        self._later(self._in(self._dice.choice(_AWAY)), self._line.plug)

    def _note(self, way: str, data: bytes, fault: str = "") -> None:
        self._passed.append(f"{self._world.loop.time():.6f} {self._line.name} {way} {data.hex(' ').upper()} {fault}")


_FAULTS: Final[dict[str, Callable[[FaultyServer, TcpFrame], None]]] = {
    "no fault": FaultyServer._right,
    "late": FaultyServer._answer_late,
    "twice": FaultyServer._answer_twice,
    "twice at once": FaultyServer._answer_twice_at_once,
    "silent": FaultyServer._keep_silent,
    "exception": FaultyServer._refuse,
    "other identifier": FaultyServer._mistake_identifier,
    "other unit": FaultyServer._mistake_unit,
    "other function": FaultyServer._mistake_function,
    "other size": FaultyServer._mistake_size,
    "hangs up": FaultyServer._hang_up_soon,
    "hangs up when idle": FaultyServer._hang_up_when_idle,
    "hangs up in the middle": FaultyServer._hang_up_in_the_middle,
    "no Modbus": FaultyServer._say_no_modbus,
    "too large a length": FaultyServer._tell_too_large_a_length,
}
#: The last five end the connection, or should: that is rarer.
_CHOICE: Final = [*list(_FAULTS)[1:-5] * 10, *list(_FAULTS)[-5:]]
#: What its manners make of a request.
_FAULTS |= dict.fromkeys(("deaf", "too soon", "asleep"), FaultyServer._keep_silent)
