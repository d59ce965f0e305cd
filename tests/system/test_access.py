"""Rights in a real process: clients from several addresses, who is let in, who may write, and what is told of it."""

import signal
import socket
import time
from contextlib import suppress
from pathlib import Path

import pytest

from gateway.modbus.mbap import encode
from kit.process import PATIENCE, GatewayProcess

CONFIG = """
[[listen]]
name = "scada"
bind = "tcp://0.0.0.0:0"

[[listen]]
name = "field"
bind = "udp://127.0.0.1:0"

[[image]]
unit    = 200
holding = 10
"""
ROWS = """
[[access]]
from  = ["127.0.0.1"]
allow = ["read", "write"]

[[access]]
from  = ["127.0.0.2"]
listen = ["scada"]
allow = ["read"]
"""
READ, WRITE = bytes.fromhex("03 0000 0001"), bytes.fromhex("06 0000 0007")


def own_address() -> str:
    """An address of this machine that is not loopback; empty when there is none."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # sends nothing
        except OSError:
            return ""
        return probe.getsockname()[0]


def tcp(gateway: GatewayProcess, own: str, *, to: str = "127.0.0.1") -> socket.socket:
    return socket.create_connection((to, gateway.ports["tcp"]), PATIENCE, (own, 0))


def asks(client: socket.socket, pdu: bytes) -> str:
    client.sendall(encode(1, 200, pdu))
    return client.recv(260)[7:].hex()


def test_each_address_has_its_rights(tmp_path: Path) -> None:
    with GatewayProcess(tmp_path, CONFIG + ROWS) as gateway:
        with tcp(gateway, "127.0.0.1") as writer, tcp(gateway, "127.0.0.2") as reader:
            name = "{}:{}".format(*writer.getsockname())
            assert asks(writer, WRITE) == WRITE.hex()
            assert asks(reader, READ) == "03020007"
            assert asks(reader, WRITE) == "8601"
        told = gateway.wait_for("write_audit")
        assert told.pop("elapsed_ms") < PATIENCE * 1000
        for key, value in {
            "client": name, "listener": "scada", "unit": 200, "function": 6, "address": 0, "count": 1, "result": "ok",
        }.items():  # fmt: skip
            assert told[key] == value
        assert gateway.wait_for("access_denied")["client"].startswith("127.0.0.2:")
        assert gateway.wait_for("write_audit")["result"] == "denied"


def test_who_has_no_right_is_closed_before_anything_is_read(tmp_path: Path) -> None:
    with GatewayProcess(tmp_path, CONFIG + ROWS) as gateway:
        with tcp(gateway, "127.0.0.3") as other_client:
            assert other_client.recv(1) == b""
        told = gateway.wait_for("client_rejected")
        assert told["client"].startswith("127.0.0.3:")
        assert told["reason"] == "no [[access]] allows anything to clients from this address"
        with tcp(gateway, "127.0.0.1") as friend:
            assert asks(friend, READ) == "03020000"


def test_datagrams_of_denied_clients_are_dropped_and_those_of_allowed_ones_only_read(tmp_path: Path) -> None:
    with GatewayProcess(tmp_path, CONFIG + ROWS) as gateway, socket.socket(type=socket.SOCK_DGRAM) as client:
        client.settimeout(PATIENCE)
        client.connect(("127.0.0.1", gateway.ports["udp"]))
        with socket.socket(type=socket.SOCK_DGRAM) as other_client:
            other_client.bind(("127.0.0.2", 0))
            other_client.sendto(encode(1, 200, READ), ("127.0.0.1", gateway.ports["udp"]))
            assert gateway.wait_for("client_rejected")["listener"] == "field"
        assert asks(client, READ) == "03020000"
        assert asks(client, WRITE) == "8601"


@pytest.mark.skipif(not own_address(), reason="this machine has no network")
def test_without_rows_clients_from_elsewhere_only_read(tmp_path: Path) -> None:
    with (
        GatewayProcess(tmp_path, CONFIG) as gateway,
        tcp(gateway, own_address(), to=own_address()) as other,
        tcp(gateway, "127.0.0.1") as own,
    ):
        assert asks(other, READ) == "03020000"
        assert asks(other, WRITE) == "8601"
        assert asks(own, WRITE) == WRITE.hex()
        said = [event["help"] for event in gateway.log if event["event"] == "config_warning"]
        assert any('from = ["10.2.0.0/24", "127.0.0.0/8"]' in each for each in said)


def until_all_is_logged(gateway: GatewayProcess) -> None:
    """Wait for all of which there is a line: the end of a gateway does not wait long for that.

    While the log is full a reload is one of those events of which there is none.
    """
    for _ in range(24):
        gateway.signal(signal.SIGHUP)
        with suppress(AssertionError):
            gateway.wait_for("config_applied", patience=5.0)
            return
    raise AssertionError("no reload was told of")


def test_who_may_only_read_does_not_fill_the_journal_with_refused_writes(tmp_path: Path) -> None:
    """Writes to all units, as fast as they are refused: a few lines, which tell of all of them."""
    count, began = 20_000, time.monotonic()
    with GatewayProcess(tmp_path, CONFIG + ROWS) as gateway:
        with tcp(gateway, "127.0.0.2") as reader:
            reader.settimeout(PATIENCE)
            for first in range(0, count, 100):
                reader.sendall(b"".join(encode(number, number % 256, WRITE) for number in range(first, first + 100)))
                left = 100 * 9
                while left:
                    left -= len(reader.recv(left))
        until_all_is_logged(gateway)
        assert gateway.stop() == 0
    told = [event for event in gateway.log if event["event"] == "write_audit"]
    tens = (time.monotonic() - began) / 10  # of seconds: in each of them are a few lines
    assert len(told) <= 10 * (1 + tens)
    dropped = sum(event["write_audits"] for event in gateway.log if event["event"] == "events_dropped")
    assert sum(event.get("suppressed", 1) for event in told) + dropped == count
    assert len(gateway.log) < 400 * (1 + tens)


def test_each_of_many_writes_is_told_or_counted_as_missing(tmp_path: Path) -> None:
    count = 3000
    with GatewayProcess(tmp_path, CONFIG) as gateway:
        with tcp(gateway, "127.0.0.1") as client:
            client.settimeout(PATIENCE)
            client.sendall(b"".join(encode(number, 200, WRITE) for number in range(count)))
            left = count * len(encode(0, 200, WRITE))
            while left:
                left -= len(client.recv(left))
        until_all_is_logged(gateway)
        assert gateway.stop() == 0
    told = [event for event in gateway.log if event["event"] == "write_audit"]
    missing = sum(event["write_audits"] for event in gateway.log if event["event"] == "events_dropped")
    assert len(told) + missing == count
    assert {event["result"] for event in told} == {"ok"}
