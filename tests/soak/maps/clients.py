"""Clients of units with maps: they read parts and whole blocks, write, and judge every answer."""

from collections import deque
from typing import TYPE_CHECKING, Final

from gateway.modbus.codes import EXCEPTION_BIT, Area
from gateway.runtime.gateway import Gateway
from soak.dated_world import JudgingClient
from soak.judge import OF_GATEWAY, WRITE_SEVERAL, write_request
from soak.maps.changing import IMAGE, NOTES
from soak.maps.devices import ITEMS
from soak.maps.reading import MapReading, Meaning
from soak.maps.rows import Row
from soak.maps.writing import RowWrite, to_own, to_row, wrong_write

if TYPE_CHECKING:
    from soak.worlds.maps import MapsWorld

#: The most registers of one read, and the share of reads that take all that is there.
_MOST, _WHOLE = 125, 0.3
_REMEMBERED: Final = 16
#: This share of what was written is read at once.
_LOOKS: Final = 0.5


class MapClient(JudgingClient):
    """A client of the maps of a world; this share of its requests are `writes`."""

    def __init__(self, world: "MapsWorld", gateway: Gateway, name: str, writes: float) -> None:
        super().__init__(world, gateway, name, writes)
        self._maps = world
        self._done: deque[RowWrite] = deque(maxlen=_REMEMBERED)

    async def _ask_something(self) -> bool:
        unit, meaning = self._dice.choice(list(self._maps.meanings().items()))
        if self._dice.random() >= self._writes:
            return await self._read_map(unit, meaning)
        choice = self._dice.random()
        if choice < 0.05:
            return await self._write_image(meaning)
        if choice < 0.1:
            return await self._write_wrongly(unit, meaning)
        if choice < 0.25 and meaning.own:
            return await self._write_own(unit, meaning)
        rows = [row for row in meaning.map.rows if row.write]
        return await (
            self._write_row(unit, meaning, self._dice.choice(rows)) if rows else self._read_map(unit, meaning)
        )

    async def _read_map(self, unit: int, meaning: Meaning) -> bool:
        area = self._dice.choice([area for area, pieces in meaning.pieces.items() if pieces])
        return await self._read_span(unit, meaning, area, *self._span(sorted(meaning.pieces[area])))

    async def _read_span(self, unit: int, meaning: Meaning, area: Area, first: int, items: int) -> bool:
        reading = MapReading(meaning, area, first, items, next(self._order), self._loop.time())
        response = await self._asks(unit, meaning, reading.pdu)
        if not response:
            return False
        trouble = reading.trouble(response, self._done, self._loop.time())
        for outcome in reading.outcomes:
            self._tally.counts[f"rows {outcome}" if outcome in ("fresh", "held", "filled") else "rows WRONG"] += 1
        return self._judge("map", unit, reading.pdu, response, trouble, reading.rows)

    def _span(self, addresses: list[int]) -> tuple[int, int]:
        """Some addresses that are there one behind the other; rarely some that are not."""
        dice = self._dice
        if dice.random() < 0.03:
            first = dice.randrange(addresses[-1] + 2)
            return first, dice.randint(1, min(_MOST, addresses[-1] + 3 - first))
        first = last = at = dice.randrange(len(addresses))
        first = last = at
        while first and addresses[first - 1] == addresses[first] - 1:
            first -= 1
        while last + 1 < len(addresses) and addresses[last + 1] == addresses[last] + 1:
            last += 1
        if dice.random() >= _WHOLE:
            first, last = dice.randint(first, at), dice.randint(at, last)
        return addresses[first], min(_MOST, last + 1 - first)

    # --- writes ---

    async def _write_row(self, unit: int, meaning: Meaning, row: Row) -> bool:
        device = meaning.devices[row.source.device]
        write = to_row(self._dice, self._world.writes, meaning, row, device, next(self._order))
        if write is None:
            return False
        self._done.append(write)
        response = await self._asks(unit, meaning, write.pdu)
        if not response:
            return False
        trouble = write.trouble(response)
        is_done = self._judge("write to a map", unit, write.pdu, response, trouble, [row])
        if is_done and self._maps.meanings().get(unit) is meaning and self._dice.random() < _LOOKS:
            return await self._read_span(unit, meaning, row.area, row.at, row.count)
        return is_done

    async def _write_own(self, unit: int, meaning: Meaning) -> bool:
        write = to_own(self._dice, meaning)
        response = await self._asks(unit, meaning, write.pdu)
        if not response:
            write.left()
            return False
        trouble = write.trouble(response)
        return self._judge("write to own registers", unit, write.pdu, response, trouble, [])

    async def _write_image(self, meaning: Meaning) -> bool:
        """Write to the image that is a source of maps, not through one."""
        image, items = meaning.devices[NOTES], self._dice.randint(1, 3)
        write = self._world.writes.ask(image, self._dice.randrange(ITEMS[Area.HOLDING] + 1 - items), items, 0)
        pdu, right = write_request(WRITE_SEVERAL, write.first, write.values)
        response = await self._asks(IMAGE, image, pdu)
        if not response:
            return False
        list(image.between(Area.HOLDING, 0.0, self._loop.time()))
        trouble = None if response == right else f"it is {right.hex(' ')}"
        return self._judge("write to the image", IMAGE, pdu, response, trouble, [])

    async def _write_wrongly(self, unit: int, meaning: Meaning) -> bool:
        pdu, code = wrong_write(self._dice, self._world.writes, meaning, next(self._order))
        response = await self._asks(unit, meaning, pdu)
        if not response:
            return False
        right = bytes((pdu[0] | EXCEPTION_BIT, code))
        trouble = None if response == right else f"it is {right.hex(' ')}"
        return self._judge("wrong write to a map", unit, pdu, response, trouble, [])

    def _judge(self, kind: str, unit: int, pdu: bytes, response: bytes, trouble: str | None, rows: list[Row]) -> bool:
        """Count the outcome; whether it is data."""
        outcome = "right data"
        if response[0] & EXCEPTION_BIT:
            outcome = f"{response[1]:02X}" if response[1] in OF_GATEWAY else "device's exception"
        self._tally.outcomes[kind, "WRONG" if trouble else outcome] += 1
        if trouble:
            numbers = dict.fromkeys(self._maps.devices[row.source.device].number for row in rows)
            story = [line for number in numbers for line in self._world.passed.get(number, ())]
            self._tally.complain(
                f"at {self._loop.time():.6f} s {self.session.caller.client} asked {unit}: "
                f"{pdu.hex(' ').upper()} and got "
                + "\n    ".join((f"{response.hex(' ').upper()}: {trouble} ({kind})", *sorted(story)))
            )
        return not response[0] & EXCEPTION_BIT
