"""The conformance cases for TCP, over a real socket against a running gateway with an image as unit 10."""

import json
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from gateway.modbus import mbap
from kit.process import PATIENCE, GatewayProcess
from kit.pty import VirtualPort

VECTORS = Path(__file__).parents[1] / "vectors" / "conformance-tcp.json"
CASES = json.loads(VECTORS.read_text())["cases"]

#: How long nothing must come for a client to have got no response, in seconds.
SILENCE = 0.1

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[line]]
port    = "{port}"
devices = [{{ unit = 1 }}]

[[image]]
unit     = 10
coils    = 2048
discrete = 2048
holding  = 256
input    = 256
initial.holding = [{{ at = 0, values = {holding} }}]
initial.input   = [{{ at = 0, values = {input} }}]
"""


@pytest.fixture(scope="module")
def line(tmp_path_factory: pytest.TempPathFactory) -> Iterator[VirtualPort]:
    with VirtualPort(tmp_path_factory.mktemp("conformance") / "line") as port:
        yield port


@pytest.fixture(scope="module")
def gateway(line: VirtualPort) -> Iterator[GatewayProcess]:
    config = CONFIG.format(port=line.path, holding=list(range(256)), input=list(range(1000, 1256)))
    with GatewayProcess(line.path.parent, config) as running:
        yield running


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case['id']} {case['title']}")
def test_case(gateway: GatewayProcess, line: VirtualPort, case: dict) -> None:
    expected = case["expect"]
    _restore(gateway)
    for pieces in _sendings(case["send"]):
        received, closed = _converse(gateway, pieces, size=_longest(expected))
        match expected["type"]:
            case "exact":
                assert received.hex() == expected["hex"]
            case "oneof":
                assert received.hex() in expected["hex"]
            case "oneof_or_silence":
                assert received.hex() in [*expected["hex"], ""]
            case "tids":
                assert sorted(_transactions(received)) == expected["tids"]
            case "no_reply":
                assert received == b""
            case "close":
                assert (received, closed) == (b"", True)
    assert line.read(1, timeout=0) == b""


def _sendings(lines: list[str]) -> Iterator[list[bytes]]:
    """The ways to send a case: `split:5:HEX` byte by byte, `cuts:HEX` once for each place to cut it, else as it is."""
    if lines[0].startswith("split:"):
        yield [bytes((byte,)) for byte in bytes.fromhex(lines[0].rsplit(":", 1)[1])]
    elif lines[0].startswith("cuts:"):
        data = bytes.fromhex(lines[0].removeprefix("cuts:"))
        yield from ([data[:at], data[at:]] for at in range(1, len(data)))
    else:
        yield [bytes.fromhex(line) for line in lines]


def _converse(gateway: GatewayProcess, pieces: list[bytes], size: int) -> tuple[bytes, bool]:
    """Send the pieces; what came back, and whether the gateway closed the connection."""
    received = b""
    with socket.create_connection(("127.0.0.1", gateway.port), timeout=PATIENCE) as client:
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for piece in pieces:
            client.sendall(piece)
            time.sleep(0.005)
        try:
            while True:
                client.settimeout(SILENCE if len(received) >= size else PATIENCE)
                data = client.recv(4096)
                if not data:
                    return received, True
                received += data
        except TimeoutError:
            return received, False
        except ConnectionResetError:
            return received, True


def _restore(gateway: GatewayProcess) -> None:
    """Put the registers that cases write back to what they begin with."""
    writes = [mbap.encode(address, 10, b"\x06" + address.to_bytes(2) * 2) for address in (4, 0x10, 0x20)]
    with socket.create_connection(("127.0.0.1", gateway.port), timeout=PATIENCE) as client:
        client.sendall(b"".join(writes))
        assert client.recv(36, socket.MSG_WAITALL) == b"".join(writes)


def _longest(expected: dict) -> int:
    """How many bytes to wait for with patience; less than that is waited for in silence."""
    if expected["type"] == "close":
        return 1
    if expected["type"] == "tids":
        return 11 * len(expected["tids"])
    texts = expected.get("hex", "")
    return min(map(len, [texts] if isinstance(texts, str) else texts)) // 2


def _transactions(data: bytes) -> Iterator[int]:
    while data:
        yield int.from_bytes(data[:2])
        data = data[6 + int.from_bytes(data[4:6]) :]
