"""Units behind other Modbus TCP servers, with real sockets and processes: another gateway, pymodbus, a slow server."""

import json
import random
import threading
import time
from contextlib import closing
from pathlib import Path

from gateway.config.importing.from_modbus_proxy import config_from_modbus_proxy
from kit.device import SimulatedDevice, SimulatedLine
from kit.free_port import free_port
from kit.peers import Pymodbus
from kit.process import PATIENCE, GatewayProcess
from kit.pty import VirtualPort
from kit.reader import Reader
from kit.serial_line import SerialDevices
from kit.tcp_server import Manners, TcpServer

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[upstream]]
name    = "plant-1"
to      = "tcp://127.0.0.1:{number}"
units   = [{{ as = "37-40", unit = "1-4" }}]
timeout = "{timeout}"
in_flight = {in_flight}
"""


def config(number: int, timeout: str = "1 s", in_flight: int = 16) -> str:
    return CONFIG.format(number=number, timeout=timeout, in_flight=in_flight)


def until_answered(client: Reader, unit: int, address: int, value: str) -> None:
    deadline = time.monotonic() + PATIENCE
    while (answer := client.read(unit, address)) != value:
        assert time.monotonic() < deadline, answer
        time.sleep(0.05)


def test_a_gateway_behind_a_gateway(tmp_path: Path) -> None:
    device = SimulatedDevice(1)
    device.holding[5] = 7
    one, other = tmp_path / "one", tmp_path / "other"
    one.mkdir()
    other.mkdir()
    line = f'[[listen]]\nbind = "tcp://127.0.0.1:0"\n[[line]]\nport = "{tmp_path / "line"}"\ntimeout = "3 s"\n'
    with (
        VirtualPort(tmp_path / "line") as port,
        SerialDevices({port: SimulatedLine("rtu", device)}),
        GatewayProcess(one, line) as behind,
        GatewayProcess(other, config(behind.port, "20 s")) as gateway,
        closing(Reader(gateway.port)) as client,
    ):
        gateway.first("line_up")
        assert client.read(37, 5) == "03 02 00 07"
        assert client.ask(37, "06 0006 0102") == "06 00 06 01 02"
        assert device.holding[6] == 0x0102
        assert client.read(37, 500) == "83 02"
        assert client.read(38, 5) == "83 0B"
        assert client.read(99, 5) == "83 0A"
        assert behind.stop() == 0
        until_answered(client, 37, 5, "83 0A")
        gateway.wait_for("line_lost")
        assert gateway.stop() == 0
    assert gateway.rest == behind.rest == []


def test_several_devices_of_modbus_proxy_keep_their_ports_and_unit_identifiers(tmp_path: Path) -> None:
    """As `import` prints it: clients change nothing."""
    with TcpServer() as one, TcpServer() as other:
        devices = [
            {"modbus": {"url": f"127.0.0.1:{server.number}"}, "listen": {"bind": f"127.0.0.1:{free_port()}"}}
            for server in (one, other)
        ]
        config = config_from_modbus_proxy("p.json", json.dumps({"devices": devices})).text
        with GatewayProcess(tmp_path, config) as gateway:
            for device, server in zip(devices, (one, other), strict=True):
                number = int(device["listen"]["bind"].rpartition(":")[2])
                with closing(Reader(number)) as client:
                    for unit in (0, 1, 247, 248, 255):
                        until_answered(client, unit, 5, f"03 02 {unit:02X} 05")
                assert {unit for unit, _ in server.heard} == {0, 1, 247, 248, 255}
            assert gateway.stop() == 0
    assert gateway.rest == []


def test_pymodbus_killed_and_started_again_under_traffic(tmp_path: Path) -> None:
    number, stop = free_port(), threading.Event()
    wrong: list[str] = []
    counts = {"good": 0, "83 0A": 0, "83 0B": 0, "83 06": 0}

    def poll(client: Reader, unit: int, chance: random.Random) -> None:
        while not stop.is_set():
            address = chance.randrange(200)
            answer = client.read(unit, address)
            if answer == f"03 02 {unit - 36:02X} {address:02X}":
                counts["good"] += 1
            elif answer in counts:
                counts[answer] += 1
                time.sleep(0.01)
            else:
                wrong.append(answer)

    with GatewayProcess(tmp_path, config(number, in_flight=1)) as gateway:
        clients = [Reader(gateway.port) for _ in range(8)]
        threads = [
            threading.Thread(target=poll, args=(client, 37 + index % 4, random.Random(index)), name=f"client {index}")
            for index, client in enumerate(clients)
        ]
        for thread in threads:
            thread.start()
        try:
            for cycle in range(3):
                with Pymodbus(number):
                    gateway.wait_for("line_reopened" if cycle else "line_up")
                    good, deadline = counts["good"], time.monotonic() + PATIENCE
                    while counts["good"] < good + 100:
                        assert time.monotonic() < deadline, counts
                        time.sleep(0.01)
                gateway.wait_for("line_lost")
        finally:
            stop.set()
            for thread in threads:
                thread.join(PATIENCE)
            for client in clients:
                client.close()
        assert gateway.stop() == 0
    assert wrong == []
    assert counts["83 0A"] > 0
    assert gateway.rest == []
    assert not [event for event in gateway.log if event["event"] in {"part_failed", "foreign_frame"}]


def test_late_answers_reach_nobody(tmp_path: Path) -> None:
    """A third of the answers comes too late; each client only ever gets its own."""
    with (
        TcpServer(Manners(slowness=0.9)) as server,
        GatewayProcess(tmp_path, config(server.number, "600 ms")) as gateway,
    ):
        outcomes: list[tuple[int, int, str]] = []

        def poll(unit: int, seed: int) -> None:
            chance = random.Random(seed)
            with closing(Reader(gateway.port)) as client:
                for _ in range(15):
                    address = chance.randrange(256)
                    outcomes.append((unit, address, client.read(unit, address)))

        threads = [threading.Thread(target=poll, args=(37 + seed % 4, seed)) for seed in range(12)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(PATIENCE)
        gateway.wait_for("late_response")
        assert gateway.stop() == 0
    assert len(outcomes) == 12 * 15
    good = [outcome for outcome in outcomes if outcome[2] not in {"83 0B", "83 06"}]  # 06: it waited for too long
    assert len(good) > 20
    assert [outcome for outcome in good if outcome[2] != f"03 02 {outcome[0] - 36:02X} {outcome[1]:02X}"] == []
    assert gateway.rest == []
