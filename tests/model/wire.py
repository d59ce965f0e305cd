"""The model of a line's wire: who has asked what and when, and so to whose request each frame is the answer.

Each request on the wire is answered once by its device, whoever has asked. What nobody can detect on RTU and ASCII
(docs/promise.md; ADR 5) does not happen here:

- No answer comes after its late window, which is twice the limit of its request.
- No answer comes a second time while one of the same unit and function is still to come, to us or to another client.
- Another client's request is heard whole, or its answer is not heard either; its functions have known sizes.
- No request of another client looks like an answer that anybody is owed, unless one that does not was heard in the last
  five minutes.
- No other client writes what we write while an answer to that may come, or the same again when it was not answered: a
  copy of such a request looks like its answer.
- What comes is read at once: nothing is on its way when a request leaves.
- An echo that the settings do not tell of comes before its request has left, on a real line. There another client's
  copy of our request takes its time too.
- No other client sends a copy of our request whose echo was lost.
- No noise looks like a frame.

Values say whose they are: while an answer is still to come, no other one has its value.

Devices that move answer from the address that they have by then. What has not been carried out when its late window
ends never is.
"""

from collections.abc import Collection
from dataclasses import dataclass, field
from math import inf
from typing import Any, Final

from gateway.modbus import ascii as ascii_framing
from gateway.modbus import rtu
from gateway.modbus.codes import BROADCAST_UNIT, EXCEPTION_BIT, FunctionCode
from gateway.modbus.pdu import parse_request
from gateway.timing.characters import LineTiming
from kit.noise import flipped

#: How long each device may think, and what the port may add, in seconds.
TIMEOUT: Final = 0.2
LATENCY: Final = 0.005
#: Exception codes of devices, none of which the gateway answers with.
_CODES: Final = (1, 2, 3, 4, 5, 8, *range(0x10, 0x20))
#: How a request begins that changes the address of a device; the address follows.
MOVE: Final = bytes.fromhex("10 01 00 00 01 02")
#: Functions whose response is the request.
_REPEATED: Final = frozenset(
    {FunctionCode.WRITE_SINGLE_COIL, FunctionCode.WRITE_SINGLE_REGISTER, FunctionCode.DIAGNOSTICS}
)
#: How a request to read coils begins that looks like three bytes of them.
_TWOFOLD: Final = b"\x01\x03"
#: In such a request, this would be the high byte of too large a quantity.
_NO_QUANTITY: Final = 0xFF
#: For so many seconds after a request of its own, another client may be there.
_SHARED: Final = 300.0
#: So many requests of other clients are unanswered at most.
_OTHERS: Final = 2
#: An answer comes at the latest so many seconds before its window ends.
_MARGIN: Final = 1e-5


@dataclass(eq=False)
class Asking:
    """One request on the wire, ours or another client's, and the answer that its device owes.

    `questions` are those of our clients that the answer is right for. `delivered` is the response that was heard whole.
    """

    unit: int
    pdu: bytes
    value: int
    questions: list[Any]
    is_ours: bool
    left_at: float
    fails_at: float
    ends_at: float
    #: The address in the config of the device that hears it; None if there is none at this address.
    device: int | None = None
    is_owed: bool = True
    has_begun: bool = False
    delivered: list[bytes] = field(default_factory=list)

    @property
    def shape(self) -> tuple[int, int]:
        """What answers are taken for one another by: unit and function."""
        return self.unit, self.pdu[0]

    @property
    def answer(self) -> bytes:
        """The right response PDU."""
        if self.pdu[0] in _REPEATED:
            return self.pdu
        if self.pdu[0] == FunctionCode.WRITE_MULTIPLE_REGISTERS:
            return self.pdu[:5]
        if self.pdu[0] == FunctionCode.READ_COILS:
            return bytes((self.pdu[0], 3, self.pdu[2], _NO_QUANTITY, self.value))
        return bytes((self.pdu[0], 2, self.pdu[2], self.value))

    @property
    def refusal(self) -> bytes:
        """The exception response PDU, likewise with a value of its own."""
        return bytes((self.pdu[0] | EXCEPTION_BIT, _CODES[self.value]))


