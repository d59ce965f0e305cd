"""A drive whose speed has limits: nobody writes another speed there, whichever way he comes."""

import asyncio
from random import Random

import pytest

from gateway.errors import DoesNotFit, UnitFailed, WrongQuestion
from gateway.events import RequestRefused, WriteAudit
from gateway.modbus import rtu
from kit.asking import ask
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench, gateway_bench

CONFIG = """
[profile.drive]
functions = [3, 5, 6, 15, 16, 22, 23]
points = [
  { name = "speed", holding = 10, type = "int32", swap = "words", scale = 0.1, LIMITS, write = true },
  { name = "mode", holding = 20, bits = "0-2", max = 5, write = true },
  { name = "enable", holding = 20, bit = 7, write = true },
]

[profile.silo]
functions = [3, 6, 16]
points = [{ name = "level", holding = 0, write = true, max = 10 }]

[[listen]]
bind   = "tcp://127.0.0.1:5021"
unit0  = "broadcast"

[[listen]]
bind   = "tcp://127.0.0.1:5022"
line   = "hall"
unit0  = "broadcast"

[[line]]
name      = "hall"
port      = "/dev/hall"
broadcast = true
devices   = [{ unit = 1, as = 11, name = "drive", profile = "drive", points = [RAMP] }]

[[line]]
name      = "yard"
port      = "/dev/yard"
broadcast = true
devices   = [{ unit = 1, as = 21, name = "pump" }]

[[upstream]]
name  = "plant"
to    = "tcp://10.1.0.5:502"
units = [{ as = 41, unit = 1, name = "far-drive", profile = "drive" }]

[[line]]
name   = "panel"
port   = "/dev/panel"
role   = "server"
serves = [11, 41, 50, 60, 70]

[[image]]
unit    = 50
name    = "box"
profile = "drive"
holding = 100

[[image]]
unit  = 60
of    = "drive"
read  = [{ holding = "0-49", every = "1 s" }]

[[image]]
unit = 70
name = "hall-image"
map  = [
  { at = 0, device = "drive", holding = "0-49", every = "1 s", write = true },
  { at = 60, device = "drive", point = "speed", type = "float32", every = "1 s", write = true },
]

[[image]]
unit    = 80
name    = "silo"
profile = "silo"
map     = [{ at = "level", device = "pump", holding = 5, every = "1 s", write = true }]
"""
LIMITS = 'unit = "rpm", min = 0, max = 1500'
CONFIG = CONFIG.replace("LIMITS", LIMITS).replace("RAMP", '{ name = "ramp", holding = 30, min = 1, write = "only" }')
DRIVES = (11, 41, 50, 60, 70)
GOOD = "10 000A 0002 04 3A98 0000"
TOO_FAST = "10 000A 0002 04 3A99 0000"


class Devices:
    """The drive, the pump on the other line, and the drive behind another server."""

    def __init__(self, bench: GatewayBench) -> None:
        self.drive, self.pump, self.far = SimulatedDevice(), SimulatedDevice(), SimulatedDevice()
        bench.attach("hall", SimulatedLine("rtu", self.drive))
        bench.attach("yard", SimulatedLine("rtu", self.pump))
        bench.attach_server("tcp://10.1.0.5:502", self.far)

    @classmethod
    async def of(cls, bench: GatewayBench) -> "Devices":
        """Connect them, and let the polls that failed before be over."""
        devices = cls(bench)
        await asyncio.sleep(5.0)
        devices.written()
        return devices

    def written(self) -> list[str]:
        """What writes the drives have heard since the last look."""
        found = [frame.pdu.hex().upper() for one in (self.drive, self.far) for frame in one.heard if frame.pdu[0] > 4]
        self.drive.heard.clear()
        self.far.heard.clear()
        return found


