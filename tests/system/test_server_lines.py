"""Outside clients on real (virtual) ports: mbpoll over RTU, and a script that knows the Mint document, over ASCII."""

import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from gateway.modbus.ascii import encode
from kit.device import SimulatedDevice, SimulatedLine
from kit.process import PATIENCE, GatewayProcess
from kit.pty import VirtualPort
from kit.serial_line import Cable, SerialDevices

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[line]]
name    = "hall"
port    = "{hall}"
baud    = 9600
devices = [{{ unit = 1, as = 41, name = "silo-1", profile = "weigher", timeout = "20 s" }}]

[[line]]
name   = "plc"
port   = "{plc}"
baud   = 19200
role   = "server"
serves = 41
answer_within = "20 s"

[[line]]
name   = "panel"
port   = "{panel}"
mode   = "ascii"
baud   = 19200
format = "7E1"
role   = "server"
serves = [2, 41]
answer_within = "20 s"

[[image]]
unit    = 2
profile = "mint"
holding = "1-99"
coils   = 16
discrete = 16
initial.holding = [{{ at = 29, values = [258, 772] }}]
"""

LINES = {"hall", "plc", "panel"}
#: How long nothing must come for a client to have got no response, in seconds.
SILENCE = 0.3
#: How often what a busy machine may spoil is tried.
ATTEMPTS = 8


class Running:
    """A gateway with the far ends of its lines: `plc` is the other end of a cable, `panel` is held by the test."""

    def __init__(self, folder: Path, parts: ExitStack) -> None:
        hall, plc, self.plc, self.panel = (
            parts.enter_context(VirtualPort(folder / name)) for name in ("hall", "plc", "plc-far", "panel")
        )
        self.weigher = SimulatedDevice(1, delay=0.005)
        self.weigher.holding[:2] = [0x459C, 0x3D51]
        parts.enter_context(SerialDevices({hall: SimulatedLine("rtu", self.weigher)}))
        parts.enter_context(Cable(plc, self.plc))
        config = CONFIG.format(hall=hall.path, plc=plc.path, panel=self.panel.path)
        self.gateway = parts.enter_context(GatewayProcess(folder, config))
        self._lines_are_up()

    def _lines_are_up(self) -> None:
        """Wait until all ports are open: a driver may be slow, and what came before is discarded."""
        deadline = time.monotonic() + PATIENCE
        while {event["line"] for event in self.gateway.log if event["event"] in {"line_up", "line_reopened"}} != LINES:
            assert time.monotonic() < deadline, self.gateway.log
            time.sleep(0.01)

    def say(self, text: str) -> None:
        """The panel sends this."""
        self.panel.write(text.encode())

    def answer(self) -> str:
        """The gateway's next frame, without its CR LF."""
        text = b""
        while not text.endswith(b"\r\n"):
            byte = self.panel.read(1, timeout=PATIENCE)
            assert byte, f"nothing behind {text!r}"
            text += byte
        return text.decode().removesuffix("\r\n")

    def weigher_is_asked(self) -> None:
        """Wait until a request has come to the weigher."""
        deadline = time.monotonic() + PATIENCE
        while not self.weigher.heard:
            assert time.monotonic() < deadline, f"nothing was asked: {self.gateway.log}"
            time.sleep(0.01)

    def silent(self, seconds: float = SILENCE) -> bool:
        return self.panel.read(1, timeout=seconds) == b""

    def asks(self, pdu: str, unit: int = 2) -> str:
        """Ask, and give the answer's unit and PDU."""
        self.say(encode(unit, bytes.fromhex(pdu)).decode())
        frame = bytes.fromhex(self.answer().removeprefix(":"))
        assert sum(frame) & 0xFF == 0, "LRC"
        return frame[:-1].hex(" ").upper()


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with ExitStack() as parts:
        yield Running(tmp_path_factory.mktemp("server-lines"), parts)


