"""Clients and servers of others around the gateway: pymodbus and mbpoll ask, pymodbus answers, three lines at once.

And each way to reach the gateway: Modbus TCP, RTU and ASCII over TCP, UDP.
"""

import asyncio
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from pymodbus.client import AsyncModbusTcpClient, AsyncModbusUdpClient
from pymodbus.framer import FramerType
from pymodbus.server import ModbusSerialServer
from pymodbus.simulator import DataType, SimData, SimDevice

from kit.device import SimulatedDevice, SimulatedLine
from kit.process import PATIENCE, GatewayProcess
from kit.pty import VirtualPort
from kit.serial_line import Cable, SerialDevices

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"
[[listen]]
bind = "rtu+tcp://127.0.0.1:0"
name = "rtu"
[[listen]]
bind = "ascii+tcp://127.0.0.1:0"
name = "ascii"
[[listen]]
bind = "udp://127.0.0.1:0"
name = "udp"

[[line]]
name    = "hall-a"
max_wait = "60 s"
port    = "{hall_a}"
baud    = 9600
devices = [{{ unit = 1, as = 41, timeout = "20 s" }}, {{ unit = 6, as = 46, profile = "v80", timeout = "20 s" }}]

[[line]]
name    = "hall-b"
max_wait = "60 s"
port    = "{hall_b}"
baud    = 19200
format  = "8N1"
devices = [{{ unit = 3, as = 43, timeout = "20 s" }}]

[[line]]
name    = "press"
max_wait = "60 s"
port    = "{press}"
mode    = "ascii"
baud    = 19200
devices = [{{ unit = 2, as = 52, profile = "mint", timeout = "20 s" }}]

