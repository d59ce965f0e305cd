"""Devices that change their addresses: whoever answers is the device that the client means.

Scales that work in order and scales that do not, late, lost and second answers, clients that move them to free and to
taken addresses and let them change places, broadcasts to all addresses, reloads, edited configs, restarts and kills, a
spare at the configured address of a scale that has moved and is off, an operator who sets scales back by hand.
"""

import asyncio
import random
from contextlib import AsyncExitStack, suppress
from typing import TYPE_CHECKING, Final, cast

from gateway.errors import WrongQuestion
from gateway.events import PartFailed
from gateway.operator.units.forgetting import forget
from gateway.runtime.overdue import LeftBehind
from gateway.state.memory import Memory
from kit.gateway_bench import GatewayBench
from kit.memory import MemoryLine
from soak.scale_clients import ScaleClient
from soak.scales import TIMEOUT, Scale, ScalesLine, words
from soak.tally import Tally

if TYPE_CHECKING:
    from gateway.devices.quirks import MovableDevice

#: The lines, and whether the scales on each work in order. Clients know the second scale of the second line as 46.
LINES: Final = {"hall": True, "yard": False}
SCALES: Final = 4
CLIENTS: Final = 10
SPARE: Final = 31

PROFILE: Final = f"""
[[listen]]
bind  = "tcp://127.0.0.1:0"
unit0 = "broadcast"
[profile.scale]
functions = [3, 6, 16, 22, 23]
quirks    = ["moves", "changes_baud"]
timeout   = "{1000 * TIMEOUT:g} ms"
wake      = "500 ms"
points    = [{{ name = "first", holding = 0 }}]
"""


