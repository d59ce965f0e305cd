"""What the gateway is connected to, on the page of the clients and on the tiles of the overview."""

from dataclasses import replace

import pytest

from gateway.fleet.status import FleetStatus
from gateway.operator.operations.answers.status import LeaseStatus
from gateway.operator.operator import Operator
from gateway.operator.status.status import recent_status
from gateway.plant.status import BrokerStatus, KeptStatus
from gateway.tls.status import CertificateStatus
from gateway.web.pages import clients, situation
from gateway.web.pages.tiles import tiles_of
from kit.browser import web_bench
from kit.markup import Markup

CONFIG = """
site = "plant-2"

[[listen]]
bind = "tcp://127.0.0.1:5020"
clients = 8

[[line]]
name = "hall"
port = "/dev/hall"
devices = [{ unit = 1, name = "silo" }]
"""
BROKER = BrokerStatus(
    broker="mqtt://broker:1883",
    source="gateway.toml:1",
    state="up",
    reason="",
    down_ms=None,
    version="5",
    attempts=1,
    devices=3,
    available=2,
    points=9,
    messages=1234,
    refused_messages=2,
    commands=0,
    refused_commands=0,
    polls=99,
    failed_polls=0,
    last_refused_ms=5000.0,
    up_ms=7_200_000.0,
    messages_per_s=2.5,
    waiting=4,
    kept=KeptStatus(
        values=12340,
        since="2026-05-01T10:05:00Z",
        age_ms=1_200_000.0,
        bytes=3 * 2**20,
        limit=64 * 2**20,
        full_in_ms=10_800_000.0,
        given_up=7,
        given_up_ms=5000.0,
        trouble="disk <full>",
    ),
)
FLEET = FleetStatus(
    "nats://hub", "gateway.toml:2", "plant-2", "down", "refused", "", 60_000.0, 3, 5, 4, 0, 0, 0, 0, 0, 0
)
LEASE = LeaseStatus("hall", "hall-a", is_held=False, holder="other at gw-2", taken=2, trouble="")
OLD = CertificateStatus("tls", "gateway.toml:3", "certificate", "old.pem", "CN=gw", "2026-05-01", -1.0)
SOON = CertificateStatus("tls", "gateway.toml:3", "certificate", "soon.pem", "CN=gw", "2026-06-01", 12.0)
FINE = CertificateStatus("tls", "gateway.toml:3", "ca", "ca.pem", "CN=ca", "2036-06-01", 3650.0)


@pytest.fixture
async def bench(tmp_path, monkeypatch):
    async def connected(operator):
        status = await recent_status(operator)
        certificates = (FINE, OLD, SOON)
        return replace(status, brokers=(BROKER,), fleets=(FLEET,), leases=(LEASE,), certificates=certificates)

    for module in (clients, situation):
        monkeypatch.setattr(module, "recent_status", connected)
    async with web_bench(CONFIG, tmp_path) as bench:
        yield bench


async def rows(bench):
    return {row[0]: " | ".join(row) for row in Markup((await bench.browser().get("/clients")).text).rows()}


async def test_a_broker_has_its_state_since_when_and_what_passes(bench):
    row = (await rows(bench))["MQTT broker"]
    assert "mqtt://broker:1883 | up | 2 h 0 min |" in row
    assert "2.5 messages/s, 1234 in all, 4 waiting" in row
    assert "2 of 3 devices available" in row
    assert "2 messages refused, the last one 5 s ago" in row


async def test_what_is_kept_for_a_broker_is_beside_it(bench):
    row = (await rows(bench))["MQTT broker"]
    assert "12340 values kept, the oldest 20 min ago, 3.0/64 MiB · full in 3 h 0 min" in row
    assert "7 values given up, the last ones 5 s ago · kept in memory only: disk <full>" in row
    assert "2 of 3 devices available · 12340 values kept" in (await bench.browser().get("/")).text


async def test_the_fleet_says_why_it_is_down_and_a_lease_who_holds_it(bench):
    found = await rows(bench)
    assert "nats://hub | down refused | 60 s | 5 requests of other sites, 4 answered" in found["fleet (plant-2)"]
    assert "hall | standby" in found["lease hall-a"]
    assert "held by other at gw-2; taken 2 times" in found["lease hall-a"]


async def test_a_listener_has_its_clients_of_those_that_it_may_have(bench):
    assert "| 0 of 8 | 0 | 0 | 0 | 0" in (await rows(bench))["tcp://127.0.0.1:5020"]


async def test_certificates_are_listed_the_first_to_expire_first(bench):
    text = (await bench.browser().get("/clients")).text
    assert text.index("old.pem") < text.index("soon.pem") < text.index("ca.pem")
    assert '<span class="state down">2026-05-01</span>' in text
    assert '<span class="state failing">2026-06-01</span>' in text
    assert '<span class="state up">2036-06-01</span>' in text


async def test_the_overview_has_tiles_for_them(bench):
    text = (await bench.browser().get("/")).text
    assert "<title>" in text
    assert "· Overview · plant-2</title>" in text
    assert 'class="tile failing"><b>up</b> <span>broker · 2 of 3 devices available' in text
    assert 'class="tile down"><b>down</b> <span>fleet' in text
    assert 'class="tile known"><b>0/1</b> <span>leases held' in text


async def test_a_broker_that_is_down_is_red(bench):
    seen = await recent_status(Operator(bench.running, None))
    status = replace(seen, brokers=(replace(BROKER, state="down"),))
    (tile,) = (each for each in tiles_of(status, {}, ()) if each.kind == "broker")
    assert tile.state == "down"
