"""An outside client that is impatient, changes its mind, and shares its line with others and with noise.

It believes, as such clients do, that the next response that fits is the answer to what it asked last. So a response is
right only if the last thing that was heard on the line is the request that it answers.
"""

import asyncio
from collections import Counter
from random import Random

import pytest

from gateway.modbus import ascii as ascii_framing
from gateway.modbus import rtu
from gateway.modbus.frame import Frame
from kit.device import Answer, SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench, gateway_bench
from kit.noise import flipped

CONFIG = """
[[line]]
name     = "hall"
port     = "/dev/hall"
baud     = 19200
max_wait = "500 ms"
devices  = [{ unit = "1-3", as = "41-43", timeout = "150 ms" }]

[[line]]
name          = "panel"
port          = "/dev/panel"
mode          = "MODE"
baud          = 19200
role          = "server"
serves        = ["41-43", 200]
answer_within = "300 ms"
broadcast_to  = "all"

[[image]]
unit    = 200
holding = 200
"""
CONFIG += f"initial.holding = [{{ at = 0, values = {[200 * 256 + address for address in range(200)]} }}]\n"

#: Longer than what is taken for a glitch right behind a frame: 3.5 characters, and 5 ms for the port.
BEHIND_A_GLITCH = 0.008


class MoodyDevice(SimulatedDevice):
    """Answers in time, late, or not at all; its registers say whose and which they are."""

    def __init__(self, unit: int, known_as: int, dice: Random) -> None:
        super().__init__(unit)
        self.holding = [known_as * 256 + address for address in range(200)]
        self._dice = dice

    def ask(self, frame: Frame, encode: object) -> list[Answer]:
        self.delay = self._dice.choice([0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.35])
        self.silent = self._dice.random() < 0.1
        return super().ask(frame, encode)


class Panel:
    """The outside client and everything else on its line. `seen` counts what became of it."""

    def __init__(self, bench: GatewayBench, mode: str, dice: Random) -> None:
        self.seen: Counter[str] = Counter()
        self.wrong: list[str] = []
        self._encode = ascii_framing.encode if mode == "ascii" else rtu.encode
        self._line = bench.lines["panel"]
        self._line.on_write = self._responded
        self._dice = dice
        self._asked: Frame | None = None
        self._asked_at = 0.0
        self._answered = asyncio.Event()
        self._now = asyncio.get_running_loop().time

    async def act(self) -> None:
        """Say something, and wait for the answer, or not quite so long."""
        dice = self._dice
        await dice.choices(
            [self._ask, self._ask_broken, self._ask_another_server, self._broadcast, self._make_noise],
            weights=[70, 10, 10, 5, 5],
        )[0]()
        self._answered.clear()
        try:
            async with asyncio.timeout(dice.choice([0.0, 0.02, 0.06, 0.4]) + dice.uniform(0.0, 0.001)):
                await self._answered.wait()
        except TimeoutError:
            self.seen["impatient"] += self._asked is not None
        await asyncio.sleep(dice.choice([BEHIND_A_GLITCH, 0.05]))

    async def _ask(self) -> None:
        frame = self._question()
        glitch = b"\xff" * self._dice.choice([0, 0, 0, 1, 3])
        await self._say(self._encode(*frame), glitch)
        self._asked, self._asked_at = frame, self._now()
        self.seen["asked"] += 1

    async def _ask_broken(self) -> None:
        data = self._encode(*self._question())
        broken = flipped(data, self._dice.randrange(8 * len(data)))
        if bytes(byte & 0x7F for byte in broken).upper() != data:  # digits in lower case are as good, and any parity
            await self._say(broken)

    async def _ask_another_server(self) -> None:
        """It answers, sometimes so late that the client has gone on, sometimes glued to the next request."""
        count = self._dice.randrange(1, 60)
        await self._say(self._encode(7, bytes((3, 0, 0, 0, count))))
        if self._dice.random() < 0.7:
            await asyncio.sleep(self._dice.choice([BEHIND_A_GLITCH, 0.1]))
            response = self._encode(7, bytes((3, 2 * count)) + self._dice.randbytes(2 * count))
            await self._say(response)

    async def _broadcast(self) -> None:
        await self._say(self._encode(0, bytes((6, 0, 199, 0, 5))))

    async def _make_noise(self) -> None:
        await self._say(self._dice.randbytes(self._dice.randint(1, 20)).replace(b":", b"\xff"))

    def _question(self) -> Frame:
        unit, address, count = self._dice.choice([41, 42, 43, 200]), self._dice.randrange(100), self._dice.randint(1, 4)
        return Frame(unit, bytes((3, 0, address, 0, count)))

    async def _say(self, data: bytes, behind: bytes = b"") -> None:
        """In one piece or two."""
        self._asked = None
        at = self._dice.randrange(len(data)) if self._dice.random() < 0.3 else 0
        if at:
            self._line.deliver(data[:at])
            await asyncio.sleep(0.001)
        self._line.deliver(data[at:] + behind)

    def _responded(self, data: bytes) -> None:
        asked, self._asked = self._asked, None
        self._answered.set()
        if asked is None:
            self.wrong.append(f"{data.hex()} though nothing was asked")
            return
        elapsed = self._now() - self._asked_at
        unit, (_, _, address, _, count) = asked.unit, asked.pdu
        values = b"".join((unit * 256 + address + at).to_bytes(2) for at in range(count))
        right = {self._encode(unit, bytes((3, 2 * count)) + values): "answered"}
        right |= {self._encode(unit, bytes((0x83, code))): "failed" for code in (6, 0x0A, 0x0B)}
        if data not in right or elapsed > 0.3:
            self.wrong.append(f"{data.hex()} as the answer to {asked} after {elapsed:.3f} s")
        self.seen[right.get(data, "wrong")] += 1


@pytest.mark.parametrize("mode", ["rtu", "ascii"])
@pytest.mark.parametrize("seed", range(5))
async def test_whatever_happens_no_wrong_answer_is_put_on_the_line(mode: str, seed: int) -> None:
    dice = Random(seed)
    async with gateway_bench(CONFIG.replace("MODE", mode)) as bench:
        devices = [MoodyDevice(unit, known_as, dice) for unit, known_as in ((1, 41), (2, 42), (3, 43))]
        bench.attach("hall", SimulatedLine("rtu", *devices))
        panel = Panel(bench, mode, dice)
        for _ in range(600):
            await panel.act()
        counts = bench.gateway.servers[0].driver.session.counts
    assert panel.wrong == []
    assert panel.seen["asked"] == counts.requests
    assert panel.seen["answered"] + panel.seen["failed"] == counts.responses
    assert min(panel.seen["answered"], 20 * counts.overtaken, 20 * counts.foreign_frames, 20 * counts.noise) > 150
