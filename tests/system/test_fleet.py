"""Three gateways as one, with the configs of `fleet hub`: two at the hub, one behind a leaf node."""

import json
import signal
import socket
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple, Self

import pytest

from gateway.modbus.mbap import encode
from kit.nats import hub_and_leaf
from kit.process import PATIENCE, GatewayProcess, command
from kit.slow_device import SlowDevice

pytestmark = pytest.mark.needs("nats-server")

READ = bytes.fromhex("03 00 00 00 01")


class Answer(NamedTuple):
    """The response to a request, and when it had come, by time.monotonic."""

    pdu: str
    at: float


def ask(gateway: GatewayProcess, unit: int, pdu: bytes) -> Answer:
    """One request over a connection of its own."""
    with socket.create_connection(("127.0.0.1", gateway.port), timeout=PATIENCE) as client:
        client.sendall(encode(1, unit, pdu))
        data = client.recv(260)
    return Answer(data[7:].hex(" ").upper(), time.monotonic())


def ask_until(gateway: GatewayProcess, unit: int, pdu: bytes, *wanted: str) -> str:
    """Ask until the answer is one of those `wanted`."""
    deadline = time.monotonic() + PATIENCE
    while (answer := ask(gateway, unit, pdu).pdu) not in wanted:
        assert time.monotonic() < deadline, answer
        time.sleep(0.1)
    return answer


def write(address: int) -> bytes:
    return bytes((6, address >> 8, address & 0xFF, 0, 9))


def writes_of_which_one_is_heard(fleet: "Fleet", pool: ThreadPoolExecutor, count: int) -> list[Future[Answer]]:
    """Ask for writes at the addresses from 0 on, `count` at once, until the device has heard one of these.

    On a machine that stands still all may be too old when their owner reads them; then the next ones are asked for.
    """
    asked: list[Future[Answer]] = []
    deadline = time.monotonic() + PATIENCE
    while True:
        addresses = range(len(asked), len(asked) + count)
        asked += [pool.submit(ask, fleet.control, 41, write(address)) for address in addresses]
        while not (is_heard := any(map(fleet.device.writes, addresses))) and not all(each.done() for each in asked):
            time.sleep(0.01)
        if is_heard:
            return asked
        assert {asked[address].result().pdu for address in addresses} == {"86 0B"}
        assert time.monotonic() < deadline


def config(site: str, port: int, credentials: Path, more: str) -> str:
    return f"""
site = "{site}"
[[listen]]
bind = "tcp://127.0.0.1:0"
[fleet]
servers = ["nats://127.0.0.1:{port}"]
credentials = "{credentials}"
[[access]]
from = ["127.0.0.0/8"]
allow = ["read", "write"]
{more}
"""


def upstream(site: str, units: str, timeout: str = "1 s") -> str:
    return f"""
[[upstream]]
name = "{site}"
to = "fleet://{site}"
timeout = "{timeout}"
units = [{{ as = "{units}", unit = "{units}" }}]
"""


def line(device: SlowDevice, timeout: str) -> str:
    return f"""
[[line]]
name = "hall"
port = "rtu+tcp://127.0.0.1:{device.port}"
gap = "0"
timeout = "{timeout}"
devices = [{{ unit = 1, as = 41 }}, {{ unit = 2, as = 42 }}]
[[access]]
listen = ["fleet"]
from = ["control"]
allow = ["read", "write"]
"""


IMAGE = """
[[image]]
unit = {}
holding = 10
initial.holding = [{{ at = 0, values = [{}] }}]
"""


class Fleet:
    """The servers and the gateways: control asks; plant-1 has a slow device, plant-3 an image, behind a leaf node."""

    def __init__(self, folder: Path, timeout: str) -> None:
        self._folder = folder
        self._timeout = timeout
        self._stack = ExitStack()
        self.device = SlowDevice()
        self.gateways: dict[str, GatewayProcess] = {}

    def __enter__(self) -> Self:
        enter = self._stack.enter_context
        enter(self.device)
        self.hub, self.wan, self.leaf = enter(hub_and_leaf(self._folder))
        asks = upstream("plant-1", "41-43", self._timeout) + upstream("plant-3", "31", self._timeout)
        self.start("control", self.hub.port, asks)
        self.start("plant-1", self.hub.port, line(self.device, self._timeout))
        asks = upstream("control", "201", self._timeout) + IMAGE.format(31, 33)
        self.start("plant-3", self.leaf.port, asks)
        ask_until(self.control, 41, READ, "03 02 00 00")
        ask_until(self.control, 31, READ, "03 02 00 21")
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def credentials(self, site: str) -> Path:
        """The login of a site."""
        return self._folder / "hub" / f"{site}.creds"

    def start(self, site: str, port: int, more: str) -> GatewayProcess:
        folder = self._folder / f"{site}-{len(self.gateways)}"
        folder.mkdir()
        more += IMAGE.format(201, 11) if site == "control" else ""
        gateway = self._stack.enter_context(GatewayProcess(folder, config(site, port, self.credentials(site), more)))
        self.gateways[site] = gateway
        return gateway

    @property
    def control(self) -> GatewayProcess:
        return self.gateways["control"]

    def status(self) -> dict[str, dict[str, object]]:
        """What `status --fleet` says, by site."""
        socket_path = self.control.config.parent / "control.sock"
        done = command("status", "--fleet", "--json", "--control", str(socket_path))
        assert done.returncode == 0, done.stderr
        return {each["site"]: each for each in json.loads(done.stdout)["sites"]}


@pytest.fixture
def fleet(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Fleet]:
    with Fleet(tmp_path, getattr(request, "param", "5 s")) as made:
        yield made


