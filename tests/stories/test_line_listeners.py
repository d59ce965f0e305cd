"""Listeners for one line: addresses on its wire, whatever other clients call them, and nothing else."""

import asyncio
import random
from ipaddress import ip_address, ip_network

import pytest

from gateway.events import RequestRefused
from gateway.modbus import rtu
from kit.gateway_bench import GatewayBench, gateway_bench

LISTEN = """
[[listen]]
name  = "scada"
bind  = "tcp://0.0.0.0:502"
unit0 = "broadcast"

[[listen]]
name  = "hall port"
bind  = "tcp://0.0.0.0:503"
line  = "hall"
unit0 = "broadcast"

[[listen]]
name  = "hall field"
bind  = "udp://0.0.0.0:503"
line  = "hall"
unit0 = 2

[[listen]]
name  = "yard port"
bind  = "tcp://0.0.0.0:504"
line  = "yard"
unit0 = "broadcast"
"""
SCADA, HALL, FIELD, YARD = range(4)
LINES = """
[[line]]
name    = "hall"
port    = "/dev/hall"
devices = [
  { unit = 1, as = 41, name = "silo" },
  { unit = 2, as = 42, profile = "mint" },
  { unit = 3, as = 200 },
  { unit = 2, as = 45 },
  { unit = 0, as = 47 },
]

[[line]]
name    = "yard"
port    = "/dev/yard"
"""
OTHERS = """
[[image]]
unit    = 3
holding = 10

[[image]]
unit    = 255
holding = 10

[[image]]
unit = 241
of   = "silo"
read = [{ holding = "0-1", every = "10 s" }]

[[upstream]]
name  = "plant"
to    = "tcp://10.1.0.5:502"
units = [{ as = 44, unit = 4 }]
"""
CONFIG = LISTEN + LINES + OTHERS
ALL = '[[access]]\nallow = ["read", "write"]\n'
READ, WRITE = "01 0001 0001", "06 0001 0007"
POLL = ("hall", 1, 3)


class Wires:
    """The devices of all lines answer whatever they are asked; `heard` is that, as (line, unit, function)."""

    def __init__(self, bench: GatewayBench) -> None:
        self.heard: list[tuple[str, int, int]] = []
        for name in ("hall", "yard"):
            bench.lines[name].on_write = self._taker(bench, name)

    def _taker(self, bench: GatewayBench, name: str):
        def take(data: bytes) -> None:
            unit, pdu = data[0], data[1:-2]
            self.heard.append((name, unit, pdu[0]))
            answer = pdu if pdu[0] == 6 else bytes((pdu[0], 1, unit))
            if unit:
                asyncio.get_running_loop().call_later(0.005, bench.lines[name].deliver, rtu.encode(unit, answer))

        return take

    def taken(self) -> list[tuple[str, int, int]]:
        """What was heard since the last call, without the polls of the mirror."""
        heard, self.heard = self.heard, []
        return [each for each in heard if each != POLL]

    def written(self, line: str) -> set[int]:
        """The addresses that were written to."""
        return {unit for name, unit, function in self.taken() if (name, function) == (line, 6)}


async def test_unit_identifiers_are_addresses_on_the_wire_of_this_line() -> None:
    async with gateway_bench(CONFIG + ALL) as bench:
        wires = Wires(bench)
        client = bench.client(listener=HALL)
        assert [await client.asks(unit, READ) for unit in (1, 2)] == ["01 01 01", "01 01 02"]
        assert await client.asks(3, WRITE) == "06 00 01 00 07"
        assert wires.taken() == [("hall", 1, 1), ("hall", 2, 1), ("hall", 3, 6)]
        assert await bench.client(listener=FIELD).asks(0, READ) == "01 01 02"
        yard = bench.client(listener=YARD)
        assert [await yard.asks(unit, READ) for unit in (3, 41, 247)] == ["01 01 03", "01 01 29", "01 01 F7"]
        assert [unit for _, unit, _ in wires.taken()] == [2, 3, 41, 247]


