"""Every way into a gateway, in real processes: what a row forbids by its address, and what a point's limits forbid.

Neither reaches the device, by whatever way it is asked; each has its answer, and its audit, once.
"""

import itertools
import json
import os
import select
import socket
import ssl
import subprocess
import time
import urllib.request
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from urllib.error import HTTPError

import pytest

from gateway.modbus import rtu
from gateway.modbus.mbap import encode
from kit.mosquitto import Mosquitto, Subscriber
from kit.nats import hub_and_leaf
from kit.pki import OPERATOR, client_context, listener
from kit.process import COMMAND, PATIENCE, GatewayProcess, command
from kit.pty import VirtualPort
from kit.slow_device import SlowDevice

pytestmark = pytest.mark.needs("mosquitto", "mosquitto_sub", "nats-server")

#: What is written: it is allowed, forbidden by its address, and allowed but outside the limits of its point.
OPEN, FORBIDDEN, GUARDED = (4, 7), (12, 7), (5, 500)
#: The points there, by which a broker's clients write. `check` refuses to publish one that may not be written.
POINTS = {4: "open", 5: "speed"}

CONFIG = """
site = "plant-1"

[[listen]]
name = "scada"
bind = "tcp://127.0.0.1:0"

[[listen]]
name = "over"
bind = "rtu+tcp://127.0.0.1:0"

[[listen]]
name = "field"
bind = "udp://127.0.0.1:0"

[[listen]]
name = "alone"
bind = "tcp://127.0.0.1:0"
line = "hall"

{tls}

[[line]]
name    = "hall"
port    = "rtu+tcp://127.0.0.1:{device}"
gap     = "0"
devices = [{{ unit = 1, as = 41, name = "silo", profile = "drive", timeout = "20 s" }}]

[[line]]
name   = "panel"
port   = "{folder}/panel"
role   = "server"
serves = 41
answer_within = "20 s"

[[line]]
name   = "hmi"
port   = "pty:{folder}/hmi"
role   = "server"
serves = 41
answer_within = "20 s"

[profile.drive]
functions = [3, 6]
points = [
  {{ name = "open", holding = 4, write = true }},
  {{ name = "speed", holding = 5, min = 0, max = 100, write = true }},
]

[[image]]
unit = 241
of   = "silo"
read = [{{ holding = "0-19", every = "1 s" }}]

[[image]]
unit = 242
map  = [{{ at = 0, device = "silo", holding = "0-19", every = "1 s", write = true }}]

[[image]]
unit    = 243
python  = "relay:Relay"
timeout = "20 s"

[web]
bind  = "http://127.0.0.1:0"
users = "{folder}/users"
write = true

[mqtt]
broker  = "mqtt://127.0.0.1:{broker}"
publish = [{{ device = "silo", points = ["open", "speed"], every = "1 s" }}]
write   = true

[control]
socket = "{folder}/control.sock"
"""
#: A unit that asks as the program does that a gateway is a part of.
RELAY = """
from gateway import CustomUnit

class Relay(CustomUnit):
    async def write(self, area, address, values):
        await self.unit("silo").write_holding(address, values)
"""
FLEET = """
[fleet]
servers     = ["nats://127.0.0.1:{port}"]
credentials = "{folder}/hub/{site}.creds"
"""
#: Who asks from another site.
CONTROL = """
site = "control"
[[listen]]
bind = "tcp://127.0.0.1:0"
[[upstream]]
name    = "plant-1"
to      = "fleet://plant-1"
timeout = "20 s"
units   = [{ as = 41, unit = 41 }]
"""
WAYS_OF_ROWS = (
    'listen = ["scada", "over", "field", "panel", "hmi", "control", "web", "mqtt", "fleet", "embedded"]',
    'listen = ["alone"]',
    'role = "operator"',
)
#: What its client may do there is up to the rows for the unit itself.
ROW_OF_RELAY = '[[access]]\nlisten = ["scada"]\nunits = [243]\nallow = ["read", "write"]\n'
ROWS = ROW_OF_RELAY + "".join(
    f'[[access]]\n{who}\nholding = "10-19"\nallow = ["read"]\n[[access]]\n{who}\nallow = ["read", "write"]\n'
    for who in WAYS_OF_ROWS
)


def write(address: int, value: int) -> bytes:
    return bytes((6, 0, address)) + value.to_bytes(2)


