"""`simulate` as a process, and simulated lines as parts of a program: real virtual ports, clients of others."""

import asyncio
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import cycle, islice
from pathlib import Path
from socket import create_connection

import pytest
from pymodbus import FramerType
from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from serial import Serial

from gateway.cli.main import main
from gateway.config.load import parse
from gateway.errors import PortError
from gateway.modbus.ascii import AsciiFramer
from gateway.modbus.frame import Frame
from gateway.modbus.rtu import RtuFramer, encode
from gateway.simulator.device import Device
from gateway.simulator.faults import Faults
from gateway.simulator.generic import Generic
from gateway.simulator.line import SimulatedLine
from gateway.simulator.panel import Panel
from gateway.simulator.port import VirtualPort
from gateway.simulator.server import SimulatedServer
from gateway.simulator.weigher import Weigher
from kit.process import COMMAND, PATIENCE, started

READ_WEIGHT, WEIGHT = bytes.fromhex("01 03 00 00 00 02 C4 0B"), bytes.fromhex("01 03 04 45 9C 3D 51 FE 7D")
ASK_ADDRESS, ADDRESS_1 = bytes.fromhex("00 03 00 10 00 01 84 1E"), bytes.fromhex("01 03 02 00 01 79 84")
BECOME_5, BECAME_5 = bytes.fromhex("01 10 01 00 00 01 02 00 05 76 93"), bytes.fromhex("05 10 01 00 00 01 01 B1")
BECOME_1, BECAME_1 = bytes.fromhex("05 10 01 00 00 01 02 00 01 45 90"), bytes.fromhex("01 10 01 00 00 01 00 35")
SET_19200, BAUD_SET = (
    bytes.fromhex("01 10 02 00 00 02 04 46 96 00 00 1F AB"),
    bytes.fromhex("01 10 02 00 00 02 40 70"),
)


class Simulation:
    """`modbus-gateway simulate` on a port; in its context it is ready. `said` is what it printed until then."""

    def __init__(self, port: Path | None, *words: str) -> None:
        self._words = ["simulate", *words, *([] if port is None else ["--port", port])]

    def __enter__(self):
        (out, its_out), (err, its_err) = os.pipe(), os.pipe()
        self._out, self._err = os.fdopen(out), os.fdopen(err)
        try:
            self._process = started(self._words, stdout=its_out, stderr=its_err)
        finally:
            os.close(its_out)
            os.close(its_err)
        self.said = "".join(iter(self._out.readline, "]\n"))
        assert self.said, self._err.read()
        return self

    def __exit__(self, *_: object) -> None:
        """End it; its port leads nowhere then, and not to one that another program gets from the system after it."""
        self._process.terminate()  # it takes its port away
        try:
            self._process.wait(PATIENCE)
        finally:
            self._process.kill()
            self._out.close()
            self._err.close()

    @property
    def is_rtu(self) -> bool:
        return ": rtu " in self.said

    def next_line(self) -> str:
        """The next that it prints, which is not empty."""
        while (line := self._out.readline()) == "\n":
            pass
        assert line, self._err.read()
        return line.rstrip("\n")

    def end(self, number: signal.Signals = signal.SIGTERM) -> tuple[int, str, str]:
        """The exit code, and what it still had to say."""
        self._process.send_signal(number)
        return self._process.wait(PATIENCE), self._out.read(), self._err.read()


@contextmanager
def opened(port: Path, baud: int = 9600) -> Iterator[Serial]:
    with Serial(str(port), baud, timeout=PATIENCE) as serial:
        yield serial


def ask(serial: Serial, request: bytes, size: int) -> bytes:
    serial.write(request)
    response = serial.read(size)
    time.sleep(0.02)  # the silence before the next request
    return response


def is_silent(simulation: Simulation, serial: Serial, request: bytes) -> bool:
    """Whether nothing answers, on a line that shows its frames (`-v`): it must have taken this one first."""
    text = request.hex(" ").upper() if simulation.is_rtu else ascii(request.decode())[1:-1]
    serial.write(request)
    while simulation.next_line().split(" ", 1)[1] != f">> {text}":
        pass
    serial.timeout = 0.3
    silent = serial.read(1) == b""
    serial.timeout = PATIENCE
    return silent


@pytest.fixture
def port(tmp_path: Path) -> Path:
    return tmp_path / "hall-a"


