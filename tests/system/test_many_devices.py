"""More devices than there are units for clients, on real ports: five lines, each with a listener of its own."""

import json
import re
import socket
from contextlib import ExitStack
from pathlib import Path

from gateway.modbus import mbap
from kit.device import SimulatedDevice, SimulatedLine
from kit.process import PATIENCE, GatewayProcess, command
from kit.pty import VirtualPort
from kit.serial_line import SerialDevices

LINES, DEVICES = 5, 240
READ = bytes.fromhex("03 0000 0001")


def config(folder: Path) -> str:
    text = ""
    for line in range(LINES):
        text += f'[[listen]]\nname = "only {line}"\nbind = "tcp://127.0.0.1:0"\nline = "line-{line}"\n'
    for line in range(LINES):
        devices = ", ".join(
            f'{{ unit = {unit}, as = "none", name = "d{line}-{unit}" }}' for unit in range(1, DEVICES + 1)
        )
        text += f'[[line]]\nname = "line-{line}"\nport = "{folder}/{line}"\nbaud = 115200\ndevices = [{devices}]\n'
    return text


def value(line: int, unit: int) -> int:
    return 1000 * line + unit


def test_twelve_hundred_devices_in_one_gateway(tmp_path: Path) -> None:
    with ExitStack() as stack:
        ports = [stack.enter_context(VirtualPort(tmp_path / str(line))) for line in range(LINES)]
        there = {}
        for line, port in enumerate(ports):
            devices = [SimulatedDevice(unit) for unit in range(1, DEVICES + 1)]
            for device in devices:
                device.holding[0] = value(line, device.unit)
            there[port] = SimulatedLine("rtu", *devices)
        stack.enter_context(SerialDevices(there))
        gateway = stack.enter_context(GatewayProcess(tmp_path, config(tmp_path)))
        at = ["--control", str(tmp_path / "control.sock")]
        for line, address in enumerate(gateway.first("ready")["listeners"]):
            with socket.create_connection(("127.0.0.1", int(address.rpartition(":")[2])), PATIENCE) as client:
                for unit in (1, DEVICES):
                    client.sendall(mbap.encode(7, unit, READ))
                    assert client.recv(300) == mbap.encode(7, unit, b"\x03\x02" + value(line, unit).to_bytes(2))
            read = json.loads(command("read", f"d{line}-77", "holding", "0", "--json", *at).stdout)
            assert (read["name"], read["unit"], read["values"][0]["value"]) == (f"d{line}-77", None, value(line, 77))
        status = json.loads(command("status", "--json", *at).stdout)
        assert len(status["units"]) == LINES * DEVICES
        shown = command("status", *at).stdout
        assert re.search(r"^ *- +line-4/77 +d4-77 +fine", shown, re.MULTILINE), shown
        refused = command("read", "77", "holding", "0", *at)
        assert (refused.returncode, "there is no unit 77" in refused.stderr) == (1, True)