async def over_serial(bench: GatewayBench, unit: int, pdu: str) -> str:
    """What a client on the serial line gets."""
    line, heard = bench.lines["panel"], []
    line.on_write = heard.append
    line.deliver(rtu.encode(unit, bytes.fromhex(pdu)))
    await asyncio.sleep(3.0)
    return b"".join(heard)[1:-2].hex(" ").upper()


@pytest.mark.parametrize("unit", DRIVES)
async def test_every_way_to_the_drive_meets_the_guard(unit: int) -> None:
    async with gateway_bench(CONFIG) as bench:
        devices, client = await Devices.of(bench), bench.client()
        assert (await client.asks(unit, GOOD))[:2] == "10"
        assert (await over_serial(bench, unit, GOOD))[:2] == "10"
        assert len(devices.written()) == (0 if unit == 50 else 2)
        for pdu in (TOO_FAST, "06 000A 0000", "16 000A FFFF 0000", "06 0014 0006", "16 0014 FFFF 0000"):
            assert await client.asks(unit, pdu) == f"{int(pdu[:2], 16) | 0x80:02X} 03"
            assert await over_serial(bench, unit, pdu) == f"{int(pdu[:2], 16) | 0x80:02X} 03"
        assert devices.written() == []
        refused = [event for event in bench.events if isinstance(event, RequestRefused)]
        assert "speed must be 0 to 1500 rpm, not 1500.1" in {event.why for event in refused}
        assert {event.code for event in refused} == {"03"}
        audit = [event.result for event in bench.events if isinstance(event, WriteAudit)]
        assert audit == ["ok"] * 2 + ["refused"] * 10


async def test_a_value_of_a_map_is_converted_first() -> None:
    async with gateway_bench(CONFIG) as bench:
        devices, client = await Devices.of(bench), bench.client()
        assert await client.asks(70, "10 003C 0002 04 44BB 8000") == "10 00 3C 00 02"
        assert devices.drive.holding[10:12] == [15000, 0]
        assert await client.asks(70, "10 003C 0002 04 44BB A000") == "90 03"
        assert devices.drive.holding[10:12] == [15000, 0]


async def test_a_virtual_unit_with_a_profile_guards_the_points_of_that_too() -> None:
    async with gateway_bench(CONFIG) as bench:
        devices, client = await Devices.of(bench), bench.client()
        assert await client.asks(80, "06 0000 000A") == "06 00 00 00 0A"
        assert await client.asks(80, "06 0000 000B") == "86 03"
        assert await client.asks(21, "06 0005 000B") == "06 00 05 00 0B"
        assert devices.pump.holding[5] == 11


async def test_a_point_that_a_device_has_beside_its_profile_is_guarded_where_it_is() -> None:
    async with gateway_bench(CONFIG) as bench:
        await Devices.of(bench)
        client = bench.client()
        assert await client.asks(11, "06 001E 0000") == "86 03"
        assert await client.asks(11, "06 001E 0001") == "06 00 1E 00 01"
        assert await client.asks(41, "06 001E 0000") == "06 00 1E 00 00"


# --- broadcasts --------------------------------------------------------------------------------------


@pytest.mark.parametrize("pdu", [GOOD, TOO_FAST, "06 000B 0000", "16 000A FFFF 0000", "10 0000 001F 3E" + "00" * 62])
async def test_a_broadcast_that_touches_a_guarded_point_does_not_go_to_that_line(pdu: str) -> None:
    async with gateway_bench(CONFIG) as bench:
        devices, client = await Devices.of(bench), bench.client()
        client.ask(0, pdu)
        await asyncio.sleep(3.0)
        assert devices.written() == []
        assert [frame.pdu for frame in devices.pump.heard if frame.unit == 0] == [bytes.fromhex(pdu)]
        told = [event for event in bench.events if isinstance(event, RequestRefused)]
        assert ("every device of hall", "03") in {(event.device, event.code) for event in told}
        assert all(event.why.startswith("drive: ") for event in told if event.device == "every device of hall")
        (audit,) = [event for event in bench.events if isinstance(event, WriteAudit)]
        assert (audit.unit, audit.result) == (0, "broadcast")


