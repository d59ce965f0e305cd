"""The table of docs/security.md, who may do what by default, against what the entrances do."""

import asyncio
from collections.abc import Iterator
from dataclasses import replace
from ipaddress import ip_network
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from gateway.operator.operations.answers.running import Reloaded
from gateway.operator.operations.operation import Asker as OperatorAsker
from gateway.operator.operations.operation import Nothing
from gateway.operator.operations.table import BY_NAME
from gateway.readconfig.page_users import new_token, token_hash
from gateway.request import Caller, Request
from gateway.routing.router import Router
from gateway.runtime.running import Running
from kit.asker import Asker
from kit.browser import USERS, WebBench, web_bench

PAGE = Path(__file__).parents[2] / "docs" / "security.md"
HERE, AFAR, PROXY = "127.0.0.1", "10.2.0.7", "10.0.0.2"
CONFIG = """
[[listen]]
name = "tcp"
bind = "tcp://0.0.0.0:5020"

[[listen]]
name = "broadcasting"
bind = "tcp://0.0.0.0:5024"
unit0 = "broadcast"

[[listen]]
name = "rtu"
bind = "rtu+tcp://0.0.0.0:5021"

[[listen]]
name = "udp"
bind = "udp://0.0.0.0:5022"

[[listen]]
name = "tls"
bind = "tls://0.0.0.0:5023"
certificate = "server.crt"
key = "server.key"
clients_ca = "clients.crt"

[[line]]
name = "panel"
port = "/dev/panel"
role = "server"
serves = [200]

[[line]]
name = "old-hmi"
port = "pty:ttyHMI"
role = "server"
serves = [200]

[[image]]
unit = 200
name = "shift"
holding = 10

[[image]]
unit = 201
holding = 10
"""
MQTT = """
[[line]]
name = "hall"
port = "/dev/hall"
devices = [{ unit = 1, as = 41, name = "silo-1", points = [{ name = "weight", holding = 0, write = true }] }]

[mqtt]
broker = "mqtt://127.0.0.1"
publish = [{ device = "silo-1", points = ["weight"], every = "1 s" }]
"""
MONITOR = """
[[line]]
name = "bus"
port = "/dev/bus"
role = "monitor"
devices = [{ unit = 3, as = 63, name = "boiler" }]
"""
MES, WALL = new_token(), new_token()
READ, WRITE = "03 00 03 00 01", "06 00 03 00 05"
#: What says in a cell that somebody may do nothing.
NOTHING = "\N{EN DASH}"


class Row(NamedTuple):
    who: str
    read: str
    write: str
    broadcast: str
    operate: str


class May(NamedTuple):
    read: bool
    write: bool
    broadcast: bool = False
    operate: bool = False


def rows() -> Iterator[Row]:
    """The rows of the first table, by their cells."""
    first = PAGE.read_text(encoding="utf-8").partition("| who |")[2].partition("\n\n")[0]
    for line in first.splitlines()[2:]:
        yield Row(*(cell.strip() for cell in line.strip("|").split("|")[:5]))


def the(begin: str) -> Row:
    (row,) = (row for row in rows() if row.who.startswith(begin))
    return row


def asked(router: Router, unit: int, pdu: str, host: str, role: str = "") -> bool:
    """Whether a request was carried out; a broadcast that was ended without an answer, too."""
    asker = Asker(host=host)
    asker.caller = replace(asker.caller, role=role)
    router.submit(Request(unit, bytes.fromhex(pdu), asker, 0.0), 0.0)
    (answer,) = asker.answers
    return answer is None or answer[0] not in "89"


def may(router: Router, host: str = "", role: str = "") -> May:
    return May(
        asked(router, 200, READ, host, role), asked(router, 200, WRITE, host, role), asked(router, 0, WRITE, host, role)
    )


def router_of(running: Running, name: str) -> Router:
    return next(each.router for each in running.gateway.listeners if each.settings.name == name)