class Wire:
    """What is on the wire of one line. If it `takes_time`, no device answers before the request has left.

    `places` are the addresses of devices that move, by those in the config; without any, each unit has its own device.
    `clashes` tells which of them came to have the same one.
    """

    def __init__(self, timing: LineTiming, *, takes_time: bool, moving: Collection[int] = ()) -> None:
        self.askings: list[Asking] = []
        self.places = {unit: unit for unit in moving}
        self.clashes: list[str] = []
        self._timing = timing
        self._takes_time = takes_time
        self._encode = ascii_framing.encode if timing.mode == "ascii" else rtu.encode
        self._writes_of_others = 0
        #: When another client can have sent what we have sent last.
        self._copied_at: dict[tuple[int, bytes], float] = {}
        self._is_shared_until = 0.0
        #: Other clients' requests without an answer that was heard whole, and what looks like one.
        self._unanswered: set[tuple[int, bytes]] = set()
        #: Our requests whose answer came damaged: until when the gateway may await it.
        self._lost: dict[tuple[int, bytes], float] = {}

    def asked(self, frame: bytes, questions: list[Any], now: float) -> Asking:
        """We have written a request for `questions`."""
        unit, pdu = self.decoded(frame)
        duration = len(frame) * self._timing.character
        self._copied_at = {(unit, pdu): now + 2 * duration * self._takes_time}
        return self._add(unit, pdu, questions, now + duration, is_ours=True)

    def may_ask(self, unit: int, pdu: bytes, now: float) -> bool:
        """Whether another client may ask this now."""
        asked = unit, pdu
        awaited = {(each.unit, each.pdu) for each in self.askings if each.is_owed and each.is_ours}
        awaited |= {each for each, ends_at in self._lost.items() if now < ends_at} | self._unanswered
        looks_like_answer = pdu[0] == FunctionCode.WRITE_SINGLE_COIL and asked in awaited
        if now < self._copied_at.get(asked, 0.0):
            return False
        if pdu.startswith(_TWOFOLD) and now >= self._is_shared_until:
            looks_like_answer = (unit, pdu[0]) in {(each, other[0]) for each, other in awaited}
        return not looks_like_answer and sum(each.is_owed and not each.is_ours for each in self.askings) < _OTHERS

    def loses_echo(self) -> None:
        """The echo of our last request is lost: a copy of it would be taken for that."""
        self._copied_at = dict.fromkeys(self._copied_at, inf)

    def other_asked(self, unit: int, pdu: bytes, now: float) -> bytes:
        """Another client has asked; its frame. Who asks the same as we do, after us, has the same answer as we.

        If ours was lost, the answer to an equal read is as good. Each write of a register has a value of its own.
        """
        if pdu[0] == FunctionCode.WRITE_SINGLE_REGISTER:
            self._writes_of_others += 1
            pdu = pdu[:-1] + bytes((self._writes_of_others,))
        self._unanswered.add((unit, pdu))
        if not pdu.startswith(_TWOFOLD):
            self._is_shared_until = now + _SHARED
        only_reads = parse_request(pdu).only_reads
        ours = [each for each in self.askings if each.is_ours and (each.is_owed or only_reads)]
        same = [each for each in ours if (each.unit, each.pdu) == (unit, pdu)]
        self._add(unit, pdu, [question for each in same for question in each.questions], now, is_ours=False)
        return self._encode(unit, pdu)

    def owed(self, now: float, *, ours: bool) -> list[Asking]:
        """Whose answers may come now, the oldest request first."""
        return [
            each
            for each in self.askings
            if each.is_owed
            and each.device is not None
            and each.is_ours is ours
            and (not self._takes_time or now >= each.left_at)
        ]

    def answers(self, asking: Asking, pdu: bytes) -> bytes:
        """The device answers; its frame."""
        asking.is_owed = False
        asking.delivered.append(pdu)
        if not asking.is_ours:
            self._unanswered.discard((asking.unit, asking.pdu))
        return self._frame(asking, pdu)

    def again(self, frame: bytes) -> bytes:
        """The device answers a second time. If that repeats a request, it looks like one that nobody answers."""
        self._unanswered.add(self.decoded(frame))
        return frame

    def begins(self, asking: Asking) -> bytes:
        """Half of the answer."""
        asking.has_begun = True
        frame = self._encode(asking.unit, asking.answer)
        return frame[: len(frame) // 2]

    def ends(self, asking: Asking) -> bytes:
        """The other half."""
        asking.has_begun = False
        frame = self.answers(asking, asking.answer)
        return frame[len(frame) // 2 :]

    def loses(self, asking: Asking) -> bytes:
        """The device answers, and something happens to this frame on its way."""
        asking.is_owed = False
        if asking.is_ours:
            self._lost[asking.unit, asking.pdu] = asking.ends_at
        return self._frame(asking, asking.answer)

    def is_awaited(self, shape: tuple[int, int], now: float) -> bool:
        """Whether somebody may await an answer of this shape."""
        lost = [(unit, pdu[0]) for (unit, pdu), ends_at in self._lost.items() if now < ends_at]
        return shape in lost or any(each.is_owed and each.shape == shape for each in self.askings)

    def next_end(self, now: float) -> float:
        """When the next answer that is late can come no more, 0 if none is awaited."""
        return min((each.ends_at for each in self.askings if each.is_owed and each.ends_at > now), default=0.0)

    def forget(self, now: float) -> None:
        """Answers whose time is over come no more, and what is over is over."""
        for each in self.askings:
            if each.ends_at - _MARGIN <= now:
                each.is_owed = each.has_begun = False
        self.askings = [each for each in self.askings if each.is_owed or any(not q.answers for q in each.questions)]

    def cut(self) -> None:
        """The port has gone: the rest of what has begun to come is lost."""
        for each in self.askings:
            if each.has_begun:
                each.is_owed = each.has_begun = False

    def decoded(self, frame: bytes) -> tuple[int, bytes]:
        """Unit and PDU of a frame that we have written."""
        body = bytes.fromhex(frame[1:-4].decode()) if self._timing.mode == "ascii" else frame[:-2]
        return body[0], body[1:]

    def with_wrong_unit(self, frame: bytes) -> bytes:
        """The frame with one bit turned, which makes unit 1 of 3 and 3 of 1."""
        return flipped(frame, 8 * (2 if self._timing.mode == "ascii" else 0) + 1)

    def with_wrong_check_sum(self, frame: bytes) -> bytes:
        """The frame with one bit turned at its end."""
        return flipped(frame, 8 * (len(frame) - (3 if self._timing.mode == "ascii" else 1)) + 1)

    def _frame(self, asking: Asking, pdu: bytes) -> bytes:
        """The device does what it was asked, unless it refuses, and this is the frame of its response."""
        device, places = asking.device, self.places
        if device is None or device not in places:
            return self._encode(asking.unit, pdu)
        if asking.pdu.startswith(MOVE) and not pdu[0] & EXCEPTION_BIT:
            places[device] = int.from_bytes(asking.pdu[len(MOVE) :])
            if list(places.values()).count(places[device]) > 1:
                self.clashes.append(f"two devices have the address {places[device]}")
        return self._encode(places[device], pdu)

    def _heard_by(self, unit: int) -> int | None:
        """The device that has this address."""
        return next((device for device, place in self.places.items() if place == unit), None) if self.places else unit

    def _add(self, unit: int, pdu: bytes, questions: list[Any], left_at: float, *, is_ours: bool) -> Asking:
        taken = {each.value for each in self.askings if each.is_owed}
        value = next(number for number in range(len(_CODES)) if number not in taken)
        limit = self._timing.frame(parse_request(pdu).longest_response) + TIMEOUT + LATENCY
        asking = Asking(unit, pdu, value, questions, is_ours, left_at, left_at + limit, left_at + 3 * limit)
        asking.is_owed = unit != BROADCAST_UNIT
        asking.device = self._heard_by(unit)
        self.askings.append(asking)
        return asking