async def test_nothing_else_can_be_reached() -> None:
    async with gateway_bench(CONFIG + ALL) as bench:
        wires = Wires(bench)
        for listener, missing in ((HALL, [*range(4, 256)]), (YARD, [*range(248, 256)])):
            client = bench.client(listener=listener)
            assert {await client.asks(unit, READ) for unit in missing} == {"81 0A"}
            assert {await client.asks(unit, WRITE) for unit in missing} == {"86 0A"}
        assert wires.heard == []


@pytest.mark.parametrize(
    ("listener", "unit", "why"),
    [
        (SCADA, 7, "no such unit"),
        (HALL, 41, "no such unit: hall port leads to line hall only"),
        (YARD, 255, "no such unit: yard port leads to line yard only"),
    ],
)
async def test_the_log_says_where_the_listener_leads(listener: int, unit: int, why: str) -> None:
    async with gateway_bench(CONFIG + ALL) as bench:
        await bench.client(listener=listener).asks(unit, READ)
        assert [event.why for event in bench.events if isinstance(event, RequestRefused)] == [why]


async def test_devices_keep_their_profile_limits_and_name() -> None:
    async with gateway_bench(CONFIG + ALL) as bench:
        Wires(bench)
        client = bench.client(listener=HALL)
        assert await client.asks(2, "04 0001 0001") == "84 01"
        assert await client.asks(2, "03 0001 0064") == "83 03"
        routes = bench.gateway.listeners[HALL].router.routes
        assert {device.name for device in routes.values() if hasattr(device, "name")} >= {"silo"}


async def test_a_line_without_devices_beside_others_is_reached_by_its_own_listener_only() -> None:
    async with gateway_bench(CONFIG + ALL) as bench:
        wires = Wires(bench)
        assert await bench.client(listener=SCADA).asks(7, READ) == "81 0A"
        assert await bench.client(listener=YARD).asks(7, READ) == "01 01 07"
        assert wires.taken() == [("yard", 7, 1)]


async def test_an_only_line_without_devices_passes_everything_through() -> None:
    """To clients of other listeners the image stands in front of it."""
    config = LISTEN.partition('[[listen]]\nname  = "yard')[0] + '[[line]]\nname = "hall"\nport = "/dev/hall"\n'
    async with gateway_bench(config + "[[image]]\nunit = 200\ncoils = 10\n" + ALL) as bench:
        bench.lines.setdefault("yard", bench.lines["hall"])
        wires = Wires(bench)
        bench.lines["hall"].on_write = wires._taker(bench, "hall")
        for listener, answer in ((SCADA, "01 01 00"), (HALL, "01 01 C8")):
            assert await bench.client(listener=listener).asks(200, READ) == answer
            assert await bench.client(listener=listener).asks(9, READ) == "01 01 09"
        assert [unit for _, unit, _ in wires.heard] == [9, 200, 9]


async def test_a_broadcast_goes_to_this_line_only() -> None:
    async with gateway_bench(CONFIG + ALL) as bench:
        wires = Wires(bench)
        for listener, lines in ((HALL, ["hall"]), (YARD, ["yard"]), (SCADA, ["hall", "yard"])):
            bench.client(listener=listener).ask(0, WRITE)
            await asyncio.sleep(1)
            assert sorted(wires.taken()) == [(line, 0, 6) for line in lines]
        written = [await bench.client(listener=SCADA).asks(unit, "03 0001 0001") for unit in (3, 255)]
        assert written == ["03 02 00 07"] * 2


async def test_a_line_that_takes_no_broadcasts_gets_none_from_its_own_listener_either() -> None:
    config = CONFIG.replace('port    = "/dev/yard"', 'port = "/dev/yard"\nbroadcast = false')
    async with gateway_bench(config + ALL) as bench:
        wires = Wires(bench)
        bench.client(listener=YARD).ask(0, WRITE)
        await asyncio.sleep(1)
        assert wires.heard == []


