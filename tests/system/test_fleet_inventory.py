"""The inventory of three sites at a real nats-server, as an operator in the control room sees it."""

import csv
import json
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import pytest

from kit.nats import NatsServer
from kit.pki import pki, signed
from kit.process import GatewayProcess, command

pytestmark = pytest.mark.needs("nats-server")

#: A site counts as lost 35 s after its last entry.
PATIENCE = 90.0

SITE = """
site = "{site}"
[[listen]]
name = "scada"
bind = "{bind}"
{more}
[[image]]
unit = 1
holding = 4
[fleet]
servers = ["{server}"]
"""


class ControlRoom:
    """Three sites, and the control room that asks them. The config of plant-3 is another one; its line is down."""

    def __init__(self, folder: Path, server: NatsServer, certificate: str, stack: ExitStack) -> None:
        self._folder, self._server, self._stack = folder, server, stack
        self.sites = {
            "plant-1": self._start("plant-1"),
            "plant-2": self._start("plant-2"),
            "plant-3": self._start("plant-3", f'{certificate}\n[[line]]\nname = "hall"\nport = "/dev/nowhere"\n'),
        }
        asks = "".join(
            f'[[listen]]\nname = "{site}"\nbind = "tcp://127.0.0.1:0"\nsite = "{site}"\n' for site in self.sites
        )
        self.control = self._start("control", f'{asks}[web]\nbind = "http://127.0.0.1:0"\n')

    def _start(self, site: str, more: str = "") -> GatewayProcess:
        folder = self._folder / site
        folder.mkdir()
        bind = "tls://127.0.0.1:0" if "certificate" in more else "tcp://127.0.0.1:0"
        text = SITE.format(site=site, bind=bind, more=more, server=self._server.url)
        return self._stack.enter_context(GatewayProcess(folder, text, level="info"))

    def status(self, *options: str) -> str:
        socket_path = self.control.config.parent / "control.sock"
        done = command("status", "--fleet", *options, "--control", str(socket_path))
        assert done.returncode == 0, done.stderr
        return done.stdout

    def known(self) -> dict[str, dict[str, Any]]:
        return {each["site"]: each for each in json.loads(self.status("--json"))["sites"]}

    def wait_until(self, is_so: Callable[[dict[str, dict[str, Any]]], bool]) -> dict[str, dict[str, Any]]:
        deadline = time.monotonic() + PATIENCE
        while not is_so(known := self.known()):
            assert time.monotonic() < deadline, known
            time.sleep(0.5)
        return known

    def page(self, path: str) -> str:
        address = self.control.first("ready")["page"]
        with urlopen(f"{address}{path}", timeout=PATIENCE) as answer:
            return answer.read().decode()


@pytest.fixture
def room(tmp_path: Path) -> Iterator[ControlRoom]:
    own = signed(tmp_path, "plant-3", days="12")
    key = own.with_suffix(".key")
    key.chmod(0o600)
    certificate = f'certificate = "{own}"\nkey = "{key}"\nclients_ca = "{pki() / "ca.crt"}"'
    with ExitStack() as stack:
        server = stack.enter_context(NatsServer(tmp_path))
        yield ControlRoom(tmp_path, server, certificate, stack)


def test_the_control_room_sees_what_each_site_is_and_has_and_who_is_lost(room: ControlRoom) -> None:
    known = room.wait_until(lambda sites: len(sites) == 4 and all(each["inventory"] for each in sites.values()))
    one, two, three = (known[f"plant-{number}"] for number in (1, 2, 3))
    assert one["inventory"]["config"] == two["inventory"]["config"] != three["inventory"]["config"]
    assert (one["inventory"]["to_fix"], one["inventory"]["certificates"]) == (0, [])
    assert three["inventory"]["to_fix"] > 0
    assert three["lines_down"] == ["hall"]
    assert ("hall", "/dev/nowhere") in [(each["line"], each["port"]) for each in three["inventory"]["adapters"]]
    assert {each["key"] for each in three["inventory"]["certificates"]} == {"certificate", "clients_ca"}

    assert room.sites["plant-1"].stop() == 0
    room.sites["plant-2"].signal(signal.SIGKILL)
    known = room.wait_until(lambda sites: sites["plant-2"]["state"] == "lost")
    assert {name: each["state"] for name, each in known.items()} == {
        "control": "up",
        "plant-1": "left",
        "plant-2": "lost",
        "plant-3": "up",
    }
    rows = {row["site"]: row for row in csv.DictReader(room.status("--csv").splitlines())}
    assert rows["plant-2"]["config"] == rows["plant-1"]["config"] == one["inventory"]["config"]
    assert rows["plant-3"]["worst"].startswith("hall: is down")
    table = room.status().splitlines()
    assert [row.split()[0] for row in table[2:6]] == ["control", "plant-2", "plant-3", "plant-1"]
    assert "1 with a certificate that expires within 30 days" in table[-2]
    assert table[-1].startswith("3 configs: ")

    assert '<a href="/sites?site=plant-3">' in room.page("/sites")
    metrics = room.page("/metrics")
    assert 'modbus_gateway_fleet_sites{state="lost"} 1.0' in metrics
    assert 'modbus_gateway_fleet_site_lines_down{site="plant-3"} 1.0' in metrics
    assert 'site="control"' not in metrics