#: For tests of what comes after the time limit.
with_a_short_limit = pytest.mark.parametrize("fleet", ["1 s"], indirect=True)


def test_any_unit_from_anywhere_with_the_rights_of_the_sender(fleet: Fleet) -> None:
    plant_3 = fleet.gateways["plant-3"]
    assert ask_until(plant_3, 201, READ, "03 02 00 0B")
    assert ask(fleet.control, 41, write(5)).pdu == write(5).hex(" ").upper()
    assert ask(fleet.control, 31, write(5)).pdu == "86 01"
    assert ask(fleet.control, 43, READ).pdu == "83 0A"
    audit = fleet.gateways["plant-1"].wait_for("write_audit")
    assert (audit["client"], audit["listener"], audit["result"]) == ("control:1", "fleet", "ok")
    assert audit["subject"].startswith("127.0.0.1:")


def test_all_sites_are_shown_also_one_that_has_left(fleet: Fleet) -> None:
    deadline = time.monotonic() + PATIENCE
    while {name: each["state"] for name, each in fleet.status().items()} != dict.fromkeys(fleet.gateways, "up"):
        assert time.monotonic() < deadline
        time.sleep(0.2)
    assert fleet.gateways["plant-1"].stop() == 0
    while (left := fleet.status()["plant-1"])["state"] != "left":
        assert time.monotonic() < deadline
        time.sleep(0.2)
    assert 0 <= left["for_s"] < PATIENCE
    assert ask_until(fleet.control, 41, READ, "83 0A")


@with_a_short_limit
def test_an_owner_that_is_killed_leaves_no_wrong_answer_and_no_late_write(fleet: Fleet) -> None:
    fleet.device.delay = 0.4
    with ThreadPoolExecutor() as pool:
        asked = writes_of_which_one_is_heard(fleet, pool, 4)
        fleet.gateways["plant-1"].signal(signal.SIGKILL)
        answers = [each.result() for each in asked]
    done = {write(address).hex(" ").upper() for address in range(len(answers))}
    assert {each.pdu for each in answers} <= {"86 0B", "86 0A"} | done
    assert {each.pdu for each in answers[-4:]} & {"86 0A", "86 0B"}
    for address, answer in enumerate(answers):
        assert all(at < answer.at for at in fleet.device.writes(address))
    assert ask_until(fleet.control, 41, READ, "83 0A")


@with_a_short_limit
def test_an_owner_that_stood_still_sends_nothing_that_was_answered(fleet: Fleet) -> None:
    """A write waits behind a slow one while its gateway is stopped; when that goes on, the client has its answer."""
    fleet.device.delay = 0.9
    plant_1 = fleet.gateways["plant-1"]
    with ThreadPoolExecutor() as pool:
        asked = writes_of_which_one_is_heard(fleet, pool, 3)
        plant_1.signal(signal.SIGSTOP)
        answers = [each.result() for each in asked]
    plant_1.signal(signal.SIGCONT)
    fleet.device.delay = 0.02
    ask_until(fleet.control, 42, READ, "03 02 00 00")
    assert "86 0B" in {each.pdu for each in answers[-3:]}
    for address, answer in enumerate(answers):
        assert all(at < answer.at for at in fleet.device.writes(address))


def test_a_site_goes_on_alone_when_the_way_to_the_hub_is_away(fleet: Fleet) -> None:
    plant_3 = fleet.gateways["plant-3"]
    fleet.wan.cut()
    assert ask_until(fleet.control, 31, READ, "83 0A")
    assert ask(plant_3, 31, READ).pdu == "03 02 00 21"
    assert ask_until(plant_3, 201, READ, "83 0A")
    fleet.wan.mend()
    assert ask_until(fleet.control, 31, READ, "03 02 00 21")
    assert ask_until(plant_3, 201, READ, "03 02 00 0B")


def test_a_gateway_starts_and_serves_without_nats_and_finds_it_later(fleet: Fleet) -> None:
    fleet.hub.kill()
    assert ask_until(fleet.control, 41, READ, "83 0A", "83 0B")
    more = IMAGE.format(7, 77) + upstream("plant-1", "41")
    late = fleet.start("control", fleet.hub.port, more)
    assert ask(late, 7, READ).pdu == "03 02 00 4D"
    assert ask(late, 41, READ).pdu == "83 0A"
    fleet.hub.start()
    assert ask_until(late, 41, READ, "03 02 00 00")


def test_a_site_that_claims_the_name_of_another_gets_nothing(fleet: Fleet) -> None:
    """It logs in as plant-3 does, at the hub, and calls itself control; and then plant-1."""
    heard = len(fleet.device.heard)
    for claimed in ("control", "plant-1"):
        folder = fleet.control.config.parent.parent / f"liar-{claimed}"
        folder.mkdir()
        real = "plant-1" if claimed == "control" else "control"
        text = config(claimed, fleet.hub.port, fleet.credentials(real), "")
        other = "plant-1" if claimed == "control" else "plant-3"
        text += upstream(other, "42" if claimed == "control" else "31") + IMAGE.format(41, 66)
        with GatewayProcess(folder, text) as liar:
            liar.wait_for("fleet_refused")
            assert ask(liar, 42 if claimed == "control" else 31, write(66)).pdu in ("86 0A", "86 0B")
            assert ask(fleet.control, 41, READ).pdu == "03 02 00 00"
    assert not fleet.device.writes(66)
    assert len(fleet.device.heard) == heard + 2


def test_a_gateway_stops_in_time_while_nats_says_nothing(fleet: Fleet) -> None:
    fleet.hub.halt()
    began = time.monotonic()
    assert fleet.control.stop() == 0
    assert time.monotonic() - began < PATIENCE / 2
    fleet.hub.resume()