# Rights


async def may_write(bench: GatewayBench, host: str, listener: int, unit: int) -> bool:
    """Whether a write of this client is let through; it need not be answered."""
    denied = bench.gateway.listeners[listener].router.counts.denied
    bench.client("10.0.0.9:1", host=host, listener=listener).ask(unit, WRITE)
    await asyncio.sleep(0.2)
    return bench.gateway.listeners[listener].router.counts.denied == denied


@pytest.mark.parametrize(
    ("rows", "hall", "yard"),
    [
        pytest.param("", [], [], id="nobody has said anything, from elsewhere"),
        pytest.param(ALL, [0, 1, 2, 3], [0, 1, 3, 41], id="all"),
        pytest.param('[[access]]\nunits = 41\nallow = ["write"]\n', [1], [], id="silo by its unit"),
        pytest.param('[[access]]\nunits = 1\nallow = ["write"]\n', [], [1], id="no unit of the hall"),
        pytest.param('[[access]]\nunits = 41\nallow = ["read"]\n' + ALL, [2, 3], [0, 1, 3, 41], id="all but the silo"),
        pytest.param('[[access]]\nunits = 3\nallow = ["write"]\n', [], [], id="the image"),
        pytest.param('[[access]]\nunits = 200\nallow = ["write"]\n', [3], [], id="address 3 by its unit"),
        pytest.param('[[access]]\nunits = 42\nallow = ["write"]\n', [], [], id="one of the two units of address 2"),
        pytest.param('[[access]]\nunits = [42, 45]\nallow = ["write"]\n', [2], [], id="both units of address 2"),
        pytest.param(
            '[[access]]\nunits = 47\nallow = ["read"]\n' + ALL, [1, 2, 3], [0, 1, 3, 41], id="not the lone device"
        ),
        pytest.param(
            '[[access]]\nunits = "1-247"\nallow = ["write"]\n', [0, 1, 2, 3], [0, 1, 3, 41], id="every number"
        ),
        pytest.param('[[access]]\nlisten = ["hall port"]\nunits = 1\nallow = ["write"]\n', [1], [], id="by address"),
        pytest.param('[[access]]\nlisten = ["hall port"]\nunits = 41\nallow = ["write"]\n', [], [], id="no address"),
        pytest.param(
            '[[access]]\nlisten = ["hall port"]\nunits = 1\nallow = ["read"]\n' + ALL,
            [2, 3],
            [0, 1, 3, 41],
            id="but address 1",
        ),
        pytest.param('[[access]]\nlisten = ["scada"]\nallow = ["write"]\n', [], [], id="another listener"),
        pytest.param('[[access]]\nunits = 7\nallow = ["read"]\n' + ALL, [1, 2, 3], [1, 3, 41], id="all but yard's 7"),
    ],
)
async def test_who_may_write_where(rows: str, hall: list[int], yard: list[int]) -> None:
    async with gateway_bench(CONFIG + rows) as bench:
        Wires(bench)
        assert [unit for unit in (0, 1, 2, 3) if await may_write(bench, "10.3.0.1", HALL, unit)] == hall
        assert [unit for unit in (0, 1, 3, 41) if await may_write(bench, "10.3.0.1", YARD, unit)] == yard


@pytest.mark.parametrize("row", ["", 'listen = ["hall port"]\n'])
async def test_by_datagrams_nobody_writes_before_a_row_names_their_listener(row: str) -> None:
    async with gateway_bench(CONFIG + f'[[access]]\n{row}allow = ["read", "write"]\n') as bench:
        assert not await may_write(bench, "127.0.0.1", FIELD, 1)
    async with gateway_bench(
        CONFIG + '[[access]]\nlisten = ["hall field"]\nunits = 1\nallow = ["read", "write"]\n'
    ) as bench:
        assert [unit for unit in (0, 1, 2) if await may_write(bench, "127.0.0.1", FIELD, unit)] == [1]