async def test_other_broadcasts_still_go_to_all_lines() -> None:
    async with gateway_bench(CONFIG) as bench:
        devices, client = await Devices.of(bench), bench.client()
        client.ask(0, "06 0005 0007")
        client.ask(0, "05 000A FF00")
        await asyncio.sleep(3.0)
        assert devices.drive.holding[5] == devices.pump.holding[5] == 7
        assert devices.drive.coils[10]


async def test_a_listener_for_the_line_has_no_other_broadcasts() -> None:
    async with gateway_bench(CONFIG) as bench:
        devices, client = await Devices.of(bench), bench.client(listener=1)
        client.ask(0, GOOD)
        assert await client.asks(1, TOO_FAST) == "90 03"
        assert devices.written() == []


async def test_a_line_that_passes_all_units_through_has_the_guards_of_its_profile() -> None:
    line = '[[line]]\nname = "hall"\nport = "/dev/hall"\nprofile = "drive"\nbroadcast = true\n'
    profile, listen = CONFIG.partition("[profile.silo]")[0], '[[listen]]\nbind = "tcp://127.0.0.1:5021"\n'
    async with gateway_bench(f'{profile}{listen}unit0 = "broadcast"\n{line}') as bench:
        drive, client = SimulatedDevice(7), bench.client()
        bench.attach("hall", SimulatedLine("rtu", drive))
        assert await client.asks(7, TOO_FAST) == "90 03"
        client.ask(0, GOOD)
        assert await client.asks(7, GOOD) == "10 00 0A 00 02"
        assert [(frame.unit, frame.pdu.hex().upper()) for frame in drive.heard] == [(7, GOOD.replace(" ", ""))]


# --- values by name, and bits ------------------------------------------------------------------------


async def write(bench: GatewayBench, name: str, value: str, unit: str = "drive") -> None:
    await ask(bench.running, "write-point", unit=unit, name=name, values=[value])


@pytest.mark.parametrize("unit", ["drive", "box"])
async def test_values_by_name_are_written_within_their_limits(unit: str) -> None:
    async with gateway_bench(CONFIG) as bench:
        await Devices.of(bench)
        await write(bench, "speed", "1500", unit)
        for name, value in (("speed", "1500.1"), ("mode", "6")):
            with pytest.raises(DoesNotFit, match=f"{name} must be"):
                await write(bench, name, value, unit)
        for name, value in (("mode", "5"), ("enable", "1"), ("mode", "0")):
            await write(bench, name, value, unit)
        told = await ask(bench.running, "points", unit=unit)
        assert {each.point: each.value for each in told["values"] if each.point != "ramp"} == {
            "speed": 1500,
            "mode": 0,
            "enable": 1,
        }


async def test_bits_beside_a_guarded_value_are_written_with_the_whole_register() -> None:
    """Function 22 would not tell what the guarded value becomes, so the register is read first."""
    async with gateway_bench(CONFIG) as bench:
        drive = (await Devices.of(bench)).drive
        drive.holding[20] = 0xAA03
        drive.heard.clear()
        await write(bench, "enable", "1")
        await write(bench, "mode", "2")
        assert [frame.pdu[0] for frame in drive.heard] == [3, 6, 3, 6]
        assert drive.holding[20] == 0xAA82


async def test_nothing_is_written_if_the_guarded_value_beside_the_bits_is_beyond_its_limits() -> None:
    async with gateway_bench(CONFIG) as bench:
        devices = await Devices.of(bench)
        devices.drive.holding[20] = 0x0007
        with pytest.raises(UnitFailed, match="mode must be at most 5, not 7"):
            await write(bench, "enable", "1")
        assert devices.written() == []
        await write(bench, "mode", "1")
        await write(bench, "enable", "1")
        assert devices.drive.holding[20] == 0x0081
        assert await bench.client().asks(11, "03 0014 0001") == "03 02 00 81"


