"""Devices without function 22 whose registers are written bit by bit, by several writers: no bit is ever lost.

Each bit has one writer, which sets it again and again. A device notices when a write changes other bits than its
writer has asked for. A writer notices when its bit is not as it has last written it. Some registers are also written
as a whole, by anybody.
"""

import asyncio
import random
from dataclasses import dataclass
from typing import Final

from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.mbap import MbapFramer, TcpFrame, encode
from gateway.modbus.pdu import RequestPdu
from gateway.registers.masks import mask_request
from gateway.request import Caller, Origin, Request
from gateway.routing.router import Router
from kit.faulty import EXCEPTION_CODES, FaultyDevice
from kit.memory import MemoryLine
from soak.dated_world import DatedWorld
from soak.judge import NO_ANSWER, words

#: The registers with bits, and the one of them that is written as a whole too.
REGISTERS: Final = range(4)
WHOLE: Final = 3
_BITS: Final = 16
_MASK_WRITE, _WRITE = 22, 6
#: Exceptions of the gateway after which nothing was written; 04 on a line with another client.
_NOT_WRITTEN: Final = (0x04, 0x06, 0x0A, *EXCEPTION_CODES)
#: For so many seconds after it was answered 0B, a write may still be carried out.
_UNKNOWN: Final = 1.0
#: After an exception a writer pauses so many times as long.
_LONGER: Final = 20


@dataclass(eq=False)
class Wish:
    """What somebody wants of a register: these bits of `mask` to be as in `bits`. `is_done` once a device has it so."""

    register: int
    mask: int
    bits: int
    ends_at: float = float("inf")
    is_done: bool = False

    def fits(self, before: int, after: int) -> bool:
        """Tell whether it explains a change of its register: the wanted bits are so, and no others have changed."""
        return after & self.mask == self.bits and not (before ^ after) & ~self.mask


class BitsDevice(FaultyDevice):
    """A device without function 22 that knows what is wanted of its registers."""

    def __init__(self, unit: int, number: int, world: DatedWorld, timeout: float = 0.05) -> None:
        super().__init__(unit, number=number, timeout=timeout)
        self._world = world
        self._wishes: list[Wish] = []
        #: When each register was written as a whole the last time.
        self.whole_at = dict.fromkeys(REGISTERS, 0.0)

    def wish(self, wish: Wish) -> None:
        """Note what somebody is about to ask for."""
        now = self._world.loop.time()
        self._wishes = [each for each in self._wishes if each.ends_at > now]
        self._wishes.append(wish)

    def respond(self, pdu: bytes) -> bytes:
        """Act on a request; the right answer."""
        if pdu[0] == _MASK_WRITE:
            self._world.tally.complain(f"device {self.number} was asked for function 22")
            return bytes((_MASK_WRITE | EXCEPTION_BIT, 1))
        return super().respond(pdu)

    def _write(self, asked: RequestPdu, values: list[int]) -> None:
        register, after = asked.write.start, values[0]
        before, now = self.holding[register], self._world.loop.time()
        super()._write(asked, values)
        if register not in REGISTERS:
            return
        fitting = [each for each in self._wishes if each.register == register and each.fits(before, after)]
        if not fitting:
            passed = "\n    ".join(self._world.passed.get(self.number, ()))
            self._world.tally.complain(
                f"at {now:.6f} s register {register} of device {self.number} became {after:04X}, and was {before:04X}: "
                f"nobody has asked for that\n    {passed}"
            )
        for each in fitting:
            each.is_done = True
            if each.mask == (1 << _BITS) - 1:
                self.whole_at[register] = now


class _Origin(Origin):
    """The Origin of one request; `answered` is its response."""

    def __init__(self, caller: Caller, world: DatedWorld) -> None:
        self.caller = caller
        self.is_there = True
        self.answered: asyncio.Future[bytes] = world.loop.create_future()

    def wants(self, request: Request) -> bool:
        return self.is_there

    def answer(self, request: Request, pdu: bytes | None) -> None:
        self.answered.set_result(pdu or b"")


async def _ask(world: DatedWorld, router: Router, name: str, unit: int, pdu: bytes, in_one_turn: int) -> bytes:
    now = world.loop.time()
    origin = _Origin(Caller(name, "127.0.0.1", name), world)
    request = Request(unit, pdu, origin, now)
    request.in_one_turn = in_one_turn
    router.submit(request, now)
    if world.dice.random() < 0.003:
        world.loop.call_later(world.dice.uniform(0.0, 0.05), _leave, origin, request)
    world.tally.questions += 1
    response = await origin.answered
    world.tally.slowest = max(world.tally.slowest, world.loop.time() - now)
    return response


def _leave(origin: _Origin, request: Request) -> None:
    origin.is_there = False
    request.give_up()


