"""What clients of the soak ask, and what they can be answered: only what is true at that moment."""

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Final

from gateway.modbus.codes import COUNTERS, Area
from gateway.registers.items import pack_bits, unpack_bits
from kit.faulty import OWN_FUNCTION, Fault, bit, counter, word
from soak.kinds_of_lines import NUMBERS

CLIENTS: Final = 24
#: From here on each client has 8 holding registers and 8 coils of each device that nobody else writes; the last
#: register is written by broadcasts only.
OWN: Final = 256
OWN_ITEMS: Final = 8


class Item:
    """What a register or coil that clients write can hold at the moment, as far as clients can know."""

    __slots__ = ("pending", "possible", "watchers")

    def __init__(self, value: int) -> None:
        self.possible = {value}
        #: A write is under way.
        self.pending = False
        #: What others who are just reading it may be answered.
        self.watchers: list[set[int]] = []

    def writing(self, values: set[int]) -> None:
        """A write has been asked for, of one of these values."""
        self.pending = True
        for watcher in self.watchers:
            watcher.update(values)

    def written(self, values: set[int], *, sure: bool) -> None:
        """The write was answered: it has happened, or nobody knows."""
        self.pending = False
        self.possible = values if sure else self.possible | values


#: Says what is wrong with the data of a response, None if nothing is.
Check = Callable[[bytes], str | None]


@dataclass(slots=True)
class Question:
    """A request under way. `settle` is told how it ended: 'done', 'not sent' or 'unknown'."""

    unit: int
    pdu: bytes
    check: Check
    settle: Callable[[str], None] | None = None
    asked_at: float = 0.0
    #: What happened to it on the line, the last time; how often it was there, and the exceptions that it was answered.
    fault: Fault | None = None
    codes: set[int | None] = field(default_factory=set)
    tries: int = 0


class Values:
    """What the devices can hold where clients write."""

    def __init__(self) -> None:
        self.registers: dict[tuple[int, int], Item] = {}
        self.coils: dict[tuple[int, int], Item] = {}
        for number in NUMBERS.values():
            for address in range(OWN, OWN + OWN_ITEMS * CLIENTS):
                self.registers[number, address] = Item(word(number, Area.HOLDING, address))
                self.coils[number, address] = Item(bit(number, Area.COILS, address))
        self._value = 0

    def may_hold(self, number: int, area: Area, address: int, value: int) -> bool:
        """Whether a register can have this value now; one that is just written, or by broadcasts, any."""
        item = self.registers.get((number, address)) if area is Area.HOLDING else None
        if item is None:
            return value == word(number, area, address)
        by_broadcasts = (address - OWN) % OWN_ITEMS == OWN_ITEMS - 1
        return item.pending or by_broadcasts or value in item.possible

    def new_value(self) -> int:
        """A register value that has not been written for long."""
        self._value = (self._value + 1) & 0xFFFF
        return self._value