[[image]]
unit    = 200
holding = 100
coils   = 16
"""


@pytest.fixture
def gateway(tmp_path: Path) -> Iterator[GatewayProcess]:
    """A running gateway; devices of our kit on two lines, those of pymodbus on `hall-b` behind the port `server`."""
    with ExitStack() as stack:
        ports = {name: stack.enter_context(VirtualPort(tmp_path / name)) for name in ("hall_a", "hall_b", "press")}
        server = stack.enter_context(VirtualPort(tmp_path / "server"))
        stack.enter_context(Cable(ports["hall_b"], server))
        on_a, on_press = SimulatedLine("rtu", device(1), device(6)), SimulatedLine("ascii", device(2))
        stack.enter_context(SerialDevices({ports["hall_a"]: on_a, ports["press"]: on_press}))
        config = CONFIG.format(**{name: port.path for name, port in ports.items()})
        yield stack.enter_context(GatewayProcess(tmp_path, config))


def device(unit: int) -> SimulatedDevice:
    simulated = SimulatedDevice(unit, delay=0.005)
    simulated.holding = [unit * 256 + address for address in range(200)]
    return simulated


@pytest.fixture
async def pymodbus_device(gateway: GatewayProcess, tmp_path: Path):
    """pymodbus as the device of unit 3: holding registers 0-99 with the value 768 + address."""
    values = [3 * 256 + address for address in range(100)]
    simulated = SimDevice(3, simdata=[SimData(0, values=values, datatype=DataType.REGISTERS)])
    server = ModbusSerialServer(simulated, framer=FramerType.RTU, port=str(tmp_path / "server"), baudrate=19200)
    await server.serve_forever(background=True)
    yield
    await server.shutdown()


@pytest.mark.usefixtures("pymodbus_device")
async def test_pymodbus_reads_and_writes_three_lines_and_an_image_at_once(gateway: GatewayProcess) -> None:
    async def use(unit: int, value: int) -> None:
        async with AsyncModbusTcpClient("127.0.0.1", port=gateway.port, timeout=PATIENCE) as client:
            for turn in range(10):
                read = await client.read_holding_registers(20 + turn, count=2, device_id=unit)
                right = [value + 20 + turn, value + 21 + turn] if unit != 200 else [0, 0]
                assert read.registers == right, (unit, read, gateway.log)
                written = await client.write_registers(50, [turn, unit], device_id=unit)
                assert not written.isError()
                read = await client.read_holding_registers(50, count=2, device_id=unit)
                assert read.registers == [turn, unit]

    await asyncio.gather(use(41, 256), use(46, 6 * 256), use(43, 3 * 256), use(52, 2 * 256), use(200, 0))


@pytest.mark.needs("mbpoll")
@pytest.mark.usefixtures("pymodbus_device")
async def test_mbpoll_reads_and_writes_three_lines_and_an_image(gateway: GatewayProcess) -> None:
    for unit, register in ((41, 256 + 9), (46, 6 * 256 + 9), (43, 3 * 256 + 9), (52, 2 * 256 + 9), (200, 0)):
        assert f"[10]: \t{register}" in await mbpoll(gateway, unit, "-r", "10", "-c", "2")
        assert "Written 2 references" in await mbpoll(gateway, unit, "-r", "60", values=("7", "8"))
        assert "[61]: \t8" in await mbpoll(gateway, unit, "-r", "60", "-c", "2")


async def mbpoll(gateway: GatewayProcess, unit: int, *options: str, values: tuple[str, ...] = ()) -> str:
    return await polled("127.0.0.1", unit, "-m", "tcp", "-p", str(gateway.port), *options, values=values)


async def polled(place: str, unit: int, *options: str, values: tuple[str, ...] = ()) -> str:
    words = ["mbpoll", "-o", "10", "-a", str(unit), "-t", "4", *options, "-1", place, *values]
    done = await asyncio.to_thread(subprocess.run, words, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


FRAMERS = {"tcp": FramerType.SOCKET, "rtu+tcp": FramerType.RTU, "ascii+tcp": FramerType.ASCII}


@pytest.mark.usefixtures("pymodbus_device")
@pytest.mark.parametrize("scheme", FRAMERS)
async def test_pymodbus_is_served_whatever_it_speaks_on_a_connection(gateway: GatewayProcess, scheme: str) -> None:
    port, framer = gateway.ports[scheme], FRAMERS[scheme]
    async with AsyncModbusTcpClient("127.0.0.1", port=port, framer=framer, timeout=PATIENCE) as client:
        for unit, value in ((41, 256), (46, 6 * 256), (43, 3 * 256), (52, 2 * 256), (200, 0)):
            read = await client.read_holding_registers(20, count=2, device_id=unit)
            assert read.registers == ([value + 20, value + 21] if unit != 200 else [0, 0])
            assert not (await client.write_registers(50, [7, unit], device_id=unit)).isError()
            assert (await client.read_holding_registers(50, count=2, device_id=unit)).registers == [7, unit]
        assert (await client.read_holding_registers(0, device_id=9)).exception_code == 0x0A
        assert (await client.read_holding_registers(200, count=2, device_id=200)).exception_code == 2


@pytest.mark.usefixtures("pymodbus_device")
async def test_pymodbus_reads_by_udp_and_may_not_write(gateway: GatewayProcess) -> None:
    async with AsyncModbusUdpClient("127.0.0.1", port=gateway.ports["udp"], timeout=PATIENCE) as client:
        for unit, value in ((41, 256), (46, 6 * 256), (43, 3 * 256), (52, 2 * 256)):
            read = await client.read_holding_registers(20, count=2, device_id=unit)
            assert read.registers == [value + 20, value + 21]
        assert (await client.write_registers(50, [7], device_id=200)).exception_code == 1


@pytest.mark.needs("mbpoll", "socat")
@pytest.mark.usefixtures("pymodbus_device")
async def test_mbpoll_is_served_through_a_virtual_serial_port(gateway: GatewayProcess, tmp_path: Path) -> None:
    """As plants do with programs that know serial ports only: RTU over TCP, behind a pseudo-terminal."""
    port = tmp_path / "virtual"
    ends = (f"pty,rawer,link={port}", f"tcp:127.0.0.1:{gateway.ports['rtu+tcp']}")
    socat = await asyncio.create_subprocess_exec("socat", *ends)
    try:
        async with asyncio.timeout(PATIENCE):
            while not port.exists():  # noqa: ASYNC110 - socat tells nobody that it is ready
                await asyncio.sleep(0.01)
        serial = ("-m", "rtu", "-b", "9600", "-P", "none")
        for unit, register in ((41, 256 + 9), (46, 6 * 256 + 9), (43, 3 * 256 + 9), (52, 2 * 256 + 9)):
            assert f"[10]: \t{register}" in await polled(str(port), unit, *serial, "-r", "10", "-c", "2")
            assert "Written 2 references" in await polled(str(port), unit, *serial, "-r", "60", values=("7", "8"))
            assert "[61]: \t8" in await polled(str(port), unit, *serial, "-r", "60", "-c", "2")
    finally:
        socat.terminate()
        await socat.wait()
