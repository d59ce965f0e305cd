"""A mirror and a broker that want values of the same device: its polls are one, and so is what is known of writes."""

import asyncio
import json

import pytest

from gateway.config.plan.line_load import declared_polls
from gateway.events import PartFailed, RequestRefused
from gateway.plant.publisher import Publisher
from kit.broker import FakeBroker
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench
from kit.statuses import status

CONFIG = """
site = "plant"

[[line]]
name    = "hall"
port    = "/dev/hall"
baud    = 115200
timeout = "100 ms"
devices = [{ unit = 1, as = 41, name = "silo", profile = "scale" }]

[profile.scale]
timeout = "100 ms"
max_gap = 2
points = [
  { name = "weight", holding = 0, type = "float32" },
  { name = "state", holding = 2, write = true },
  { name = "limit", holding = 5, write = true },
  { name = "valve", coils = 3, write = true },
]
"""
MIRROR = """
[[image]]
unit  = 241
name  = "copy"
of    = "silo"
stale = "10 s"
read  = [{ holding = ["0-2", "6"], every = "1 s" }, { coils = "0-7", every = "5 s" }]
"""
MQTT = """
[mqtt]
broker  = "mqtt://broker"
write   = true
publish = [{ device = "silo", every = "1 s" }]
"""
SILO = "modbus/plant/silo"


def furnish(bench):
    silo = SimulatedDevice(1, delay=0.002)
    bench.attach("hall", SimulatedLine("rtu", silo))
    return silo


def heard(silo):
    """The requests that came since the last call."""
    found = [frame.pdu.hex() for frame in silo.heard]
    silo.heard.clear()
    return found


def kept(broker):
    """What the broker keeps of the device."""
    broker.take()
    return json.loads(broker.retained[SILO])


async def test_what_both_want_is_sent_as_check_foretells_and_named_after_both():
    async with gateway_bench(CONFIG + MIRROR + MQTT) as bench:
        silo = furnish(bench)
        silo.holding[2], silo.holding[6] = 7, 8
        broker, client = FakeBroker.of(bench), bench.client()
        await asyncio.sleep(9.5)
        heard(silo)
        await asyncio.sleep(10.0)
        gateway = bench.gateway
        declared = list(declared_polls(gateway.plan.owners[0], gateway.plan))
        expected = {each.poll.request.hex(): round(10 / each.poll.every) for each in declared}
        assert expected == {"0300000007": 10, "0100030001": 10, "0100000008": 2}
        found = heard(silo)
        assert {pdu: found.count(pdu) for pdu in set(found)} == expected
        broker.connect()
        assert kept(broker)["state"] == 7
        assert await client.asks(241, "03 0006 0001") == "03 02 00 08"
        assert await client.asks(241, "03 0005 0001") == "83 02", "MQTT wants it, the mirror does not"
        line = status(bench.running).lines[0]
        assert "mirror copy, mqtt" in {user.client for user in line.users}


async def test_who_reads_the_mirror_after_a_write_by_mqtt_gets_what_was_written():
    async with gateway_bench(CONFIG + MIRROR + MQTT) as bench:
        silo = furnish(bench)
        broker, client = FakeBroker.of(bench), bench.client()
        await asyncio.sleep(2.2)
        broker.connect()
        silo.delay = 0.05
        broker.send(f"{SILO}/state/set", "9")
        await asyncio.sleep(0.08)
        assert broker.said()[f"{SILO}/state/result"]["result"] == "ok"
        assert await client.asks(241, "03 0002 0001") == "03 02 00 09"


async def test_a_write_through_the_mirror_is_published_at_once():
    async with gateway_bench(CONFIG + MIRROR + MQTT.replace("1 s", "1 h")) as bench:
        furnish(bench)
        broker, client = FakeBroker.of(bench), bench.client()
        await asyncio.sleep(2.0)
        broker.connect()
        assert await client.asks(241, "06 0005 0005") == "06 00 05 00 05"
        await asyncio.sleep(0.1)
        assert broker.said()[SILO]["limit"] == 5


async def test_a_write_that_the_device_refuses_costs_no_polls():
    async with gateway_bench(CONFIG + MQTT.replace("1 s", "1 h")) as bench:
        silo = furnish(bench)
        broker = FakeBroker.of(bench)
        await asyncio.sleep(2.0)
        broker.connect()
        heard(silo)
        silo.refuses[6] = 3
        broker.send(f"{SILO}/state/set", "9")
        await asyncio.sleep(1.0)
        assert heard(silo) == ["0600020009"]