async def test_a_broadcast_needs_the_right_at_255_when_somebody_is_there() -> None:
    rows = '[[access]]\nunits = 255\nallow = ["read"]\n' + ALL
    async with gateway_bench(CONFIG + rows) as bench:
        assert not await may_write(bench, "10.3.0.1", SCADA, 0)
        assert await may_write(bench, "10.3.0.1", SCADA, 41)
    rows = '[[access]]\nunits = "1-247"\nallow = ["write"]\n'
    async with gateway_bench(CONFIG + rows) as bench:
        assert not await may_write(bench, "10.3.0.1", SCADA, 0)
    async with gateway_bench(CONFIG.replace("unit    = 255", "unit    = 5") + rows) as bench:
        assert await may_write(bench, "10.3.0.1", SCADA, 0)


async def test_other_units_for_clients_count_from_the_next_request_on() -> None:
    """Also for a client that is connected: the listener stays."""
    rows = '[[access]]\nunits = 41\nallow = ["write"]\n'
    async with gateway_bench(CONFIG + rows) as bench:
        Wires(bench)
        assert await may_write(bench, "10.3.0.1", HALL, 1)
        old = bench.gateway
        bench.gateway = bench.rebuilt(CONFIG.replace("as = 41", "as = 46") + rows)
        bench.running.apply(bench.gateway)
        assert bench.gateway.listeners == old.listeners
        assert not await may_write(bench, "10.3.0.1", HALL, 1)


# Whatever rows there are


NAMES = {SCADA: "scada", HALL: "hall port", YARD: "yard port"}
HOSTS = ("10.2.0.7", "10.3.0.1", "127.0.0.1")
#: Which units other clients use for each address of the hall.
CALLED = {1: {41}, 2: {42, 45}, 3: {200}}


class Rows:
    """Random rows, and what they mean by the book: the first one that fits client and unit counts."""

    def __init__(self, seed: int) -> None:
        dice = random.Random(seed)
        self.rows = [self._row(dice) for _ in range(dice.randint(1, 5))]

    @staticmethod
    def _row(dice: random.Random) -> tuple[str | None, tuple[int, ...], tuple[int, ...] | None, bool]:
        network = dice.choice([None, None, "10.2.0.0/16", "10.0.0.0/8"])
        listeners = dice.choice([(), (), (SCADA,), (HALL,), (YARD,), (HALL, YARD)])
        numbers = [1, 2, 3, 5, 41, 42, 45, 47, 200]
        units = dice.choice([None, tuple(range(1, 248)), tuple(dice.sample(numbers, dice.randint(1, 4)))])
        return network, listeners, units, dice.random() < 0.5

    def __str__(self) -> str:
        text = ""
        for network, listeners, units, writes in self.rows:
            text += f"[[access]]\nallow = {['read', 'write'] if writes else ['read']}\n"
            text += f'from = ["{network}"]\n' if network else ""
            text += f"listen = {[NAMES[each] for each in listeners]}\n" if listeners else ""
            text += f"units = {list(units)}\n" if units else ""
        return text.replace("'", '"')

    def let(self, host: str, listener: int, identifier: int, unit: int) -> bool:
        """Whether a client writes to what it calls `identifier`, and clients of other listeners call `unit`."""
        for network, listeners, units, writes in self.rows:
            is_from = network is None or ip_address(host) in ip_network(network)
            number = identifier if listeners else unit
            if is_from and (not listeners or listener in listeners) and (units is None or number in units):
                return writes
        return False