@pytest.mark.parametrize(
    ("words", "shown"),
    [
        (("weigher",), "baud = 9600  # as in the manual of a weigher; here any rate will do"),
        (("weigher", "--baud", "19200"), "baud = 19200"),
        (("v80",), "baud = 19200"),
    ],
)
def test_the_rate_of_a_manual_is_named_as_such(port: Path, words: tuple[str, ...], shown: str) -> None:
    with Simulation(port, *words) as simulation:
        assert f"\n{shown}\n" in simulation.said


def test_a_weigher_as_its_document_says(port: Path) -> None:
    words = ("weigher", "--weight", "4999.66", "--baud", "9600", "-v")
    with Simulation(port, *words) as simulation, opened(port) as serial:
        assert ask(serial, READ_WEIGHT, 9) == WEIGHT
        assert ask(serial, ASK_ADDRESS, 7) == ADDRESS_1
        assert ask(serial, BECOME_5, 8) == BECAME_5
        assert is_silent(simulation, serial, READ_WEIGHT)
        assert ask(serial, BECOME_1, 8) == BECAME_1
        assert ask(serial, SET_19200, 8) == BAUD_SET
        assert is_silent(simulation, serial, READ_WEIGHT)
        serial.baudrate = 19200
        assert ask(serial, READ_WEIGHT, 9) == WEIGHT


def test_an_answer_takes_at_least_its_time_on_the_wire(port: Path) -> None:
    """At 1200 baud 125 registers take 2.3 seconds."""
    with Simulation(port, "v80"), opened(port, 1200) as serial:
        request = bytes.fromhex("01 03 00 00 00 7D 85 EB")
        start = time.monotonic()
        assert len(ask(serial, request, 255)) == 255
        assert time.monotonic() - start > (8 + 255) * 11 / 1200


def test_pymodbus_reads_and_writes_two_devices(port: Path) -> None:
    """At 9600 baud: pymodbus keeps no silence between frames, but there it looks for answers seldom enough."""
    with Simulation(port, "generic", "--unit", "1-2"):
        client = ModbusSerialClient(str(port), framer=FramerType.RTU, baudrate=9600, timeout=PATIENCE)
        try:
            assert client.connect()
            for unit in (1, 2):
                assert not client.write_registers(10, [unit, 7], device_id=unit).isError()
                assert client.read_holding_registers(10, count=2, device_id=unit).registers == [unit, 7]
            assert client.read_holding_registers(100, device_id=1).exception_code == 2
        finally:
            client.close()


def test_pymodbus_speaks_ascii_with_a_mint_controller_beside_a_silent_one(port: Path) -> None:
    with Simulation(port, "mint", "--unit", "2-3", "--silent-unit", "3", "-v") as simulation:
        client = ModbusSerialClient(str(port), framer=FramerType.ASCII, baudrate=19200, timeout=PATIENCE)
        try:
            assert client.connect()
            assert not client.write_registers(1, [1234], device_id=2).isError()
            assert client.read_holding_registers(1, device_id=2).registers == [1234]
            with opened(port, 19200) as serial:
                assert is_silent(simulation, serial, b":030300010001F8\r\n")
        finally:
            client.close()
        assert 'mode = "ascii"' in simulation.said


@pytest.fixture
def config(tmp_path: Path) -> Path:
    file = tmp_path / "gateway.toml"
    file.write_text(
        '[[line]]\nport = "/dev/ttyS0"\ndevices = [{ unit = 1, profile = "meter" }]\n[profile.meter]\nfunctions = [3]\n'
        'points = [{ name = "voltage", holding = 0, unit = "V" }, { name = "flow", holding = 1, invalid = 0x8000 }]\n'
    )
    return file


def test_a_profile_of_a_config_with_values_that_are_set(port: Path, config: Path) -> None:
    words = ("meter:1-2", "--config", str(config), "--set", "2:voltage=229", "--set", "flow=invalid")
    with Simulation(port, *words) as simulation, opened(port) as serial:
        assert '{ unit = "1-2", profile = "meter" }' in simulation.said
        first, second = (
            ask(serial, encode(unit, bytes.fromhex("03 0000 0002")), 9).hex(" ").upper() for unit in (1, 2)
        )
        assert second.startswith("02 03 04 00 E5 80 00")
        assert 225 < int(first[9:14].replace(" ", ""), 16) < 237


def test_a_profile_that_check_refuses_is_not_played(config: Path, capsys) -> None:
    file = config.parent / "profiles" / "wrong.toml"
    file.parent.mkdir()
    file.write_text('[profile.wrong]\npoints = [{ name = "a", holding = 1, bit = 40, write = true }]\n')
    assert main(["simulate", "wrong", "--config", str(config), "--port", "/tmp/never-made"]) == 2
    assert f"{file}:2:44: error: profile.wrong.points[0].bit: a uint16 has the bits 0 to 15" in capsys.readouterr().err