class Questions:
    """The questions of client `number`; it has counted its broadcasts."""

    def __init__(self, values: Values, number: int, dice: random.Random) -> None:
        self.broadcasts = 0
        self._values = values
        self._dice = dice
        self._own = OWN + OWN_ITEMS * number
        self._units = list(NUMBERS)

    def think_of_one(self) -> Question:
        kind = self._dice.choices(_KINDS, cum_weights=_WEIGHTS)[0]
        unit = self._dice.choice(self._units)
        return kind(self, unit, NUMBERS[unit])

    def _read_registers(self, unit: int, number: int) -> Question:
        function = self._dice.choice((3, 3, 4))
        # Few different ones, so that clients ask the same, and the same shape, at the same time.
        start, count = self._dice.choice(_SPANS)
        data = _static_words(number, Area.INPUT if function == 4 else Area.HOLDING, start, count)
        return Question(unit, _words(function, start, count), _expect(bytes((function, len(data))) + data))

    def _read_bits(self, unit: int, number: int) -> Question:
        function = self._dice.choice((1, 2))
        start, count = self._dice.choice(_BIT_SPANS)
        data = _static_bits(number, Area.COILS if function == 1 else Area.DISCRETE, start, count)
        return Question(unit, _words(function, start, count), _expect(bytes((function, len(data))) + data))

    def _read_own(self, unit: int, number: int) -> Question:
        """A client's requests to one unit keep their order: what it sees is what its last write left."""
        first = self._own + self._dice.randrange(OWN_ITEMS)
        count = self._dice.randint(1, self._own + OWN_ITEMS - first)
        items = [self._values.registers[number, address] for address in range(first, first + count)]
        return Question(
            unit, _words(3, first, count), lambda pdu: _not_possible(pdu, [item.possible for item in items])
        )

    def _read_own_coils(self, unit: int, number: int) -> Question:
        items = [self._values.coils[number, address] for address in range(self._own, self._own + OWN_ITEMS)]

        def check(pdu: bytes) -> str | None:
            bits = unpack_bits(pdu[2:], OWN_ITEMS)
            fits = len(pdu) == 3 and all(value in item.possible for value, item in zip(bits, items, strict=True))
            return None if fits else f"the coils can be {[item.possible for item in items]}"

        return Question(unit, _words(1, self._own, OWN_ITEMS), check)

    def _read_others(self, unit: int, number: int) -> Question:
        """The answer is newer than the question: not what it held before the last write that was confirmed by then."""
        address = OWN + OWN_ITEMS * self._dice.randrange(CLIENTS) + self._dice.randrange(2)
        item = self._values.registers[number, address]
        if item.pending:
            return self._read_registers(unit, number)
        watcher = set(item.possible)
        item.watchers.append(watcher)

        def settle(fate: str) -> None:
            item.watchers = [each for each in item.watchers if each is not watcher]

        return Question(unit, _words(3, address, 1), lambda pdu: _not_possible(pdu, [watcher]), settle)

    def _write_register(self, unit: int, number: int) -> Question:
        address = self._own + self._dice.randrange(OWN_ITEMS - 1)
        item = self._values.registers[number, address]
        if item.pending:
            return self._read_own(unit, number)
        value = self._values.new_value()
        pdu = _words(6, address, value)
        return Question(unit, pdu, _expect(pdu), _settle([item], [{value}]))

    def _mask_register(self, unit: int, number: int) -> Question:
        address = self._own + self._dice.randrange(OWN_ITEMS - 1)
        item = self._values.registers[number, address]
        if item.pending or len(item.possible) > 4:
            return self._write_register(unit, number)
        mask, value = 0xFF00, self._values.new_value()
        pdu = _words(22, address, mask, value)
        return Question(
            unit, pdu, _expect(pdu), _settle([item], [{old & mask | value & ~mask for old in item.possible}])
        )

    def _write_registers(self, unit: int, number: int) -> Question:
        items, first, values = self._own_values(number)
        if not items:
            return self._read_own(unit, number)
        pdu = _words(16, first, len(items)) + bytes((2 * len(items),)) + b"".join(each.to_bytes(2) for each in values)
        return Question(unit, pdu, _expect(pdu[:5]), _settle(items, [{value} for value in values]))

    def _write_and_read(self, unit: int, number: int) -> Question:
        items, first, values = self._own_values(number)
        if not items:
            return self._read_own(unit, number)
        data = b"".join(each.to_bytes(2) for each in values)
        pdu = _words(23, first, len(items), first, len(items)) + bytes((len(data),)) + data
        return Question(
            unit, pdu, _expect(bytes((23, len(data))) + data), _settle(items, [{value} for value in values])
        )

    def _own_values(self, number: int) -> tuple[list[Item], int, list[int]]:
        first = self._own + self._dice.randrange(OWN_ITEMS - 1)
        count = self._dice.randint(1, self._own + OWN_ITEMS - 1 - first)
        items = [self._values.registers[number, address] for address in range(first, first + count)]
        if any(item.pending for item in items):
            return [], 0, []
        return items, first, [self._values.new_value() for _ in items]

    def _write_coil(self, unit: int, number: int) -> Question:
        address = self._own + self._dice.randrange(OWN_ITEMS)
        item = self._values.coils[number, address]
        if item.pending:
            return self._read_own_coils(unit, number)
        value = self._dice.randrange(2)
        pdu = _words(5, address, 0xFF00 * value)
        return Question(unit, pdu, _expect(pdu), _settle([item], [{value}]))

    def _write_coils(self, unit: int, number: int) -> Question:
        items = [self._values.coils[number, address] for address in range(self._own, self._own + OWN_ITEMS)]
        if any(item.pending for item in items):
            return self._read_own_coils(unit, number)
        values = [self._dice.randrange(2) for _ in items]
        pdu = _words(15, self._own, OWN_ITEMS) + b"\1" + pack_bits(bytes(values))
        return Question(unit, pdu, _expect(pdu[:5]), _settle(items, [{value} for value in values]))

    def _unknown_function(self, unit: int, number: int) -> Question:
        data = self._dice.randbytes(self._dice.randint(2, 8))
        return Question(unit, bytes((OWN_FUNCTION,)) + data, _expect(bytes((OWN_FUNCTION, number)) + data))

    def _read_counter(self, unit: int, number: int) -> Question:
        """A counter that is 0 looks like a request to read it."""
        sub_function = self._dice.choice(COUNTERS)
        head = bytes((8, 0, sub_function))
        return Question(unit, head + bytes(2), _expect(head + counter(number, sub_function).to_bytes(2)))

    def _broadcast(self, unit: int, number: int) -> Question:
        """A register that this client's broadcasts write, and nothing else: a device may hear one or not."""
        address, value = self._own + OWN_ITEMS - 1, self._values.new_value()
        for each in NUMBERS.values():
            self._values.registers[each, address].possible.add(value)
        self.broadcasts += 1
        return Question(0, _words(6, address, value), _expect(b""))