@pytest.mark.search
@pytest.mark.parametrize("seed", range(60))
async def test_rows_mean_the_same_device_at_every_door(seed: int) -> None:
    rows = Rows(seed)
    async with gateway_bench(CONFIG + str(rows)) as bench:
        wires = Wires(bench)
        for host in HOSTS:
            for address, units in CALLED.items():
                for unit in units:
                    assert await may_write(bench, host, SCADA, unit) == rows.let(host, SCADA, unit, unit)
                expected = all(rows.let(host, HALL, address, unit) for unit in units)
                assert await may_write(bench, host, HALL, address) == expected
            assert await may_write(bench, host, YARD, 5) == rows.let(host, YARD, 5, 5)
            wires.taken()
            bench.client("10.0.0.9:1", host=host, listener=HALL).ask(0, WRITE)
            await asyncio.sleep(0.5)
            if 0 in wires.written("hall"):
                assert all([await may_write(bench, host, HALL, address) for address in CALLED])


@pytest.mark.search
@pytest.mark.parametrize("seed", range(60, 120))
async def test_without_a_row_that_names_it_a_door_of_one_line_gives_no_right_that_others_do_not(seed: int) -> None:
    """Whatever address is asked, or all of them: the device could have been written through a door for all units."""
    rows = Rows(seed)
    rows.rows = [row for row in rows.rows if not row[1]]
    async with gateway_bench(CONFIG + (str(rows) or ALL)) as bench:
        wires = Wires(bench)
        called = {**CALLED, 0: {41, 42, 45, 47, 200}}
        for host in HOSTS:
            allowed = {unit for unit in set().union(*called.values()) if await may_write(bench, host, SCADA, unit)}
            wires.taken()
            for address in range(248):
                bench.client("10.0.0.9:1", host=host, listener=HALL).ask(address, WRITE)
            await asyncio.sleep(3)
            assert all(called[unit] <= allowed for unit in wires.written("hall"))


PASSING = '[[line]]\nname = "hall"\nport = "/dev/hall"\n'
MIRRORS = """
[[image]]
unit = 5
of   = "hall/5"
read = [{ holding = "0-1", every = "10 s" }]

[[image]]
unit = 45
of   = "hall/3"
read = [{ holding = "0-1", every = "10 s" }]
"""
#: A line without devices, alone or beside another, and which units other clients use for each of its addresses.
ALONE = LISTEN.partition('[[listen]]\nname  = "yard')[0] + PASSING + MIRRORS, {1: {1}, 3: {3}, 5: {5}}
BESIDE = LISTEN + PASSING + LINES.partition("\n]\n")[2] + MIRRORS, {3: {45}, 5: {5}}


@pytest.mark.search
@pytest.mark.parametrize(("config", "called"), [ALONE, BESIDE], ids=["alone", "beside"])
@pytest.mark.parametrize("seed", range(120, 140))
async def test_a_mirror_is_not_got_round(config: str, called: dict[int, set[int]], seed: int) -> None:
    rows = Rows(seed)
    rows.rows = [row for row in rows.rows if YARD not in row[1]] or [(None, (), (5,), False), (None, (), None, True)]
    async with gateway_bench(config + str(rows)) as bench:
        for host in HOSTS:
            for address, units in called.items():
                for unit in units:
                    assert await may_write(bench, host, SCADA, unit) == rows.let(host, SCADA, unit, unit)
                expected = all(rows.let(host, HALL, address, unit) for unit in units)
                assert await may_write(bench, host, HALL, address) == expected


async def test_who_may_only_read_a_mirror_writes_nothing_to_its_device() -> None:
    rows = '[[access]]\nunits = 5\nallow = ["read"]\n' + ALL
    async with gateway_bench(BESIDE[0] + rows) as bench:
        wires = Wires(bench)
        assert await bench.client(listener=SCADA).asks(5, WRITE) == "86 01"
        assert await bench.client(listener=HALL).asks(5, WRITE) == "86 01"
        assert await bench.client(listener=HALL).asks(6, WRITE) == "06 00 01 00 07"
        assert [unit for _, unit, function in wires.heard if function == 6] == [6]