def test_points_of_devices_with_documents_can_be_set(port: Path) -> None:
    words = ("weigher", "v80:2", "--set", "weight=12.5", "--set", "coil-173=1", "--set", "register-40108=7")
    with Simulation(port, *words), opened(port) as serial:
        assert ask(serial, READ_WEIGHT, 9)[3:7] == bytes.fromhex("41480000")
        assert ask(serial, encode(2, bytes.fromhex("03 006B 0001")), 7)[3:5] == b"\0\7"
        assert ask(serial, encode(2, bytes.fromhex("01 00AC 0001")), 6)[3:4] == b"\1"


def test_behind_a_modbus_tcp_server(config: Path) -> None:
    words = ("meter:1-2", "--config", str(config), "--tcp", "127.0.0.1:0", "--set", "1:voltage=229", "-v")
    with Simulation(None, *words) as simulation:
        ready, _, table = simulation.said.partition("\n")
        loaded = parse(f"{table}]\n[profile.meter]\n")
        assert loaded.problems == ()
        (upstream,) = loaded.config.upstream
        (address,) = upstream.to
        assert ready == f"meter 1-2 at {address}. Press Ctrl-C to stop."
        with ModbusTcpClient(address.host, port=address.port, timeout=PATIENCE) as client:
            assert client.read_holding_registers(0, count=1, device_id=1).registers == [229]
            assert client.read_holding_registers(0, count=1, device_id=2).registers != [229]
            assert client.read_input_registers(0, count=1, device_id=1).exception_code == 1
        assert simulation.next_line().endswith(" >> 00 01 00 00 00 06 01 03 00 00 00 01")
        assert simulation.next_line().endswith(" << 00 01 00 00 00 05 01 03 02 00 E5")
        with create_connection((address.host, address.port), PATIENCE) as connection:
            connection.sendall(b"no Modbus at all")
            assert connection.recv(1) == b"", "it is closed"
        assert simulation.end()[::2] == (0, "")


def test_a_lone_device_behind_a_server_is_the_server_itself() -> None:
    with Simulation(None, "weigher:5", "--tcp", "127.0.0.1:0", "--weight", "4999.66") as simulation:
        (upstream,) = parse(simulation.said.partition("\n")[2] + "]\n").config.upstream
        with ModbusTcpClient(upstream.to[0].host, port=upstream.to[0].port, timeout=PATIENCE) as client:
            for unit in (5, 255):
                assert client.read_holding_registers(0, count=2, device_id=unit).registers == [0x459C, 0x3D51]


async def test_many_requests_at_once_are_all_answered() -> None:
    async with SimulatedServer("127.0.0.1", 0, [Generic(1), Generic(2)]) as server:
        reader, writer = await asyncio.open_connection(*server.address)
        request = bytes.fromhex("0001 0000 0006 01 03 0000 0001")
        writer.write(200 * request)
        response = bytes.fromhex("0001 0000 0005 01 03 02 0000")
        assert await asyncio.wait_for(reader.readexactly(200 * len(response)), PATIENCE) == 200 * response
        writer.close()


def test_an_address_that_cannot_be_used(capsys) -> None:
    assert main(["simulate", "generic", "--tcp", "192.0.2.1:5502"]) == 1
    assert "192.0.2.1:5502 cannot be used" in capsys.readouterr().err


@pytest.mark.parametrize("words", [["--baud", "9600"], ["--noise", "5%"], ["--fault", "echo"]], ids=" ".join)
def test_what_only_a_line_has_is_refused_of_a_server(words: list[str], capsys) -> None:
    assert main(["simulate", "generic", "--tcp", "127.0.0.1:0", *words]) == 2
    assert "is for a line, and --tcp has none" in capsys.readouterr().err


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP], ids=str)
def test_it_ends_with_status_0_and_takes_its_port_away(port: Path, number: signal.Signals) -> None:
    with Simulation(port, "generic") as simulation:
        assert port.is_symlink()
        code, said, complained = simulation.end(number)
        assert (code, said.strip(), complained) == (0, "", "")
        assert not port.is_symlink()


def test_the_table_that_it_shows_is_good_in_a_config(port: Path) -> None:
    with Simulation(port, "weigher:1-2,9", "v80:6") as simulation:
        ready, _, table = simulation.said.partition("\n")
        assert ready.startswith(f"weigher 1-2, 9, v80 6 at {port}: rtu 8E1, ")
        loaded = parse(table + "]\n")
        assert loaded.problems == ()
        (line,) = loaded.config.line
        assert [unit for device in line.devices for unit in device.units] == [1, 2, 9, 6]