_SPANS = [(0, 1), (0, 4), (16, 4), (32, 4), (48, 4), (100, 2), (102, 2), (7, 1), (9, 1), (60, 40), (100, 100)]
_BIT_SPANS = [(0, 16), (16, 24), (40, 20), (3, 30), (100, 18)]
_MIX: dict[Callable[[Questions, int, int], Question], int] = {
    Questions._read_registers: 440,
    Questions._read_bits: 120,
    Questions._read_own: 120,
    Questions._read_own_coils: 20,
    Questions._read_others: 80,
    Questions._write_register: 80,
    Questions._write_registers: 50,
    Questions._write_and_read: 20,
    Questions._mask_register: 20,
    Questions._write_coil: 20,
    Questions._write_coils: 15,
    Questions._unknown_function: 13,
    Questions._read_counter: 20,
    Questions._broadcast: 2,
}
_KINDS = list(_MIX)
_WEIGHTS = [sum(list(_MIX.values())[: at + 1]) for at in range(len(_MIX))]


def _settle(items: Sequence[Item], values: Sequence[set[int]]) -> Callable[[str], None]:
    """Remember that `items` are being written; the result is to be told how that ended."""
    for item, value in zip(items, values, strict=True):
        item.writing(value)

    def settle(fate: str) -> None:
        for item, value in zip(items, values, strict=True):
            if fate == "not sent":
                item.pending = False
            else:
                item.written(value, sure=fate == "done")

    return settle


def _words(function: int, *words: int) -> bytes:
    return bytes((function,)) + b"".join(each.to_bytes(2) for each in words)


def _expect(response: bytes) -> Check:
    return lambda pdu: None if pdu == response else f"it is {response.hex(' ').upper()}"


def _not_possible(pdu: bytes, possible: Sequence[set[int]]) -> str | None:
    values = [int.from_bytes(pdu[at : at + 2]) for at in range(2, len(pdu), 2)]
    fits = len(values) == len(possible) and all(value in each for value, each in zip(values, possible, strict=True))
    return None if fits and pdu[1] == len(pdu) - 2 else f"it can be {[sorted(each)[:8] for each in possible]}"


@cache
def _static_words(number: int, area: Area, start: int, count: int) -> bytes:
    return b"".join(word(number, area, address).to_bytes(2) for address in range(start, start + count))


@cache
def _static_bits(number: int, area: Area, start: int, count: int) -> bytes:
    return pack_bits(bytes(bit(number, area, address) for address in range(start, start + count)))
