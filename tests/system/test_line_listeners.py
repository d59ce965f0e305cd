"""One port for each line, as with one mbusd for each tty: real sockets of every kind, real ports, one process."""

import socket
from pathlib import Path

import pytest

from gateway.modbus import ascii as ascii_framing
from gateway.modbus import mbap, rtu
from kit.device import SimulatedDevice, SimulatedLine
from kit.process import PATIENCE, GatewayProcess
from kit.pty import VirtualPort
from kit.serial_line import SerialDevices

CONFIG = """
[[listen]]
name = "hall port"
bind = "{scheme}://127.0.0.1:0"
line = "hall"
on_failure = "silent"

[[listen]]
name = "yard port"
bind = "{other}://127.0.0.1:0"
line = "yard"

[[line]]
name = "hall"
port = "{folder}/hall"
timeout = "20 s"

[[line]]
name = "yard"
port = "{folder}/yard"
timeout = "20 s"
"""
ENCODE = {
    "tcp": lambda unit, pdu: mbap.encode(7, unit, pdu),
    "udp": lambda unit, pdu: mbap.encode(7, unit, pdu),
    "rtu+tcp": rtu.encode,
    "ascii+tcp": ascii_framing.encode,
}
READ = bytes.fromhex("03 0000 0001")
#: How long nothing must come for a test to believe that nothing will, in seconds.
SILENCE = 0.3


def asks(client: socket.socket, scheme: str, unit: int, *, within: float = PATIENCE) -> bytes | None:
    """The response to a read, None if there is none within so many seconds; whole, or the test fails."""
    client.send(ENCODE[scheme](unit, READ))
    client.settimeout(within)
    try:
        return client.recv(600)
    except TimeoutError:
        return None


def asks_again(client: socket.socket, scheme: str, unit: int) -> bytes | None:
    """The response to a read. A gateway that has stood still answers none of two requests that it reads together."""
    return next((answer for _ in range(3) if (answer := asks(client, scheme, unit, within=PATIENCE / 3))), None)


@pytest.mark.parametrize(
    ("scheme", "other"), [("tcp", "rtu+tcp"), ("rtu+tcp", "udp"), ("ascii+tcp", "tcp"), ("udp", "ascii+tcp")]
)
def test_each_line_is_asked_under_its_own_numbers(tmp_path: Path, scheme: str, other: str) -> None:
    hall, yard = SimulatedDevice(1), SimulatedDevice(1)
    hall.holding[0], yard.holding[0] = 0xAAAA, 0xBBBB
    with (
        VirtualPort(tmp_path / "hall") as hall_port,
        VirtualPort(tmp_path / "yard") as yard_port,
        SerialDevices({hall_port: SimulatedLine("rtu", hall), yard_port: SimulatedLine("rtu", yard)}),
        GatewayProcess(tmp_path, CONFIG.format(scheme=scheme, other=other, folder=tmp_path)) as gateway,
    ):
        for spoken, held, failure in ((scheme, 0xAAAA, None), (other, 0xBBBB, b"\x83\x0a")):
            kind = socket.SOCK_DGRAM if spoken == "udp" else socket.SOCK_STREAM
            with socket.socket(socket.AF_INET, kind) as client:
                client.connect(("127.0.0.1", gateway.ports[spoken]))
                assert asks(client, spoken, 1) == ENCODE[spoken](1, b"\x03\x02" + held.to_bytes(2))
                expected = failure and ENCODE[spoken](250, failure)
                assert asks(client, spoken, 250, within=PATIENCE if failure else SILENCE) == expected
                assert asks_again(client, spoken, 1) == ENCODE[spoken](1, b"\x03\x02" + held.to_bytes(2))
        assert {frame.unit for frame in (*hall.heard, *yard.heard)} == {1}
