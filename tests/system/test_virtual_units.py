"""A virtual unit read by clients that others have written: a block of devices on two lines, a server and an image."""

import csv
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from io import StringIO
from struct import pack, unpack
from typing import NamedTuple

import pytest
from pymodbus.client import AsyncModbusTcpClient, ModbusSerialClient

from kit.device import SimulatedDevice, SimulatedLine
from kit.free_port import free_port
from kit.peers import Pymodbus
from kit.process import PATIENCE, GatewayProcess, command
from kit.pty import VirtualPort
from kit.reader import Reader
from kit.serial_line import Cable, SerialDevices

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[profile.meter]
points = [
  {{ name = "power", input = 10, type = "int32", swap = "words", scale = 0.1, unit = "kW" }},
  {{ name = "limit", holding = 20, scale = 0.5, write = true, max = 1000 }},
]

[[line]]
name    = "hall-a"
port    = "{hall_a}"
baud    = 19200
rest    = "off"
devices = [
  {{ unit = 1, as = 41, name = "meter-1", profile = "meter", timeout = "300 ms" }},
  {{ unit = 2, as = 42, name = "meter-2", profile = "meter", timeout = "300 ms" }},
]

[[line]]
name    = "hall-b"
port    = "{hall_b}"
mode    = "ascii"
devices = [{{ unit = 1, as = 51, name = "press", timeout = "20 s" }}]

[[upstream]]
name    = "roof"
to      = "tcp://127.0.0.1:{roof}"
timeout = "20 s"
units   = [{{ unit = 3, as = 61, name = "inverter" }}]

[[line]]
name   = "old-hmi"
port   = "{hmi}"
baud   = 19200
format = "8N1"
role   = "server"
serves = 240
answer_within = "20 s"

[[image]]
unit    = 200
name    = "shift"
holding = 10
initial.holding = [{{ at = 4, values = [4711] }}]

[[image]]
unit    = 240
name    = "block"
stale   = "20 s"
holding = "20-21"
map     = [
  {{ at = 0, device = "meter-1", point = "power", type = "float32", every = "200 ms" }},
  {{ at = 2, device = "press", holding = "100-103", every = "200 ms", write = true }},
  {{ at = 6, device = "press", input = "0-1", swap = "words", every = "200 ms" }},
  {{ at = 8, device = "inverter", holding = "7-8", every = "200 ms" }},
  {{ at = 10, device = "shift", holding = "4", every = "200 ms" }},
  {{ at = 11, device = "meter-1", point = "limit", type = "uint16", every = "200 ms", write = true }},
  {{ at = 12, fresh = ["meter-1", "press", "inverter", "shift"] }},
  {{ at = 0, area = "coils", device = "press", coils = "3-6", every = "200 ms", write = true }},
]