@pytest.mark.needs("mbpoll")
def test_mbpoll_reads_a_weigher_on_another_line(running: Running) -> None:
    words = "mbpoll -m rtu -b 19200 -P none -o 10 -a 41 -t 4:float -B -0 -r 0 -c 1 -1"
    asked = subprocess.run(
        [*words.split(), running.plc.device], capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    assert asked.returncode == 0, asked.stdout + asked.stderr
    assert "4999.66" in asked.stdout


@pytest.mark.needs("mbpoll")
def test_mbpoll_gets_no_answer_for_a_unit_that_is_not_served(running: Running) -> None:
    words = "mbpoll -m rtu -b 19200 -P none -o 0.5 -a 2 -t 4 -0 -r 29 -1"
    asked = subprocess.run(
        [*words.split(), running.plc.device], capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    assert asked.returncode != 0
    assert "timed out" in asked.stdout + asked.stderr


def test_the_panel_reads_the_weigher_too(running: Running) -> None:
    assert running.asks("03 0000 0002", unit=41) == "29 03 04 45 9C 3D 51"


class TestAMintControllerAsTheDocumentDescribesIt:
    """Functions, exceptions, broadcasts and framing of the application note, one by one."""

    def test_comms_locations_are_read_and_written(self, running: Running) -> None:
        assert running.asks("03 001D 0002") == "02 03 04 01 02 03 04"
        assert running.asks("10 0001 0002 04 1234 FFFF") == "02 10 00 01 00 02"
        assert running.asks("03 0001 0002") == "02 03 04 12 34 FF FF"
        assert running.asks("17 0001 0001 0001 0001 02 002A") == "02 17 02 00 2A"

    def test_outputs_and_inputs(self, running: Running) -> None:
        assert running.asks("05 0003 FF00") == "02 05 00 03 FF 00"
        assert running.asks("01 0000 0010") == "02 01 02 08 00"
        assert running.asks("05 0003 0000") == "02 05 00 03 00 00"
        assert running.asks("01 0000 000A") == "02 01 02 00 00"
        assert running.asks("02 0000 0001") == "02 02 01 00"

    def test_register_0_does_not_exist(self, running: Running) -> None:
        assert running.asks("03 0000 0001") == "02 83 02"
        assert running.asks("03 0063 0001") == "02 03 02 00 00"
        assert running.asks("03 0064 0001") == "02 83 02"

    def test_function_04_does_not_exist(self, running: Running) -> None:
        assert running.asks("04 0001 0001") == "02 84 01"

    def test_a_coil_is_on_or_off(self, running: Running) -> None:
        assert running.asks("05 0003 1234") == "02 85 03"
        assert running.asks("01 0003 0001") == "02 01 01 00"

    def test_broadcasts_of_05_and_16_are_acted_on_and_not_answered(self, running: Running) -> None:
        running.say(encode(0, bytes.fromhex("05 0005 FF00")).decode())
        assert running.silent()
        running.say(encode(0, bytes.fromhex("10 0032 0001 02 BEEF")).decode())
        assert running.silent()
        assert running.asks("01 0005 0001") == "02 01 01 01"
        assert running.asks("03 0032 0001") == "02 03 02 BE EF"

    @pytest.mark.parametrize(
        "pdu", ["01 0000 0001", "02 0000 0001", "03 0001 0001", "06 0032 0007", "17 0032 0001 0032 0001 02 0007"]
    )
    def test_other_broadcasts_are_ignored(self, running: Running, pdu: str) -> None:
        before = running.asks("03 0032 0001")
        running.say(encode(0, bytes.fromhex(pdu)).decode())
        assert running.silent()
        assert running.asks("03 0032 0001") == before

    def test_a_colon_starts_anew(self, running: Running) -> None:
        running.say(":0203001D")
        running.say(":0203001D0002DC\r\n")
        assert running.answer() == ":02030401020304ED"

    def test_a_pause_of_more_than_a_second_drops_the_frame(self, running: Running) -> None:
        running.say(":0203001D")
        time.sleep(3.0)  # a busy machine may let the gateway read the first part late
        running.say("0002DC\r\n")
        assert running.silent()

    def test_a_pause_of_less_than_a_second_does_not(self, running: Running) -> None:
        """A busy machine may make a longer one of it, but not each time."""
        for _ in range(ATTEMPTS):
            running.say(":0203001D")
            time.sleep(0.1)
            running.say("0002DC\r\n")
            if not running.silent(5.0):
                break
        assert running.answer() == "02030401020304ED"

    def test_lower_case_digits_are_understood(self, running: Running) -> None:
        running.say(":0203001d0002dc\r\n")
        assert running.answer() == ":02030401020304ED"

    @pytest.mark.parametrize("frame", [":0203001D0002DD\r\n", ":0203001D0002D\r\n", ":0203001G0002DC\r\n", ":02DC\r\n"])
    def test_a_broken_frame_gets_no_answer(self, running: Running, frame: str) -> None:
        running.say(frame)
        assert running.silent()
        assert running.asks("03 001D 0002") == "02 03 04 01 02 03 04"

    def test_other_controllers_on_the_line_are_left_alone(self, running: Running) -> None:
        running.say(encode(3, bytes.fromhex("03 001D 0001")).decode())
        assert running.silent()
        running.say(encode(3, bytes.fromhex("03 02 0007")).decode())
        assert running.asks("03 001D 0002") == "02 03 04 01 02 03 04"


def test_a_request_under_way_is_answered_before_the_end(tmp_path: Path) -> None:
    with ExitStack() as parts:
        running = Running(tmp_path, parts)
        running.weigher.delay = 0.5
        running.say(encode(41, bytes.fromhex("03 0000 0002")).decode())
        running.weigher_is_asked()
        assert running.gateway.stop() == 0
        assert running.answer() == ":290304459C3D5161"


def test_the_order_to_stop_ends_it_at_once(tmp_path: Path) -> None:
    with ExitStack() as parts:
        running = Running(tmp_path, parts)
        assert running.asks("03 001D 0001") == "02 03 02 01 02"
        assert running.gateway.stop() == 0