async def keep_writing_bits(
    world: DatedWorld, router: Router, unit: int, device: BitsDevice, register: int, bit: int, pause: float = 0.02
) -> None:
    """Set one bit of a register again and again, until the world is over; nobody else sets it by itself."""
    name, mask, known, known_at = f"10.1.{register}.{bit}:{unit}", 1 << bit, None, 0.0
    dice = random.Random(world.dice.random())
    while not world.is_over:
        now = world.loop.time()
        is_so = device.holding[register] & mask
        if known is not None and is_so != known and device.whole_at[register] < known_at:
            world.tally.complain(f"at {now:.6f} s bit {bit} of register {register} of {unit} is lost")
        wish = Wish(register, mask, dice.choice((0, mask)))
        device.wish(wish)
        pdu = mask_request(register, mask, wish.bits)
        response = await _ask(world, router, name, unit, pdu, dice.choice((6, 16)))
        known, known_at = None, world.loop.time()
        if response == pdu:
            known = wish.bits
        elif response[1] != NO_ANSWER:  # nothing has changed it meanwhile
            known = None if wish.is_done else device.holding[register] & mask
        _judge(world, "bit", wish, pdu, response)
        await asyncio.sleep(dice.uniform(0.0, pause if response == pdu else _LONGER * pause))


async def keep_writing_all(world: DatedWorld, router: Router, unit: int, device: BitsDevice, pause: float) -> None:
    """Write whole registers: the one with bits that anybody writes, and others."""
    name, dice = f"10.2.0.1:{unit}", random.Random(world.dice.random())
    while not world.is_over:
        register = dice.choice((WHOLE, 8, 9))
        wish = Wish(register, (1 << _BITS) - 1, dice.randrange(1 << _BITS))
        device.wish(wish)
        pdu = words(_WRITE, register, wish.bits)
        response = await _ask(world, router, name, unit, pdu, 0)
        _judge(world, "register", wish if register in REGISTERS else None, pdu, response)
        await asyncio.sleep(dice.uniform(0.0, pause if response == pdu else _LONGER * pause))


def _judge(world: DatedWorld, kind: str, wish: Wish | None, pdu: bytes, response: bytes) -> None:
    """Count the outcome, and complain of a wrong one."""
    trouble, outcome, now = "", "right data", world.loop.time()
    if response == pdu:
        trouble = "the device has not done that" if wish is not None and not wish.is_done else ""
    elif response[0] != pdu[0] | EXCEPTION_BIT or response[1] not in (NO_ANSWER, *_NOT_WRITTEN):
        trouble = "that is no answer"
    else:
        outcome = f"{response[1]:02X}" if response[1] in (6, 10, NO_ANSWER) else "device's exception"
    if wish is not None:
        wish.ends_at = now + _UNKNOWN if response[1:] == bytes((NO_ANSWER,)) else now
    world.tally.outcomes[kind, "WRONG" if trouble else outcome] += 1
    if trouble:
        world.tally.complain(f"at {now:.6f} s {pdu.hex(' ')} got {response.hex(' ')}: {trouble}")


class BitsServer:
    """A server behind `line` that works on several requests at once, in any order; `share` of them meet a fault.

    It acts before the gateway's limit of 100 ms, but may answer after it, or never.
    """

    def __init__(
        self, world: DatedWorld, line: MemoryLine, devices: dict[int, BitsDevice], share: float, seed: int
    ) -> None:
        self._world = world
        self._line = line
        self._devices = devices
        self._share = share
        self._dice = random.Random(seed)
        line.on_write = self._received

    def _received(self, data: bytes) -> None:
        self._line.written.clear()
        for asked in MbapFramer().cut(data):
            fault = self._dice.choice(("late", "silent", "exception")) if self._dice.random() < self._share else ""
            self._world.tally.transactions += 1
            self._world.tally.injected[fault or "no fault"] += 1
            self._world.loop.call_later(self._dice.uniform(0.0, 0.05), self._act, asked, fault, self._line.openings)

    def _act(self, asked: TcpFrame, fault: str, connection: int) -> None:
        device = self._devices[asked.unit]
        if fault == "exception":
            response = bytes((asked.pdu[0] | EXCEPTION_BIT, self._dice.choice(EXCEPTION_CODES)))
        else:
            response = device.respond(asked.pdu)
        if fault != "silent":
            delay = self._dice.uniform(0.06, 0.4) if fault == "late" else self._dice.uniform(0.0, 0.045)
            frame = encode(asked.transaction, asked.unit, response)
            self._world.loop.call_later(delay, self._answer, frame, connection)

    def _answer(self, frame: bytes, connection: int) -> None:
        if connection == self._line.openings:
            self._line.deliver(frame)