[[image]]
unit  = 241
name  = "dying"
stale = "1 s"
map   = [
  {{ at = 0, device = "meter-2", point = "power", type = "float32", every = "100 ms" }},
  {{ at = 2, device = "meter-2", holding = "30", every = "100 ms", when_stale = "hold" }},
  {{ at = 3, device = "meter-2", holding = "31", every = "100 ms", when_stale = 0x7FC0 }},
  {{ at = 4, fresh = ["meter-2", "press"] }},
  {{ at = 5, device = "press", holding = "100", every = "100 ms" }},
]
"""

BLOCK, DYING = 240, 241
#: 123.4 kW, in registers of a client that takes the high word first.
POWER = unpack(">2H", pack(">f", 123.4))
#: Holding registers 0-12 of the block, before anybody has written: the last one says that all four devices are fresh.
VALUES = [*POWER, 9100, 9101, 9102, 9103, 22, 11, 3 * 256 + 7, 3 * 256 + 8, 4711, 160, 0b1111]


class Plant(NamedTuple):
    """A gateway and its devices. `hmi` is the other end of its server line."""

    gateway: GatewayProcess
    meters: tuple[SimulatedDevice, SimulatedDevice]
    press: SimulatedDevice
    hmi: str

    def ask(self, unit: int, pdu: str) -> str:
        """What the gateway answers, in hex."""
        with closing(Reader(self.gateway.port)) as reader:
            return reader.ask(unit, pdu)

    def becomes(self, unit: int, pdu: str, wanted: str) -> None:
        """Ask until this is the answer."""
        deadline = time.monotonic() + PATIENCE
        while (answer := self.ask(unit, pdu)) != wanted:
            assert time.monotonic() < deadline, answer
            time.sleep(0.02)


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Plant]:
    """Start it, once all values are read."""
    folder = tmp_path_factory.mktemp("virtual-units")
    with ExitStack() as stack:
        ports = {name: stack.enter_context(VirtualPort(folder / name)) for name in ("hall_a", "hall_b", "hmi", "far")}
        meters, press = (SimulatedDevice(1, delay=0.002), SimulatedDevice(2, delay=0.002)), SimulatedDevice(1, delay=0)
        for meter in meters:
            meter.input[10:12] = [1234, 0]
            meter.holding[20], meter.holding[30], meter.holding[31] = 320, 77, 78
        press.holding[100:104], press.input[:2] = [9100, 9101, 9102, 9103], [11, 22]
        press.coils[4] = True
        lines = {ports["hall_a"]: SimulatedLine("rtu", *meters), ports["hall_b"]: SimulatedLine("ascii", press)}
        stack.enter_context(SerialDevices(lines))
        hmi = ports.pop("far")
        stack.enter_context(Cable(ports["hmi"], hmi))
        roof = free_port()
        stack.enter_context(Pymodbus(roof))
        text = CONFIG.format(roof=roof, **{name: port.path for name, port in ports.items()})
        gateway = stack.enter_context(GatewayProcess(folder, text))
        plant = Plant(gateway, meters, press, hmi.device)
        plant.becomes(BLOCK, "03 000C 0001", "03 02 00 0F")
        yield plant


def in_hex(values: list[int]) -> str:
    """The answer that carries these registers."""
    return bytes((3, 2 * len(values), *pack(f">{len(values)}H", *values))).hex(" ").upper()


async def test_pymodbus_reads_the_block_and_writes_to_devices_through_it(plant: Plant) -> None:
    async with AsyncModbusTcpClient("127.0.0.1", port=plant.gateway.port, timeout=PATIENCE) as client:
        assert (await client.read_holding_registers(0, count=13, device_id=BLOCK)).registers == VALUES
        assert (await client.read_coils(0, count=4, device_id=BLOCK)).bits[:4] == [False, True, False, False]
        assert (await client.read_holding_registers(12, count=2, device_id=BLOCK)).exception_code == 2

        for turn in range(5):
            assert not (await client.write_registers(3, [turn, 7], device_id=BLOCK)).isError()
            assert plant.press.holding[100:104] == [9100, turn, 7, 9103]
            assert (await client.read_holding_registers(2, count=4, device_id=BLOCK)).registers == [9100, turn, 7, 9103]
        assert not (await client.write_register(11, 200, device_id=BLOCK)).isError()
        assert plant.meters[0].holding[20] == 400
        assert (await client.read_holding_registers(11, count=1, device_id=BLOCK)).registers == [200]
        assert not (await client.write_coil(3, True, device_id=BLOCK)).isError()
        assert plant.press.coils[3:7] == [False, True, False, True]

        heard = len([frame for frame in plant.press.heard if frame.pdu[0] == 16])
        assert (await client.write_register(11, 1001, device_id=BLOCK)).exception_code == 3
        assert (await client.write_registers(6, [1, 2], device_id=BLOCK)).exception_code == 2
        assert (await client.write_registers(5, [1, 2], device_id=BLOCK)).exception_code == 2
        assert plant.meters[0].holding[20] == 400
        assert len([frame for frame in plant.press.heard if frame.pdu[0] == 16]) == heard

        assert not (await client.write_registers(2, VALUES[2:6], device_id=BLOCK)).isError()
        assert not (await client.write_register(11, 160, device_id=BLOCK)).isError()
        assert not (await client.write_coil(3, False, device_id=BLOCK)).isError()


@pytest.mark.needs("mbpoll")
def test_mbpoll_reads_and_writes_the_block(plant: Plant) -> None:
    place = ("-m", "tcp", "-p", str(plant.gateway.port)), "127.0.0.1"
    assert "[0]: \t123.4" in mbpoll(*place, "-t", "4:float", "-B", "-r", "0")
    said = mbpoll(*place, "-t", "4", "-r", "2", "-c", "11")
    assert [int(line.split()[1]) for line in said.splitlines() if line.startswith("[")] == VALUES[2:]
    assert "Written 1 references" in mbpoll(*place, "-t", "4", "-r", "20", values=("815",))
    assert "[20]: \t815" in mbpoll(*place, "-t", "4", "-r", "20")
    assert "Illegal data address" in mbpoll(*place, "-t", "4", "-r", "12", "-c", "3", code=1)


@pytest.mark.needs("mbpoll")
def test_mbpoll_reads_the_block_on_a_server_line(plant: Plant) -> None:
    place = ("-m", "rtu", "-b", "19200", "-P", "none"), plant.hmi
    assert "[0]: \t123.4" in mbpoll(*place, "-t", "4:float", "-B", "-r", "0")
    said = mbpoll(*place, "-t", "4", "-r", "2", "-c", "11")
    assert [int(line.split()[1]) for line in said.splitlines() if line.startswith("[")] == VALUES[2:]


def mbpoll(place: tuple[str, ...], at: str, *options: str, values: tuple[str, ...] = (), code: int = 0) -> str:
    words = ["mbpoll", *place, "-0", "-o", "10", "-a", str(BLOCK), *options, "-1", at, *values]
    done = subprocess.run(words, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout + done.stderr


def test_a_serial_hmi_reads_and_writes_the_block_on_a_server_line(plant: Plant) -> None:
    client = ModbusSerialClient(plant.hmi, baudrate=19200, timeout=20)
    assert client.connect()
    try:
        assert client.read_holding_registers(0, count=13, device_id=BLOCK).registers == VALUES
        assert not client.write_registers(3, [1, 2], device_id=BLOCK).isError()
        assert plant.press.holding[100:104] == [9100, 1, 2, 9103]
        assert not client.write_registers(3, VALUES[3:5], device_id=BLOCK).isError()
        assert client.read_holding_registers(0, count=13, device_id=BLOCK).registers == VALUES
    finally:
        client.close()


def test_a_device_that_dies_is_an_exception_its_last_value_or_a_number_as_the_row_says(plant: Plant) -> None:
    meter = plant.meters[1]
    alive = [*POWER, 77, 78, 0b11, 9100]
    meter.silent = False
    plant.becomes(DYING, "03 0000 0006", in_hex(alive))
    meter.silent = True
    plant.becomes(DYING, "03 0002 0004", in_hex([77, 0x7FC0, 0b10, 9100]))
    plant.becomes(DYING, "03 0000 0002", "83 0B")
    assert plant.ask(DYING, "03 0000 0006") == "83 0B"
    plant.becomes(DYING, "03 0002 0004", in_hex([77, 0x7FC0, 0b10, 9100]))  # those of the other device may be late once
    meter.holding[30] = 79
    meter.silent = False
    plant.becomes(DYING, "03 0000 0006", in_hex([*POWER, 79, 78, 0b11, 9100]))
    meter.holding[30] = 77


def test_the_csv_of_map_says_what_a_client_reads(plant: Plant) -> None:
    """Each value of it is at its place, and each range has what its device has there."""
    done = command("map", "block", "--csv", "--config", str(plant.gateway.config))
    assert done.returncode == 0, done.stderr
    values, ranges = {}, 0
    for row in csv.DictReader(StringIO(done.stdout)):
        found = registers(plant, BLOCK, row["area"], int(row["address"]), int(row["count"]))
        if row["name"]:
            values[row["name"]] = value_of(row, found)
        elif row["device"]:
            area, _, there = row["source"].partition(" ")
            first, _, last = there.partition("-")
            unit = {"press": 51, "inverter": 61, "shift": 200}[row["device"]]
            own = registers(plant, unit, area, int(first), int(last or first) - int(first) + 1)
            assert found == (own[::-1] if row["word order"] == "words" else own), row
            ranges += 1
    fresh = dict.fromkeys(["meter-1.fresh", "press.fresh", "inverter.fresh", "shift.fresh"], 1)
    assert values == {"meter-1.power": pytest.approx(123.4), "meter-1.limit": 160, **fresh}
    assert ranges == 5


def registers(plant: Plant, unit: int, area: str, first: int, count: int) -> list[int]:
    """What a client reads there; of coils, bytes."""
    function = {"coils": 1, "discrete": 2, "holding": 3, "input": 4}[area]
    data = bytes.fromhex(plant.ask(unit, f"{function:02X} {first:04X} {count:04X}"))
    assert data[0] == function
    return [*data[2:]] if function < 3 else [*unpack(f">{count}H", data[2:])]


def value_of(row: dict[str, str], found: list[int]) -> float:
    """Decode the registers of a value as its row says."""
    assert row["word order"] in {"", "none"}
    if row["bits"]:
        return found[0] >> int(row["bits"]) & 1
    number = unpack({"float32": ">f", "uint16": ">H"}[row["type"]], pack(f">{len(found)}H", *found))[0]
    return number * float(row["scale"] or 1)