class Plant:
    """A gateway with all ways in, and who comes by them. Each way returns whether the write was done."""

    def __init__(self, folder: Path, parts: ExitStack) -> None:
        enter = parts.enter_context
        self._folder = folder
        self._hosts = (f"127.0.{number // 250}.{2 + number % 250}" for number in itertools.count())
        self.device = enter(SlowDevice(0.0))
        self._panel = enter(VirtualPort(folder / "panel"))
        self._broker = enter(Mosquitto(folder))
        hub, *_ = enter(hub_and_leaf(folder))
        self._token = _users(folder)
        (folder / "relay.py").write_text(RELAY)
        config = CONFIG.format(folder=folder, device=self.device.port, broker=self._broker.port, tls=listener())
        self.gateway = enter(
            GatewayProcess(folder, config + FLEET.format(folder=folder, port=hub.port, site="plant-1") + ROWS)
        )
        ports = [int(each.rsplit(":", 1)[1]) for each in self.gateway.first("ready")["listeners"]]
        self._tcp, self._over, self._udp, self._alone, self._tls = ports
        self._web = self.gateway.first("web_up")["address"]
        office = folder / "office"
        office.mkdir()
        login = FLEET.format(folder=folder, port=hub.port, site="control")
        self._office = enter(GatewayProcess(office, CONTROL + login))
        self._subscriber = enter(Subscriber(self._broker))
        self._subscriber.wait_for("modbus/plant-1/silo")
        self._wait_for_the_fleet()

    @property
    def writes(self) -> list[bytes]:
        """What the device was told to do."""
        return [each.pdu for each in self.device.heard if each.pdu[0] != 3]

    # --- ways ---

    def tcp(self, address: int, value: int, unit: int = 41) -> bool:
        return self._asks(self._tcp, unit, write(address, value))

    def mirror(self, address: int, value: int) -> bool:
        return self.tcp(address, value, unit=241)

    def virtual_unit(self, address: int, value: int) -> bool:
        return self.tcp(address, value, unit=242)

    def unit_in_python(self, address: int, value: int) -> bool:
        return self.tcp(address, value, unit=243)

    def listener_for_a_line(self, address: int, value: int) -> bool:
        return self._asks(self._alone, 1, write(address, value))

    def another_site(self, address: int, value: int) -> bool:
        return self._asks(self._office.port, 41, write(address, value))

    def tls(self, address: int, value: int) -> bool:
        with (
            self._connection(self._tls) as plain,
            client_context(OPERATOR).wrap_socket(plain, server_hostname="localhost") as client,
        ):
            return _is_done(client, write(address, value))

    def udp(self, address: int, value: int) -> bool:
        with socket.socket(type=socket.SOCK_DGRAM) as client:
            client.bind((next(self._hosts), 0))
            client.connect(("127.0.0.1", self._udp))
            return _is_done(client, write(address, value))

    def rtu_over_tcp(self, address: int, value: int) -> bool:
        request = rtu.encode(41, write(address, value))
        with self._connection(self._over) as client:
            client.sendall(request)
            return _is_copy(client.recv(256), request)

    def serial(self, address: int, value: int) -> bool:
        request = rtu.encode(41, write(address, value))
        self._panel.write(request)
        head = self._panel.read(2)
        return _is_copy(head + self._panel.read(3 if head[1] & 0x80 else 6), request)

    def virtual_port(self, address: int, value: int) -> bool:
        request, answer = rtu.encode(41, write(address, value)), b""
        link = self._folder / "hmi"
        behind = link.readlink()
        port = os.open(link, os.O_RDWR | os.O_NOCTTY)
        try:
            os.write(port, request)
            while len(answer) < (5 if answer[1:2] == b"\x86" else len(request)):
                assert select.select([port], [], [], PATIENCE)[0], answer
                answer += os.read(port, 256)
        finally:
            os.close(port)
        deadline = time.monotonic() + PATIENCE
        while not link.exists() or link.readlink() == behind:  # it is made anew for the next program
            assert time.monotonic() < deadline
            time.sleep(0.01)
        return _is_copy(answer, request)

    def command(self, address: int, value: int) -> bool:
        words = ("write", "41", "holding", str(address), str(value), "--control", f"{self._folder}/control.sock")
        done = command(*words)
        assert done.returncode in (0, 1), done.stderr
        return done.returncode == 0

    def user(self, address: int, value: int) -> bool:
        opener, own = urllib.request.build_opener(urllib.request.HTTPCookieProcessor()), {"Origin": self._web}
        form = f"user=anna&password={PASSWORD}".encode()
        login = urllib.request.Request(f"{self._web}/login", form, {"Accept": "application/json", **own})
        with opener.open(login, timeout=PATIENCE) as response:
            csrf = json.load(response)["csrf"]
        return self._put(opener, address, value, own | {"X-CSRF-Token": csrf})

    def token(self, address: int, value: int) -> bool:
        return self._put(urllib.request.build_opener(), address, value, {"Authorization": f"Bearer {self._token}"})

    def broker(self, address: int, value: int) -> bool:
        topic = f"modbus/plant-1/silo/{POINTS[address]}"
        self._broker.publish(f"{topic}/set", str(value))
        return self._subscriber.wait_for(f"{topic}/result").content["result"] == "ok"

    # --- how ---

    def _connection(self, port: int) -> socket.socket:
        """A connection from an address that no other has: of one, only some refusals are told for themselves."""
        return socket.create_connection(("127.0.0.1", port), PATIENCE, (next(self._hosts), 0))

    def _asks(self, port: int, unit: int, pdu: bytes) -> bool:
        with self._connection(port) as client:
            return _is_done(client, pdu, unit)

    def _put(self, opener: urllib.request.OpenerDirector, address: int, value: int, headers: dict[str, str]) -> bool:
        url, body = f"{self._web}/api/v1/units/41/holding/{address}", json.dumps({"values": [value]}).encode()
        kind = {"Content-Type": "application/json"}
        try:
            with opener.open(urllib.request.Request(url, body, headers | kind, method="PUT"), timeout=PATIENCE):
                return True
        except HTTPError as error:
            status = error.code
        assert status in (403, 422)
        return False

    def _wait_for_the_fleet(self) -> None:
        read, deadline = bytes.fromhex("03 0000 0001"), time.monotonic() + PATIENCE
        while True:
            with self._connection(self._office.port) as client:
                client.sendall(encode(1, 41, read))
                if client.recv(256)[7] == 3:
                    return
            assert time.monotonic() < deadline
            time.sleep(0.1)