def test_it_shows_the_frames(port: Path) -> None:
    with Simulation(port, "weigher", "--weight", "4999.66", "-v") as simulation, opened(port) as serial:
        ask(serial, READ_WEIGHT, 9)
        _, said, _ = simulation.end()
    assert [line.partition(" ")[2] for line in said.split("\n") if line] == [
        ">> 01 03 00 00 00 02 C4 0B",
        "<< 01 03 04 45 9C 3D 51 FE 7D",
    ]


def test_a_link_left_behind_is_replaced(port: Path) -> None:
    port.symlink_to("/dev/pts/no-such-terminal")
    with Simulation(port, "weigher", "--weight", "4999.66"), opened(port) as serial:
        assert ask(serial, READ_WEIGHT, 9) == WEIGHT


def test_another_file_is_left_alone(port: Path, capsys: pytest.CaptureFixture[str]) -> None:
    port.write_text("precious")
    assert main(["simulate", "generic", "--port", str(port)]) == 1
    assert capsys.readouterr().err.endswith(f"{port} already exists; use a free path\n")
    assert port.read_text() == "precious"


def test_a_real_port_and_a_folder_that_is_missing_are_refused(tmp_path: Path, capsys) -> None:
    assert main(["simulate", "generic", "--port", "/dev/null"]) == 1
    assert "/dev/null is a real port" in capsys.readouterr().err
    assert main(["simulate", "generic", "--port", str(tmp_path / "missing" / "port")]) == 1
    assert "cannot be created: No such file or directory" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["generic:0"], "unit 0 is outside 1-255"),
        (["generic", "--unit", "1,x"], '"x" is not a valid unit'),
        (["generic", "--baud", "fast"], '"fast" is not a valid rate'),
        (["generic", "--noise", "105%"], '"105%" is not a valid percentage'),
        (["generic", "--noise", "much"], '"much" is not a valid percentage'),
        (["generic", "--slow", "200"], 'write "200 ms" or "200 s"'),
        (["generic", "--format", "9X9"], '"9X9" is not a valid character format'),
        (["generic", "--set", "weight"], '"weight" sets nothing; write POINT=VALUE or UNIT:POINT=VALUE'),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_word_that_cannot_be_used(words: list[str], complaint: str, capsys) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["simulate", *words, "--port", "/tmp/never-made"])
    assert ended.value.code == 2
    assert complaint in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["nonsense"], 'there is no profile "nonsense"'),
        (["weihger"], 'did you mean "weigher"?'),
        (["weigher:1-3", "v80:3"], "two devices have the address 3\n  help: --fault duplicate-address"),
        (["mint", "--mode", "rtu"], "a mint does not speak rtu"),
        (["weigher", "--mode", "ascii"], "a weigher does not speak ascii"),
        (["weigher", "--baud", "4800"], "cannot be set to 4800 baud"),
        (["generic", "--silent-unit", "7"], "there is no unit 7 on this line; it has 1"),
        (["weigher", "--set", "7:weight=1"], "there is no unit 7 on this line; it has 1"),
        (["weigher", "--set", "wieght=1"], 'no device has a point "wieght"\n  help: did you mean "weight"?'),
        (["weigher", "--set", "weight=much"], '"much" is no weight'),
        (["weigher", "--set", "baud=9600"], "baud of a weigher cannot be set"),
        (["v80", "--set", "coil-20=2"], "2 is not a bit"),
        (["weigher", "--config", "/nonexistent.toml"], "there is no such file"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_devices_that_cannot_be_on_one_line(words: list[str], complaint: str, capsys) -> None:
    assert main(["simulate", *words, "--port", "/tmp/never-made"]) == 2
    assert complaint in capsys.readouterr().err


def test_a_reader_that_has_gone_ends_it(port: Path) -> None:
    words = [*COMMAND, "simulate", "generic", "-v", "--port", str(port)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        "".join(iter(process.stdout.readline, "]\n"))
        assert process.stdout.readline() == "\n"  # the last one before the first request
        process.stdout.close()
        with opened(port) as serial:
            serial.write(READ_WEIGHT)
            assert process.wait(PATIENCE) in {0, 1}
        assert process.stderr.read() == ""
    assert not port.is_symlink()


async def exchange(port: Path, request: bytes, size: int, baud: int = 115200) -> bytes:
    def talk() -> bytes:
        with opened(port, baud) as serial:
            return ask(serial, request, size)

    return await asyncio.to_thread(talk)


async def test_a_line_as_a_part_of_a_program(port: Path) -> None:
    heard: list[tuple[str, bytes]] = []
    weigher = Weigher(1)
    async with SimulatedLine(port, [weigher, Generic(2)], tell=lambda sender, data: heard.append((sender, data))):
        assert await exchange(port, READ_WEIGHT, 9) == WEIGHT
        weigher.faults = Faults(slow=0.3)
        start = time.monotonic()
        assert await exchange(port, READ_WEIGHT, 9) == WEIGHT
        assert time.monotonic() - start > 0.3
    assert heard == 2 * [("port", READ_WEIGHT), ("device", WEIGHT)]


def test_a_link_is_not_taken_away_when_something_else_has_replaced_it(port: Path) -> None:
    virtual = VirtualPort(port)
    port.unlink()
    port.write_text("precious")
    virtual.close()
    assert port.read_text() == "precious"


def test_the_link_of_a_killed_simulator_is_replaced_though_somebody_else_has_its_terminal_now(port: Path) -> None:
    far_end, near_end = os.openpty()
    try:
        port.symlink_to(os.ttyname(near_end))
        an_hour_ago = time.time() - 3600
        os.utime(port, (an_hour_ago, an_hour_ago), follow_symlinks=False)
        virtual = VirtualPort(port)
        assert str(port.readlink()) not in (os.ttyname(near_end), "")
        virtual.close()
    finally:
        os.close(far_end)
        os.close(near_end)
    assert not port.is_symlink()


async def test_two_lines_cannot_have_one_port(port: Path) -> None:
    async with SimulatedLine(port, [Generic(1)]):
        with pytest.raises(PortError, match="already exists; use a free path, or remove this link"):
            await SimulatedLine(port, [Generic(1)]).__aenter__()


async def test_what_nobody_reads_does_not_stop_a_line(port: Path) -> None:
    """A pseudo-terminal takes some kilobytes; opening it discards them."""
    async with SimulatedLine(port, [Weigher(1)]) as line:
        for _ in range(100):
            line._port.write(bytes(4096))
        assert await exchange(port, READ_WEIGHT, 9) == WEIGHT


@pytest.mark.parametrize("mode", ["rtu", "ascii"])
async def test_a_panel_asks_in_turn_and_collects_the_answers(port: Path, mode) -> None:
    """A busy machine may make some of them late."""
    requests = [Frame(1, bytes.fromhex("10 0001 0001 02 1234")), Frame(1, bytes.fromhex("03 0001 0001"))]
    asked, answers = [], []
    async with Panel(port, mode=mode) as panel:
        with served(port, Generic(1), RtuFramer(silence=1.0) if mode == "rtu" else AsciiFramer()):
            async with asyncio.timeout(PATIENCE):
                while await panel.ask(requests[0]) is None:  # what stands in the register must have been written
                    pass
            async for request, answer in panel.poll(requests):
                asked.append(request)
                answers += [] if answer is None else [answer.pdu.hex()]
                if min(answers.count("1000010001"), answers.count("03021234")) >= 2:
                    break
            assert await panel.ask(Frame(9, bytes.fromhex("03 0001 0001")), patience=0.1) is None
    assert asked == list(islice(cycle(requests), len(asked)))
    assert set(answers) == {"1000010001", "03021234"}


async def test_a_panel_takes_the_time_of_its_requests_on_the_wire(port: Path) -> None:
    async with Panel(port) as panel:
        with served(port, Generic(1), RtuFramer(silence=1.0), baud=1200):
            start = time.monotonic()
            assert await panel.ask(Frame(1, bytes.fromhex("10 0000 0014 28") + bytes(40)), patience=PATIENCE)
            assert time.monotonic() - start > 49 * 11 / 1200


@contextmanager
def served(port: Path, device: Device, framer: RtuFramer | AsciiFramer, baud: int = 9600) -> Iterator[None]:
    """A server on a port, in this event loop, that forgives holes in a frame as the gateway does."""

    def answer() -> None:
        for frame in framer.received(serial.read(serial.in_waiting), time.monotonic()):
            heard = device.receive(frame, time.monotonic(), baud)
            if heard is not None:
                serial.write(framer.encode(*heard.frame))

    loop = asyncio.get_running_loop()
    with opened(port, baud) as serial:
        loop.add_reader(serial, answer)
        yield
        loop.remove_reader(serial)
