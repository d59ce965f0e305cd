"""Clients of scales that change their addresses: what they ask, and what they may be answered."""

import asyncio
import random
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from gateway.modbus.codes import EXCEPTION_BIT, FunctionCode
from gateway.modbus.pdu import parse_request
from soak.scales import EXCEPTIONS, Scale, words

if TYPE_CHECKING:
    from soak.worlds.moving import World

#: Where scales are moved to, and what is no address.
ADDRESSES: Final = range(1, 10)
NO_ADDRESSES: Final = (0, 248, 255, 0x0105)
#: Where reads begin: all have the same size.
READS: Final = (0, 2, 16, 0x0100, 0x0150)
#: What the gateway answers itself, and what it answers only to a change of an address.
OF_GATEWAY: Final = frozenset({0x06, 0x0A, 0x0B})
REFUSED: Final = 0x03


class ScaleClient:
    """Asks one thing after the other, and looks at each answer."""

    def __init__(self, world: "World", number: int) -> None:
        self._world = world
        self._dice = random.Random(world.dice.random())
        self._client = world.bench.client(f"10.0.0.{number}:1")

    async def run(self) -> None:
        while not self._world.is_over:
            known_as = self._dice.choice(list(self._world.units))
            kind = self._dice.random()
            if kind < 0.85:
                await self._read(known_as)
            elif kind < 0.97:
                await self._move(known_as, self._some_address(known_as))
            elif kind < 0.99:
                await self._change_places(known_as)
            else:
                await self._broadcast()
            await asyncio.sleep(self._dice.uniform(0.0, 0.05))

    async def _read(self, known_as: int) -> None:
        start = self._dice.choice(READS)
        right = bytes((3, 4)) + words(self._world.scales[known_as].number, start, 2)
        await self._ask(known_as, f"03 {start:04X} 0002", lambda pdu: pdu == right)

    def _some_address(self, known_as: int) -> int:
        """One of any kind: free, taken, its own, that of another one in the config, or none at all."""
        world = self._world
        if self._dice.random() < 0.1:
            return self._dice.choice(NO_ADDRESSES)
        if self._dice.random() < 0.3:
            return self._dice.choice([world.units[known_as], *world.units.values()])
        return self._dice.choice(ADDRESSES)

    async def _move(self, known_as: int, unit: int) -> bool:
        """Whether the change was confirmed; then the scale is there."""
        world = self._world
        scale = world.scales[known_as]
        if unit == world.shunned or not world.may_move:
            return False
        pdu = self._dice.choice(
            (f"10 0100 0001 02 {unit:04X}", f"06 0100 {unit:04X}", f"10 00FF 0003 06 0000 {unit:04X} 0000",
             f"17 0000 0001 0100 0001 02 {unit:04X}", f"16 0100 0000 {unit:04X}", "10 0201 0001 02 0000")
        )  # fmt: skip
        asked = parse_request(bytes.fromhex(pdu))
        world.changes += 1

        def is_right(answer: bytes) -> bool:
            return asked.accepts(answer) and scale.unit == unit and asked.function != FunctionCode.MASK_WRITE_REGISTER

        answer = await self._ask(known_as, pdu, is_right)
        world.changes -= 1
        return answer is not None and not answer[0] & EXCEPTION_BIT

    async def _change_places(self, known_as: int) -> None:
        """Two scales of a line change places, by way of a free address."""
        world = self._world
        neighbours = [each for each, end in world.ends.items() if end is world.ends[known_as] and each != known_as]
        other = self._dice.choice(neighbours)
        here, there = world.scales[known_as].unit, world.scales[other].unit
        for mover, to in ((known_as, self._dice.choice(ADDRESSES)), (other, here), (known_as, there)):
            for _ in range(3):
                if await self._move(mover, to):
                    break
                await asyncio.sleep(self._dice.uniform(0.0, 0.5))

    async def _broadcast(self) -> None:
        """To all scales: a change of their address, which reaches none, or that each takes its weight for zero."""
        self._world.tally.broadcasts += 1
        changes = ("06 0100 0005", "10 00FF 0003 06 0000 0005 0000", "16 0100 0000 0005", "10 0200 0002 04 4696 0000")
        self._client.ask(0, self._dice.choice((*changes, "10 1A00 0001 02 00BB")))

    async def _ask(self, known_as: int, pdu: str, is_right: Callable[[bytes], bool]) -> bytes | None:
        world, tally = self._world, self._world.tally
        scale, began = world.scales[known_as], self._client.now()
        tally.questions += 1
        try:
            answer = bytes.fromhex(await self._client.asks(known_as, pdu))
        except TimeoutError:
            tally.complain(f"no answer to {known_as}: {pdu}")
            return None
        tally.slowest = max(tally.slowest, self._client.now() - began)
        outcome = self._outcome(scale, pdu, answer, is_right)
        fault = scale.faults.pop(bytes.fromhex(pdu), None)
        tally.outcomes["(not sent)" if fault is None else fault.value, outcome] += 1
        if outcome == "WRONG":
            tally.complain(
                f"at {self._client.now():.3f} s {known_as}, which is scale {scale.number} at {scale.unit}, was asked "
                f"{pdu} and answered {answer.hex(' ')}"
            )
        return answer

    def _outcome(self, scale: Scale, pdu: str, answer: bytes, is_right: Callable[[bytes], bool]) -> str:
        if not answer[0] & EXCEPTION_BIT:
            return "right data" if is_right(answer) else "WRONG"
        if answer[1] in OF_GATEWAY:
            return f"{answer[1]:02X}"
        is_refused = answer[1] == REFUSED and not pdu.startswith("03")
        self._world.tally.counts["refused moves"] += is_refused
        return "device's exception" if is_refused or answer[1] == EXCEPTIONS + scale.number else "WRONG"