async def test_a_defect_in_what_publishes_keeps_no_values_from_the_mirror(monkeypatch):
    def defect(*_, **__):
        raise ZeroDivisionError

    monkeypatch.setattr(Publisher, "took", defect)
    async with gateway_bench(CONFIG + MIRROR + MQTT) as bench:
        silo = furnish(bench)
        FakeBroker.of(bench)
        await asyncio.sleep(2.2)
        silo.holding[2] = 9
        await asyncio.sleep(1.0)
        assert await bench.client().asks(241, "03 0002 0001") == "03 02 00 09"
        assert {event.part for event in bench.events if isinstance(event, PartFailed)} == {"mqtt"}


class SilentBroker:
    """A connection that never stands."""

    reason = "no network"
    has_left = False

    def __init__(self, *_: object) -> None:
        pass

    async def run(self) -> None:
        await asyncio.Event().wait()

    def stop(self, _: object) -> None:
        pass


async def test_a_reload_takes_and_gives_back_what_mqtt_wants_and_the_mirror_goes_on(monkeypatch):
    monkeypatch.setattr("gateway.plant.broker.Broker", SilentBroker)
    long = (CONFIG + MIRROR).replace("1 s", "10 s")
    async with gateway_bench(long) as bench:
        silo = furnish(bench)
        await asyncio.sleep(5.0)
        assert set(heard(silo)) == {"0100000008", "0300000003", "0300060001"}
        await bench.reload(long + MQTT)
        await asyncio.sleep(0.5)
        assert heard(silo) == ["0100030001", "0300000006"], "what is new, and at once"
        await bench.reload(long + MQTT + "\n# moved")
        await asyncio.sleep(0.4)
        assert heard(silo) == [], "a publication that stays goes on"
        await bench.reload(long + MQTT.replace('device = "silo"', 'device = "silo", points = ["valve"]'))
        await asyncio.sleep(3.2)
        assert set(heard(silo)) == {"0100030001", "0100000008"}
        await bench.reload(long)
        await asyncio.sleep(0.5)
        heard(silo)
        await asyncio.sleep(10.0)
        found = heard(silo)
        assert {pdu: found.count(pdu) for pdu in set(found)} == {"0100000008": 2, "0300000003": 1, "0300060001": 1}


@pytest.mark.parametrize("unit", [9, 241])
async def test_what_the_gateway_answers_itself_is_read_and_written_as_a_device(unit):
    image = '[[image]]\nunit = 9\nname = "shift"\nprofile = "scale"\nholding = "0-9"\ncoils = 8\n'
    name = {9: "shift", 241: "copy"}[unit]
    mirror = MIRROR.replace('"6"', '"5"')
    async with gateway_bench(CONFIG + mirror + image + MQTT.replace("silo", name)) as bench:
        silo = furnish(bench)
        broker = FakeBroker.of(bench)
        await asyncio.sleep(2.2)
        broker.connect()
        broker.send(f"modbus/plant/{name}/state/set", "9")
        await asyncio.sleep(0.3)
        said = broker.said()[f"modbus/plant/{name}"]
        assert (said["state"], said["limit"]) == (9, 0)
        assert ("0600020009" in heard(silo)) is (unit == 241)
        assert not [event for event in bench.events if isinstance(event, RequestRefused)], "it has no gaps to read over"


async def test_a_line_that_reloads_rebuild_while_its_polls_wait_is_polled_afterwards():
    ranges = ", ".join(f'"{10 * at}"' for at in range(19))
    config = CONFIG + MIRROR.replace('"0-2", "6"', ranges)
    async with gateway_bench(config) as bench:
        for timeout in ("200 ms", "300 ms", "400 ms"):
            furnish(bench).silent = True
            await asyncio.sleep(2.0)
            await bench.reload(config.replace('"100 ms"\ndevices', f'"{timeout}"\ndevices'))
        silo = furnish(bench)
        await asyncio.sleep(20.0)
        heard(silo)
        await asyncio.sleep(5.0)
        assert len(heard(silo)) == 19 * 5 + 1