@pytest.fixture
async def running(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        yield bench.running


def told(row: Row) -> May:
    """What a row says, where its cells are just `all` or nothing."""
    assert {*row[1:]} <= {"all", NOTHING}, row
    return May(*(cell == "all" for cell in row[1:]))


async def test_clients_of_listeners_may_what_the_table_says(running):
    here = the("client on this machine")
    assert here.broadcast == 'with `unit0 = "broadcast"`'
    for name in ("tcp", "rtu", "broadcasting"):
        says = told(here._replace(broadcast="all" if name == "broadcasting" else NOTHING))
        assert may(router_of(running, name), HERE) == says
        assert may(router_of(running, name), "::1") == says
        assert may(router_of(running, name), AFAR) == told(the("the same from another machine"))
    for host in (HERE, AFAR):
        assert may(router_of(running, "udp"), host) == told(the("Modbus UDP"))
        for role in ("", "operator"):
            assert may(router_of(running, "tls"), host, role) == told(the("`tls://`"))


async def test_the_client_of_a_server_line_may_what_the_table_says(running):
    row, servers = the("client on the cable"), running.gateway.servers
    assert the("program at a virtual serial port")[1:4] == ("as above",) * 3
    assert row.operate == the("program at a virtual serial port").operate == NOTHING
    assert [may(each.router) for each in servers] == [May(True, True, True)] * 2
    server = servers[0]
    assert "of `serves`" in row.read
    assert "of `serves`" in row.write
    assert not asked(server.router, 201, READ, "")
    asked(server.router, 0, "06 00 03 00 63", "")
    images = {image.settings.unit: image for image in running.gateway.images}
    assert "images among these" in row.broadcast
    control = running.routers.control
    assert _value(control, 200) == 0x63
    assert _value(control, 201) == 0
    assert set(images) == {200, 201}


def _value(router: Router, unit: int) -> int:
    asker = Asker(host="")
    router.submit(Request(unit, bytes.fromhex(READ), asker, 0.0), 0.0)
    assert asker.answers[0] is not None
    return int(asker.answers[0].replace(" ", "")[-4:], 16)


async def test_on_a_monitor_line_nobody_may_anything(tmp_path):
    row = the("what is on the bus of a line")
    assert told(row) == May(False, False)
    async with web_bench(CONFIG + MONITOR, tmp_path) as bench:
        running = bench.running
        (monitor,) = running.gateway.monitors
        assert monitor.plan.port.listens
        assert not hasattr(monitor, "router")
        for router in (router_of(running, "broadcasting"), running.routers.control, running.routers.web):
            for pdu in (READ, WRITE):
                asker = Asker(host=HERE)
                router.submit(Request(63, bytes.fromhex(pdu), asker, 0.0), 0.0)
                assert asker.answers == [f"{0x80 | int(pdu[:2], 16):02X} 0A"]
            asked(router, 0, WRITE, HERE)
        await asyncio.sleep(10)
        assert bench.inner.lines["bus"].written == b""


async def test_the_control_socket_and_other_sites_may_what_the_table_says(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        asker = OperatorAsker(Caller.without_address("control"), lambda: True)
        reloaded = await BY_NAME["reload"].answer(bench.operator, Nothing(), asker)
        operates = may(bench.running.routers.control)._replace(operate=isinstance(reloaded, Reloaded))
        assert operates == told(the("control socket"))
        assert may(bench.running.add_ons.fleet.router, "east") == told(the("other sites"))


async def test_the_program_may_what_the_table_says(running):
    assert may(running.routers.embedded) == told(the("the program that the gateway"))


async def test_the_broker_may_what_the_table_says(tmp_path):
    row = the("MQTT broker")
    assert row.write.startswith("with `write = true`")
    assert row.broadcast == row.operate == NOTHING
    for more, rights in (("", "read"), ("write = true\n", "read, write")):
        async with web_bench(f'site = "hall"\n{CONFIG}{MQTT}{more}', tmp_path) as bench:
            (usual,) = bench.running.gateway.plan.add_ons["mqtt"].usual_rights
            assert usual.may == rights
            assert not may(bench.running.add_ons.mqtt.router).broadcast


async def _over_http(bench: WebBench, host: str, name: str = "", headers: dict[str, str] | None = None) -> May:
    browser, own = bench.browser(host), headers or {}
    if name:
        await browser.log_in(name)
    if "X_Forwarded_User" in own:
        browser.csrf = (await browser.get("/api/v1/session", **own)).json["csrf"]
    answers: list[Any] = [
        await browser.get("/api/v1/units/200/holding/3", **own),
        await browser.put("/api/v1/units/200/holding/3", [7], **own),
        await browser.put("/api/v1/units/0/holding/3", [7], **own),
        await browser.post("/api/v1/reload", **own),
    ]
    *values, reload = (answer.status for answer in answers)
    return May(*(status == 200 for status in values), reload not in (401, 403))


@pytest.mark.parametrize("write", [False, True])
async def test_who_comes_over_http_may_what_the_table_says(tmp_path, write):
    settings: dict[str, Any] = {"write": write, "token": "s3cret", "proxy": (ip_network(PROXY),)}
    async with web_bench(CONFIG, tmp_path, **settings) as bench:
        bench.users.write_text(f"{USERS}mes:operator:{token_hash(MES)}\nwall:viewer:{token_hash(WALL)}\n")
        await asyncio.sleep(6)

        def says(row: Row, *, conditional: str = "with `write = true`") -> May:
            cells = (
                "all" if cell == conditional and write else NOTHING if cell == conditional else cell for cell in row
            )
            return told(Row(*cells))

        assert await _over_http(bench, HERE) == says(the("page or API, no login, from this machine"))
        assert await _over_http(bench, AFAR) == says(the("page or API, no login, from elsewhere"))
        for row, user, token in ((the("viewer"), "vera", WALL), (the("operator"), "anna", MES)):
            for host in (HERE, AFAR):
                assert await _over_http(bench, host, user) == says(row)
                assert await _over_http(bench, host, headers={"Authorization": f"Bearer {token}"}) == says(row)
        reads = {"Authorization": "Bearer s3cret"}
        assert await _over_http(bench, AFAR, headers=reads) == says(the("program with the `token`"))
        named = the("user whom a `proxy` names")
        assert (named.read, named.write, named.broadcast) == ("all", "as an operator", NOTHING)
        for user, row in (("anna", the("operator")), ("vera", the("viewer")), ("otto", the("viewer"))):
            assert await _over_http(bench, PROXY, headers={"X_Forwarded_User": user}) == says(row)


def test_each_row_of_the_table_has_a_test():
    tested = {
        *("client on this machine", "the same from another machine", "Modbus UDP", "`tls://`", "client on the cable"),
        *("control socket", "page or API, no login, from this machine", "page or API, no login, from elsewhere"),
        *("viewer", "operator", "program with the `token`", "user whom a `proxy` names", "MQTT broker", "other sites"),
        *("program at a virtual serial port", "what is on the bus of a line", "the program that the gateway"),
    }
    assert [row.who for row in rows() if not row.who.startswith(tuple(tested))] == []
    assert {begin for begin in tested if any(row.who.startswith(begin) for row in rows())} == tested