async def test_behind_another_server_too() -> None:
    async with gateway_bench(CONFIG) as bench:
        devices = await Devices.of(bench)
        devices.far.holding[20] = 0x0007
        with pytest.raises(UnitFailed, match="mode must be at most 5, not 7"):
            await write(bench, "enable", "1", "far-drive")
        assert devices.written() == []
        await write(bench, "mode", "1", "far-drive")
        assert devices.far.holding[20] == 0x0001


# --- a reload ----------------------------------------------------------------------------------------


async def test_what_waits_when_a_reload_adds_a_guard_is_not_sent() -> None:
    """What is on the line then is finished. The line is built anew, and what waited for the old one is over."""
    without = CONFIG.replace(LIMITS, 'unit = "rpm"')
    async with gateway_bench(without) as bench:
        devices, client = await Devices.of(bench), bench.client()
        devices.drive.delay = 0.3
        for pdu in ("06 0000 0001", "06 0001 0001", TOO_FAST):
            client.ask(11, pdu)
        await bench.reload(CONFIG)
        assert sorted([await client.answer() for _ in range(3)]) == ["06 00 00 00 01", "86 0A", "90 0A"]
        assert await client.asks(11, TOO_FAST) == "90 03"
        await asyncio.sleep(10.0)
        assert devices.written() == ["0600000001"]
        await bench.reload(without)
        assert await client.asks(11, TOO_FAST) == "10 00 0A 00 02"


@pytest.mark.parametrize("seed", range(5))
async def test_no_order_of_writes_brings_the_drive_beyond_its_limits(seed: int) -> None:
    """Whatever clients write, by every way: the drive holds a speed and a mode within the limits, all the time."""
    dice = Random(seed)
    async with gateway_bench(CONFIG) as bench:
        devices = await Devices.of(bench)
        beyond, refused = [], []

        def look(frame_heard: object) -> None:
            for one in (devices.drive, devices.far):
                speed = (one.holding[11] << 16 | one.holding[10]) / 10
                if not 0 <= speed <= 1500 or one.holding[20] & 7 > 5:
                    beyond.append((frame_heard, one.holding[10:21]))

        async def writer(number: int) -> None:
            client = bench.client(f"10.0.0.{number}:1", listener=number % 2)
            for _ in range(60):
                unit = dice.choice([1] if number % 2 else DRIVES) if dice.random() < 0.9 else 0
                pdu = any_write(dice)
                client.ask(unit, pdu)
                await asyncio.sleep(dice.choice([0, 0.01, 0.1, 0.5]))
                look(pdu)

        async def by_name() -> None:
            for _ in range(60):
                name, value = dice.choice([("mode", str(dice.randrange(8))), ("enable", "1"), ("speed", "1600")])
                try:
                    await write(bench, name, value, dice.choice(["drive", "far-drive"]))
                except WrongQuestion:
                    refused.append(name)
                look(name)

        await asyncio.gather(by_name(), *(writer(number) for number in range(4)))
        await asyncio.sleep(5.0)
        look("end")
        assert beyond == []
        assert len(devices.written()) > 50
        assert "speed" in refused


def any_write(dice: Random) -> str:
    """A write near the guarded points, with a function of any kind."""
    start, count = dice.choice([8, 9, 10, 11, 18, 19, 20]), dice.randrange(1, 5)
    values = "".join(dice.choice(["0000", "0001", "0007", "3A98", "FFFF"]) for _ in range(count))
    return dice.choice(
        [
            f"06 {start:04X} {values[:4]}",
            f"10 {start:04X} {count:04X} {2 * count:02X} {values}",
            f"16 {start:04X} {values[:4]} {dice.choice(['0000', 'FFFF', '0007'])}",
            f"17 0000 0001 {start:04X} {count:04X} {2 * count:02X} {values}",
            f"05 {start:04X} FF00",
        ]
    )