PASSWORD = "correct-horse"


def _users(folder: Path) -> str:
    """Add the user `anna`, and a program; the token of the program."""
    own = ("--role", "operator", "--file", str(folder / "users"))
    whole = [*COMMAND, "user", "add", "anna", *own]
    subprocess.run(whole, input=PASSWORD, text=True, check=True, capture_output=True, timeout=PATIENCE)
    return command("user", "program", "--token", *own).stdout.strip()


def _is_done(client: socket.socket | ssl.SSLSocket, pdu: bytes, unit: int = 41) -> bool:
    client.settimeout(PATIENCE)
    client.sendall(encode(1, unit, pdu))
    return _is_copy(client.recv(256)[7:], pdu)


def _is_copy(answer: bytes, request: bytes) -> bool:
    assert answer == request or 0x86 in answer[:2], answer.hex(" ")
    return answer == request


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Plant]:
    with ExitStack() as parts:
        yield Plant(tmp_path_factory.mktemp("every-way"), parts)


Way = Callable[[Plant, int, int], bool]
#: The ways, and who the clients are that come by them.
WAYS: dict[Way, str] = {
    Plant.tcp: "network",
    Plant.rtu_over_tcp: "network",
    Plant.udp: "network",
    Plant.tls: "network",
    Plant.listener_for_a_line: "network",
    Plant.mirror: "network",
    Plant.virtual_unit: "network",
    Plant.unit_in_python: "network",
    Plant.serial: "panel",
    Plant.virtual_port: "hmi",
    Plant.command: "control",
    Plant.user: "web",
    Plant.token: "web",
    Plant.broker: "mqtt",
    Plant.another_site: "control",
}
#: What is asked, and what is told of it.
EXPECTED = ((OPEN, "ok", ""), (GUARDED, "refused", "03"), (FORBIDDEN, "denied", "01"), (OPEN, "ok", ""))
#: By name, the limits of a point are looked at before anything is asked.
BY_NAME = (GUARDED, "refused", "")


@pytest.mark.parametrize("way", WAYS)
def test_what_is_forbidden_does_not_reach_the_device(plant: Plant, way: Way) -> None:
    for asked, result, _ in _asked_by(way):
        written = len(plant.writes)
        assert way(plant, *asked) == (result == "ok")
        assert plant.writes[written:] == ([write(*asked)] if result == "ok" else [])


def test_each_write_was_told_once(plant: Plant) -> None:
    """Of several refusals of one client within some seconds the first one is told, and then their number."""
    assert plant.gateway.stop() == 0
    told = [event for event in plant.gateway.log if event["event"] == "write_audit"]
    assert not [event for event in plant.gateway.log if event["event"] == "events_dropped"]
    done = Counter((event["address"], event["result"], event["code"]) for event in told if "suppressed" not in event)
    assert done.keys() <= {(asked[0], result, code) for asked, result, code in (*EXPECTED, BY_NAME)}
    assert done[4, "ok", ""] == 2 * len(WAYS) + 2
    told_of = Counter(_who(event["client"]) for event in told for _ in range(event.get("suppressed", 1)))
    asked = Counter(who for way, who in WAYS.items() for _ in _asked_by(way))
    assert told_of == asked + Counter(embedded=len(EXPECTED))  # of the unit in Python itself


def _asked_by(way: Way) -> tuple[tuple[tuple[int, int], str, str], ...]:
    """What is asked, and what is told of it; a client of a broker asks by name."""
    return (EXPECTED[0], BY_NAME, EXPECTED[0]) if way is Plant.broker else EXPECTED


def _who(client: str) -> str:
    """A client as the log counts refusals: without what differs from one connection, or user, to the next."""
    return "network" if client.startswith("127.") else client.partition(":")[0]