class World:
    """Scales, and a gateway before them that is reloaded and restarted. `units` are what its config says."""

    def __init__(self, transactions: int, share: float, seed: int) -> None:
        self.tally = Tally()
        self.dice = random.Random(seed)
        self.units: dict[int, int] = {}
        self.scales: dict[int, Scale] = {}
        self.ends: dict[int, ScalesLine] = {}
        #: Changes of addresses that clients wait for; whether they may ask for one; where none may lead.
        self.changes = 0
        self.may_move = True
        self.shunned = 0
        self.bench: GatewayBench
        self._goal = transactions
        self._memory = Memory()
        self._left_behind = LeftBehind()
        self._lines = {name: MemoryLine(f"/dev/{name}", 0.005) for name in LINES}
        self._ends: dict[str, ScalesLine] = {}
        for at, (name, in_order) in enumerate(LINES.items()):
            own = {40 + SCALES * at + unit: Scale(SCALES * at + unit, unit, in_order) for unit in range(1, SCALES + 1)}
            spare = Scale(SPARE, 0, in_order, is_off=True)
            end = ScalesLine(self._lines[name], [*own.values(), spare], share, 10 * seed + at, self.tally)
            self._ends[name] = end
            self.scales |= own
            self.units |= {known_as: scale.unit for known_as, scale in own.items()}
            self.ends |= dict.fromkeys(own, end)

    @property
    def is_over(self) -> bool:
        """Whether there have been enough transactions."""
        return self.tally.transactions >= self._goal

    async def start(self) -> None:
        """Start a gateway, and its clients."""
        self.bench = GatewayBench(self._config(), self._memory, left_behind=self._left_behind)
        self.bench.lines = self._lines
        self._open = AsyncExitStack()
        self._running = self.bench.running
        await self._open.enter_async_context(self._running.lines_open())
        await self._running.tried()
        self._clients = [asyncio.create_task(ScaleClient(self, number).run()) for number in range(CLIENTS)]

    async def stop(self) -> None:
        """Stop the gateway in an orderly way."""
        await self._running.drain(lambda: False)
        await self._end()

    async def _kill(self) -> None:
        """Kill the gateway: it leaves what is remembered, and nobody knows which answers may still come."""
        entries = {key: dict(entry) for key, entry in self._memory._entries.items()}
        await self._end()
        self._memory, self._left_behind = Memory(entries=entries), LeftBehind()
        await asyncio.sleep(2.0)

    async def _end(self) -> None:
        for client in self._clients:
            self.tally.abandoned += client.cancel()
        await asyncio.gather(*self._clients, return_exceptions=True)
        self.changes = 0
        await self._open.aclose()
        self.take_events()

    # --- what happens to the gateway and to the scales ---

    async def disturb(self) -> None:
        """Let something happen now and then. Who works on scales or config does so while no address is changing."""
        of_gateway, by_hand = (self._reload, self._restart, self._restart_after_kill), (self._edit, self._set_back)
        while not self.is_over:
            await asyncio.sleep(self.dice.uniform(0.5, 5.0))
            step = self.dice.choice((*of_gateway, *by_hand, self._spare))
            self.may_move = step in of_gateway
            if not self.may_move:
                await asyncio.sleep(1.0)
            if self.may_move or (self.changes == 0 and all(end.is_settled for end in self._ends.values())):
                await step()
            self.may_move = True

    async def _reload(self) -> None:
        """Read a config that differs in nothing that matters here, so that each line is replaced."""
        await self.bench.reload(self._config())

    async def _edit(self) -> None:
        """Write the true addresses into the config."""
        self.units = {known_as: scale.unit for known_as, scale in self.scales.items()}
        await self._reload()

    async def _restart(self) -> None:
        await self.stop()
        await self.start()

    async def _restart_after_kill(self) -> None:
        await self._kill()
        await self.start()

    async def _spare(self) -> None:
        """A scale that has moved is off; at its address in the config there is a spare for a while."""
        known_as = self.dice.choice(list(self.units))
        scale, end, unit = self.scales[known_as], self.ends[known_as], self.units[known_as]
        if scale.unit == unit or not self._is_free(known_as, unit) or unit in self._possible_units(known_as):
            return
        self.tally.counts["spares"] += 1
        self.shunned, self.may_move = unit, True
        spare = end.scales[-1]
        scale.is_off = True
        spare.start(unit)
        await asyncio.sleep(self.dice.uniform(2.0, 20.0))
        spare.unit, spare.is_off = 0, True
        scale.start(scale.unit)
        self.shunned = 0

    async def _set_back(self) -> None:
        """A scale gets its address in the config by hand, and the gateway is told to forget the other one."""
        known_as = self.dice.choice(list(self.units))
        scale, unit = self.scales[known_as], self.units[known_as]
        if not self._is_free(known_as, unit):
            return
        self.tally.counts["addresses set by hand"] += 1
        scale.start(unit)
        with suppress(WrongQuestion):  # a change may be under way; until it is told, the gateway hears nothing of it
            forget(self.bench.gateway, known_as, self.bench.events.append)

    def _is_free(self, known_as: int, unit: int) -> bool:
        """Whether a scale could get this address by hand: nobody has it, or may have it as far as the gateway knows."""
        (line,) = (line for line in self.bench.gateway.lines if known_as in line.devices)
        return self.ends[known_as].is_empty(unit) and line._addresses.is_free(unit, line.devices[known_as].name)

    def _possible_units(self, known_as: int) -> tuple[int, ...]:
        """The addresses that a scale may have, as far as the gateway knows: it believes who answers there."""
        devices = {known: device for line in self.bench.gateway.lines for known, device in line.devices.items()}
        return cast("MovableDevice", devices[known_as]).possible_units

    # --- reports ---

    def check_values(self) -> None:
        """Compare what is shown as the values of all scales with what they hold, wherever they are."""
        for line in self.bench.gateway.lines:
            for known_as, device in line.devices.items():
                number = self.scales[known_as].number
                for read in device.last_reads.of(device.unit):
                    self.tally.counts["values shown"] += 1
                    right = words(number, read.span.start, read.span.count)
                    if read.response[2:] != right:
                        where = f"{known_as}, which is scale {number}, at {device.unit}"
                        self.tally.complain(f"{read.response.hex(' ')} is shown for {read.span.start} of {where}")

    def take_events(self) -> None:
        """Count the events so far."""
        for event in self.bench.events:
            self.tally.events[event.name] += 1
            if isinstance(event, PartFailed):
                self.tally.complain(f"a defect: {event.error}\n{event.traceback}")
        self.bench.events.clear()

    def _config(self) -> str:
        """A line table with another time each time, so that a reload replaces the line."""
        lines = []
        for name in LINES:
            rows = [
                f'{{ unit = {unit}, as = {known_as}, name = "scale-{known_as}", profile = "scale" }},'
                for known_as, unit in self.units.items()
                if self.ends[known_as] is self._ends[name]
            ]
            wait = self.dice.randint(3000, 9000)
            lines += ["[[line]]", f'name = "{name}"', f'port = "/dev/{name}"', "baud = 19200"]
            lines += [f'max_wait = "{wait} ms"', "devices = [", *rows, "]"]
        return "\n".join([PROFILE, *lines])


async def play(transactions: int, share: float, seed: int) -> Tally:
    """One run; the running loop is in virtual time."""
    world = World(transactions, share, seed)
    await world.start()
    disturbing = asyncio.create_task(world.disturb())
    while not world.is_over:
        await asyncio.sleep(1.0)
        world.take_events()
        world.check_values()
    await disturbing
    await world.stop()
    world.tally.virtual_seconds = asyncio.get_running_loop().time()
    return world.tally
