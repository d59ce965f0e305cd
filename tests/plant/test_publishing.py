"""What a whole gateway publishes, in virtual time: reads, changes, availability, and commands."""

import asyncio
import json
import sys
from itertools import pairwise

import pytest

from gateway.config.plan.line_load import load_of, total_share
from gateway.events import AccessDenied, BrokerLost, CommandRefused, PartFailed, PollRefused, WriteAudit
from gateway.images.polling import TOGETHER_AGAIN
from gateway.plant.births import REBIRTH_PAUSE
from gateway.plant.commands import MOST_COMMANDS
from gateway.plant.messages import Delivery, Message
from gateway.plant.publisher import MOST_RESULTS
from gateway.plant.sparkplug_payload import DataType, Metric, Payload, encode
from gateway.simulator.generic import Generic
from kit.broker import FakeBroker
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench
from kit.paced import attach_paced

CONFIG = """
site = "plant"

[[line]]
name    = "hall"
port    = "/dev/hall"
baud    = 115200
rest    = "2 s"
timeout = "100 ms"
devices = [
  { unit = 1, as = 41, name = "silo-1", profile = "scale" },
  { unit = 2, as = 42, name = "silo-2", profile = "scale" },
]

[profile.scale]
timeout = "100 ms"
points = [
  { name = "weight", holding = 0, type = "float32", unit = "kg" },
  { name = "state", holding = 2, labels = { 0 = "off", 1 = "on" }, write = true },
  { name = "speed", holding = 10, scale = 0.1, decimals = 1 },
  { name = "valve", coils = 3, write = true },
]
"""
MQTT = """
[mqtt]
broker  = "mqtt://broker"
publish = [
  { device = "silo-1", points = ["speed"], every = "1 s", on_change = 0.5, at_least = "10 s" },
  { device = "silo-1", every = "500 ms" },
]
"""
SILO = "modbus/plant/silo-1"
HOLDING, COILS = 3, 1


def furnish(bench):
    devices = SimulatedDevice(1, delay=0.002), SimulatedDevice(2, delay=0.002)
    bench.attach("hall", SimulatedLine("rtu", *devices))
    return devices


async def settled(broker, seconds=3.0):
    await asyncio.sleep(seconds)
    return broker.said()


def reads(device):
    return [frame.pdu.hex() for frame in device.heard]


async def test_points_are_read_in_few_requests_at_their_intervals():
    async with gateway_bench(CONFIG + MQTT) as bench:
        silo, other = furnish(bench)
        FakeBroker.of(bench)
        await asyncio.sleep(9.9)
        counted = {pdu: reads(silo).count(pdu) for pdu in set(reads(silo))}
        assert counted == {"0300000003": 20, "0100030001": 20, "03000a0001": 10}
        assert reads(other) == []


async def test_the_birth_tells_all_that_is_known_and_that_the_gateway_is_there():
    async with gateway_bench(CONFIG + MQTT) as bench:
        silo, _ = furnish(bench)
        silo.holding[2], silo.holding[10], silo.coils[3] = 1, 123, True
        broker = FakeBroker.of(bench)
        await asyncio.sleep(2.0)
        assert broker.connect() == ["modbus/plant/+/+/set"]
        assert [message.topic for message in broker.messages] == [SILO, f"{SILO}/availability", "modbus/plant/status"]
        assert json.loads(broker.retained[SILO]).keys() == {"time", "weight", "state", "speed", "valve"}
        assert broker.retained[f"{SILO}/availability"] == b"online"
        assert broker.retained["modbus/plant/status"] == b"online"
        assert await settled(broker) == {}, "nothing has changed"


@pytest.mark.parametrize("prefix", ["works", "works/hall 3"])
async def test_all_topics_begin_with_the_prefix(prefix):
    keys = f'prefix = "{prefix}"\nwrite = true\nhome_assistant = "ha"\npublish'
    async with gateway_bench(CONFIG + MQTT.replace("publish", keys, 1)) as bench:
        silo, _ = furnish(bench)
        broker = FakeBroker.of(bench)
        await asyncio.sleep(2.0)
        assert broker.driver.publisher.will(0.0).topic == f"{prefix}/plant/status"
        assert broker.connect() == [f"{prefix}/plant/+/+/set", "ha/status", "homeassistant/status"]
        device = f"{prefix}/plant/silo-1"
        born = [device, f"{device}/availability", f"{prefix}/plant/status"]
        assert [message.topic for message in broker.messages] == born
        broker.send(f"{device}/state/set", "on")
        said = await settled(broker, 0.3)
        assert silo.holding[2] == 1
        assert said[f"{device}/state/result"] == {"value": "on", "result": "ok"}
        assert broker.send("modbus/plant/silo-1/state/set", "off") == {}
        assert broker.send(f"{prefix}/other/silo-1/state/set", "off") == {}
        await asyncio.sleep(REBIRTH_PAUSE)
        assert list(broker.send("ha/status", "online")) == born, "Home Assistant has started"


async def test_of_a_virtual_unit_only_the_values_of_a_silent_device_are_missing():
    hall = """
[[image]]
unit  = 240
name  = "hall"
stale = "2 s"
map = [
  { at = 0, device = "silo-1", point = "speed", every = "500 ms" },
  { at = 1, device = "silo-2", point = "speed", every = "500 ms" },
  { at = 2, device = "silo-2", point = "state", every = "500 ms" },
]
[mqtt]
broker  = "mqtt://broker"
publish = [{ device = "hall", every = "1 s" }]
"""
    async with gateway_bench(CONFIG + hall) as bench:
        silo, other = furnish(bench)
        silo.holding[10] = other.holding[10] = 5
        broker = FakeBroker.of(bench)
        await asyncio.sleep(2.0)
        broker.connect()
        whole = json.loads(broker.retained["modbus/plant/hall"])
        assert (whole["silo-1.speed"], whole["silo-2.speed"]) == (0.5, 0.5)
        other.silent = True
        silo.holding[10] = 6
        said = await settled(broker, 8.0)
        assert said["modbus/plant/hall"] == {"silo-1.speed": 0.6}
        assert broker.retained["modbus/plant/hall/availability"] == b"online"


async def test_a_change_is_published_and_what_is_inside_the_deadband_is_not():
    async with gateway_bench(CONFIG + MQTT) as bench:
        silo, _ = furnish(bench)
        broker = FakeBroker.of(bench)
        await asyncio.sleep(2.0)
        broker.connect()
        silo.holding[10] = 4
        assert await settled(broker) == {}, "by 0.4, and 0.5 is the least"
        silo.holding[10] = 5
        assert await settled(broker) == {SILO: {"weight": 0.0, "state": "off", "speed": 0.5, "valve": 0}}
        silo.holding[2] = 1
        assert await settled(broker) == {SILO: {"weight": 0.0, "state": "on", "speed": 0.5, "valve": 0}}


async def test_points_that_cannot_be_written_take_nothing_from_the_broker():
    async with gateway_bench(CONFIG.replace(", write = true", "") + MQTT) as bench:
        furnish(bench)
        broker = FakeBroker.of(bench)
        await asyncio.sleep(2.0)
        assert broker.connect() == []


async def test_a_value_is_published_at_least_as_often_as_the_config_says():
    async with gateway_bench(CONFIG + MQTT) as bench:
        furnish(bench)
        broker = FakeBroker.of(bench)
        await asyncio.sleep(2.0)
        broker.connect()
        times = []
        for _ in range(600):
            await asyncio.sleep(0.1)
            times += [broker.driver.now() for _ in broker.take()]
        assert len(times) >= 6
        assert max(late - early for early, late in pairwise(times)) <= 10.001


async def test_a_device_that_does_not_answer_is_offline_and_nothing_else_is_published_of_it():
    async with gateway_bench(CONFIG + MQTT) as bench:
        silo, _ = furnish(bench)
        broker = FakeBroker.of(bench)
        await asyncio.sleep(2.0)
        broker.connect()
        silo.silent = True
        assert await settled(broker) == {f"{SILO}/availability": "offline"}
        assert await settled(broker, 20.0) == {}
        silo.silent = False
        silo.holding[10] = 70
        assert await settled(broker, 20.0) == {
            SILO: {"weight": 0.0, "state": "off", "speed": 7.0, "valve": 0},
            f"{SILO}/availability": "online",
        }


async def test_one_lost_answer_does_not_make_a_device_unavailable():
    async with gateway_bench(CONFIG + MQTT) as bench:
        silo, _ = furnish(bench)
        broker = FakeBroker.of(bench)
        await asyncio.sleep(2.0)
        broker.connect()
        silo.script.append([])
        assert await settled(broker) == {}


async def test_while_the_broker_is_away_only_the_last_values_are_kept():
    async with gateway_bench(CONFIG + MQTT) as bench:
        silo, _ = furnish(bench)
        broker = FakeBroker.of(bench)
        await asyncio.sleep(2.0)
        broker.connect()
        broker.lose()
        await asyncio.sleep(0.1)  # between two reads
        heard = len(silo.heard)
        for value in range(100):
            silo.holding[10] = 10 * value
            await asyncio.sleep(1.0)
        assert broker.take() == []
        assert len(silo.heard) - heard == pytest.approx(500, abs=5), "reading goes on"
        broker.connect()
        assert [message.topic for message in broker.messages[-3:]] == [
            SILO,
            f"{SILO}/availability",
            "modbus/plant/status",
        ]
        assert json.loads(broker.retained[SILO])["speed"] == 99.0


async def test_what_was_handed_to_a_connection_that_was_lost_is_published_again():
    async with gateway_bench(CONFIG + MQTT) as bench:
        silo, _ = furnish(bench)
        broker = FakeBroker.of(bench)
        await asyncio.sleep(2.0)
        broker.connect()
        silo.holding[10] = 50
        await asyncio.sleep(1.5)
        broker.driver.take()  # lost with the connection
        broker.lose()
        broker.connect()
        assert json.loads(broker.retained[SILO])["speed"] == 5.0


async def test_a_value_that_is_too_old_is_not_published_as_new():
    async with gateway_bench(CONFIG + MQTT) as bench:
        silo, _ = furnish(bench)
        broker = FakeBroker.of(bench)
        await asyncio.sleep(2.0)
        broker.connect()
        silo.refuses[COILS] = 6
        silo.holding[2] = 1
        said = await settled(broker, 20.0)
        silo.holding[2] = 0
        said = await settled(broker)
        assert said[SILO].keys() == {"weight", "state", "speed"}


SLOW_VALVE = """
[mqtt]
broker  = "mqtt://broker"
publish = [{ device = "silo-1", points = ["valve"], every = "10 s" }, { device = "silo-1", every = "500 ms" }]
"""


@pytest.mark.parametrize("has_refused_before", [False, True])
async def test_a_point_that_missed_one_read_while_another_changed_is_published_again(has_refused_before):
    """The retained values have lost it meanwhile, although its own has not changed.

    Those behind a message that the broker has refused are published with the availability.
    """
    async with gateway_bench(CONFIG + SLOW_VALVE) as bench:
        silo, _ = furnish(bench)
        broker = FakeBroker.of(bench)
        await asyncio.sleep(2.0)
        broker.connect()
        silo.refuses[COILS] = 11
        await asyncio.sleep(10.8)  # the second read has failed, and what the first one brought is too old by now
        silo.holding[2] = 1
        if has_refused_before:
            broker.driver.refused(broker.messages[0], is_passing=True)
        assert (await settled(broker, 1.0))[SILO] == {"weight": 0.0, "state": "on", "speed": 0.0}
        del silo.refuses[COILS]
        assert await settled(broker, 5.0) == {SILO: {"weight": 0.0, "state": "on", "speed": 0.0, "valve": 0}}


@pytest.mark.parametrize(("setting", "prefix"), [("true", "homeassistant"), ('"ha"', "ha")])
async def test_when_home_assistant_has_started_it_is_told_everything_again(setting, prefix):
    async with gateway_bench(CONFIG + MQTT.replace("publish", f"home_assistant = {setting}\npublish", 1)) as bench:
        furnish(bench)
        broker = FakeBroker.of(bench, announcements=[Message(f"{prefix}/device/plant/silo-1/config", b"{}")])
        await asyncio.sleep(2.0)
        hosts = [f"{prefix}/status", "homeassistant/status"]
        assert broker.connect() == ["modbus/plant/+/+/set", *dict.fromkeys(hosts)]
        born = [message.topic for message in broker.messages]
        assert born[0] == f"{prefix}/device/plant/silo-1/config"
        assert born[-1] == "modbus/plant/status"
        for host in hosts:
            await asyncio.sleep(REBIRTH_PAUSE)
            assert list(broker.send(host, "online")) == born
        assert broker.send(hosts[0], "offline") == {}
        broker.send(hosts[0], "online")
        assert broker.send(hosts[0], "online") == {}
        assert list(await settled(broker, REBIRTH_PAUSE)) == born, "at most once a second"


@pytest.mark.parametrize("code", [2, 11])
async def test_a_point_without_new_values_disappears_from_its_device_until_it_has_one(code):
    async with gateway_bench(CONFIG + MQTT) as bench:
        silo, _ = furnish(bench)
        broker = FakeBroker.of(bench)
        await asyncio.sleep(2.0)
        broker.connect()
        silo.refuses[COILS] = code
        assert await settled(broker) == {SILO: {"weight": 0.0, "state": "off", "speed": 0.0}}
        assert await settled(broker, 4.0) == {}, "it is told once; the others have not changed"
        del silo.refuses[COILS]
        assert await settled(broker, 8.0) == {SILO: {"weight": 0.0, "state": "off", "speed": 0.0, "valve": 0}}


async def test_what_a_device_refuses_together_is_read_one_by_one():
    async with gateway_bench(CONFIG + MQTT) as bench:
        silo, _ = furnish(bench)
        silo.refuses[COILS] = 2
        del silo.holding[2:]  # reading 0 to 2 fails; 0 to 1 does not
        broker = FakeBroker.of(bench)
        await asyncio.sleep(5.0)
        broker.connect()
        assert json.loads(broker.retained[SILO]).keys() == {"time", "weight"}
        refused = [
            (event.device, event.addresses, event.code) for event in bench.events if isinstance(event, PollRefused)
        ]
        assert sorted(refused) == [
            ("silo-1", "coils 3", 2),
            ("silo-1", "holding 10", 2),
            ("silo-1", "holding 2", 2),
        ]


async def test_points_that_were_refused_together_are_tried_together_again():
    async with gateway_bench(CONFIG + MQTT) as bench:
        silo, _ = furnish(bench)
        FakeBroker.of(bench)
        registers, silo.holding[:] = list(silo.holding), silo.holding[:2]
        await asyncio.sleep(5.0)
        silo.holding[:] = registers
        await asyncio.sleep(TOGETHER_AGAIN + 0.1)
        silo.heard.clear()
        await asyncio.sleep(10.0)
        assert {pdu: reads(silo).count(pdu) for pdu in set(reads(silo))} == {
            "0300000003": 20,
            "0100030001": 20,
            "03000a0001": 10,
        }


async def test_a_failure_that_passes_parts_what_is_read_together_for_a_minute():
    """Some devices say 04 for addresses that they do not have."""
    async with gateway_bench(CONFIG + MQTT) as bench:
        silo, _ = furnish(bench)
        FakeBroker.of(bench)
        await asyncio.sleep(2.2)
        silo.refuses[HOLDING] = 4
        await asyncio.sleep(1.0)
        del silo.refuses[HOLDING]
        silo.heard.clear()
        await asyncio.sleep(5.0)
        assert set(reads(silo)) == {"0300000002", "0300020001", "0100030001", "03000a0001"}
        await asyncio.sleep(TOGETHER_AGAIN)
        silo.heard.clear()
        await asyncio.sleep(5.0)
        assert set(reads(silo)) == {"0300000003", "0100030001", "03000a0001"}


async def test_many_waiting_reads_fail_at_once_when_their_line_goes_down():
    """Each of them answers before `submit` returns; they must not pile up on the stack."""
    points = ", ".join(f'{{ name = "p{at}", holding = {2 * at} }}' for at in range(1000))
    config = CONFIG.replace('name = "silo-1", profile = "scale"', f'name = "silo-1", points = [{points}]')
    async with gateway_bench(config + MQTT.replace('{ device = "silo-1", points = ["speed"]', "#")) as bench:
        silo, _ = furnish(bench)
        broker = FakeBroker.of(bench)
        await asyncio.sleep(0.05)
        silo.silent = True
        bench.lines["hall"].pull()
        await asyncio.sleep(5.0)
        assert [event for event in bench.events if isinstance(event, PartFailed)] == []
        assert broker.driver.counts.failed >= 900


async def test_no_number_is_null():
    async with gateway_bench(CONFIG + MQTT) as bench:
        silo, _ = furnish(bench)
        silo.holding[:2] = [0x7FC0, 0]
        broker = FakeBroker.of(bench)
        await asyncio.sleep(2.0)
        broker.connect()
        assert json.loads(broker.retained[SILO])["weight"] is None
        assert await settled(broker) == {}, "and no change"


LINES, METERS = 8, 5


def thousand_points():
    """1000 points: 25 of each of 5 devices on each of 8 lines, every second."""
    lines = ""
    for line in range(LINES):
        units = f'unit = "1-{METERS}", as = "{line * METERS + 1}-{line * METERS + METERS}"'
        devices = f'[{{ {units}, name = "meter-*", profile = "m" }}]'
        lines += f'[[line]]\nname = "{line}"\nport = "/dev/{line}"\nbaud = 115200\ndevices = {devices}\n'
    profile = '[profile.m]\npoints = [{ name = "value-*", holding = "0-24" }]\n'
    row = '{ device = "*", every = "1 s", at_least = "1 s" }'
    return f'site = "plant"\n{lines}{profile}[mqtt]\nbroker = "mqtt://broker"\npublish = [{row}]\n'


async def test_a_thousand_points_take_of_each_line_what_is_foretold_with_a_broker_and_without():
    async with gateway_bench(thousand_points()) as bench:
        for line in bench.lines.values():
            attach_paced(line, "rtu", 115200, *(Generic(unit) for unit in range(1, METERS + 1)))
        broker, lines = FakeBroker.of(bench), bench.gateway.lines
        # Their profile says nothing of the 5 ms after which these devices answer.
        foretold = [total_share(load_of(line.plan, bench.gateway.plan)) + METERS * 0.005 for line in lines]
        assert foretold == pytest.approx([0.0726] * LINES, abs=0.0001)

        async def shares(seconds=10):
            before = [line.driver.line.phases(broker.driver.now()).busy for line in lines]
            messages = 0
            for _ in range(seconds):
                await asyncio.sleep(1.0)
                messages += len(broker.take())
            after = [line.driver.line.phases(broker.driver.now()).busy for line in lines]
            return [(late - early) / seconds for early, late in zip(before, after, strict=True)], messages

        await asyncio.sleep(3.5)
        broker.connect()
        for is_there in (True, False, True):
            found, messages = await shares()
            assert found == pytest.approx(foretold, rel=0.01)
            assert messages == (10 * LINES * METERS if is_there else 0)
            if is_there:
                broker.lose()
            else:
                broker.connect()


# Commands

WRITE = MQTT + "write = true\n"
STATE = f"{SILO}/state"


async def commanded(bench):
    silo, _ = furnish(bench)
    broker = FakeBroker.of(bench)
    await asyncio.sleep(2.0)
    return silo, broker, broker.connect()


def result(said, point=STATE):
    found = said.get(f"{point}/result")
    return found if found is None else (found["result"], found.get("reason", ""))


async def test_a_value_is_written_confirmed_and_published():
    async with gateway_bench(CONFIG + WRITE) as bench:
        silo, broker, topics = await commanded(bench)
        assert topics == ["modbus/plant/+/+/set"]
        broker.send(f"{STATE}/set", "on")
        await asyncio.sleep(0.3)
        said = broker.said()
        assert said[f"{STATE}/result"] == {"value": "on", "result": "ok"}
        assert said[SILO]["state"] == "on", "it is read again at once"
        assert silo.holding[2] == 1
        [audit] = [event for event in bench.events if isinstance(event, WriteAudit)]
        assert (audit.client, audit.listener, audit.unit, audit.result) == ("mqtt", "mqtt", 41, "ok")
        broker.send(f"{SILO}/valve/set", "on")
        await asyncio.sleep(0.3)
        assert silo.coils[3]


@pytest.mark.parametrize("text", ["nan", "inf", "-Infinity", "1e400", "1e9999999999999"])
async def test_a_value_that_is_not_finite_is_refused(text):
    config = CONFIG.replace('unit = "kg"', 'unit = "kg", write = true')
    async with gateway_bench(config + WRITE) as bench:
        silo, broker, _ = await commanded(bench)
        outcome, _ = result(broker.send(f"{SILO}/weight/set", text), f"{SILO}/weight")
        assert outcome == "failed"
        await asyncio.sleep(1.0)
        assert not any(frame.pdu[0] in (5, 6, 15, 16) for frame in silo.heard)


@pytest.mark.parametrize(
    ("payload", "options", "reason"),
    [
        ("on", {"is_retained": True}, "it is retained, so it may be old: send it without retain"),
        ("on", {"is_duplicate": True}, "it may have been delivered before"),
        ("on", {"expiry": 0}, "it has expired"),
        ("blue", {}, '"blue" is not a number; it has the labels off, on'),
        ("70000", {}, "70000 does not fit into uint16: 0 to 65535"),
        ("x" * 300, {}, "this has more than 256 bytes"),
    ],
)
async def test_what_must_not_be_written_is_refused_with_a_result(payload, options, reason):
    async with gateway_bench(CONFIG + WRITE) as bench:
        silo, broker, _ = await commanded(bench)
        said = broker.send(f"{STATE}/set", payload, **options)
        assert result(said) == ("failed", reason)
        [audit] = [event for event in bench.events if isinstance(event, WriteAudit)]
        assert (audit.client, audit.unit, audit.function, audit.address, audit.result) == ("mqtt", 41, 6, 2, "refused")
        await asyncio.sleep(1.0)
        assert not any(frame.pdu[0] in (5, 6, 15, 16) for frame in silo.heard)


async def test_the_audit_of_a_refused_command_names_the_function_that_would_have_written_it():
    config = CONFIG.replace('unit = "kg"', 'unit = "kg", write = true')
    async with gateway_bench(config + WRITE) as bench:
        _, broker, _ = await commanded(bench)
        broker.send(f"{STATE}/set", "on", is_retained=True)
        broker.send(f"{SILO}/weight/set", "2.5", is_retained=True)
        audits = [event.fields() for event in bench.events if isinstance(event, WriteAudit)]
        assert [(repr(each["function"]), each["count"]) for each in audits] == [("6", 1), ("16", 2)]


@pytest.mark.parametrize(
    ("target", "reason"),
    [
        ("silo-1/weight", "weight must not be written"),
        ("silo-1/valv", "silo-1 has no point valv"),
        ("silo-2/state", "no device silo-2 is published"),
        (f"silo-1/{'x' * 1000}", None),
    ],
)
async def test_what_can_never_be_written_gets_a_result_and_is_logged(target, reason):
    async with gateway_bench(CONFIG + WRITE) as bench:
        _, broker, _ = await commanded(bench)
        topic = f"modbus/plant/{target}"
        said = broker.send(f"{topic}/set", "7" * 300)
        logged = [(event.topic, event.reason) for event in bench.events if isinstance(event, CommandRefused)]
        if reason is None:
            assert said == {}
            assert logged == []
        else:
            assert said == {f"{topic}/result": {"value": "7" * 256, "result": "failed", "reason": reason}}
            assert logged == [(f"{topic}/set", reason)]


async def test_the_same_command_is_carried_out_once():
    async with gateway_bench(CONFIG + WRITE) as bench:
        silo, broker, _ = await commanded(bench)
        for _ in range(2):
            broker.send(f"{STATE}/set", "on", correlation=b"7")
            await asyncio.sleep(0.3)
        answers = [message for message in broker.messages if message.topic == f"{STATE}/result"]
        broker.take()
        answers = [message for message in broker.messages if message.topic == f"{STATE}/result"]
        assert [json.loads(message.payload)["result"] for message in answers] == ["ok", "failed"]
        assert [message.correlation for message in answers] == [b"7", b"7"]
        assert sum(frame.pdu[0] == 6 for frame in silo.heard) == 1


async def test_a_command_that_expires_while_it_waits_is_not_sent():
    async with gateway_bench(CONFIG + WRITE) as bench:
        silo, broker, _ = await commanded(bench)
        silo.delay = 0.09
        for _ in range(20):  # writes go first, so only others can keep it waiting
            broker.send(f"{SILO}/valve/set", "on")
        broker.send(f"{STATE}/set", "on", expiry=0.5)
        await asyncio.sleep(5.0)
        outcome, _ = result(broker.said())
        assert outcome == "failed"
        assert silo.holding[2] == 0


async def test_too_many_commands_at_once_are_refused():
    async with gateway_bench(CONFIG + WRITE) as bench:
        _, broker, _ = await commanded(bench)
        for _ in range(MOST_COMMANDS):
            broker.send(f"{STATE}/set", "on")
        assert result(broker.send(f"{STATE}/set", "on")) == (
            "failed",
            f"{MOST_COMMANDS} others are not finished yet",
        )


async def test_a_retry_of_what_was_refused_is_carried_out():
    async with gateway_bench(CONFIG + WRITE) as bench:
        silo, broker, _ = await commanded(bench)
        for _ in range(MOST_COMMANDS):
            broker.send(f"{SILO}/valve/set", "on")
        outcome, _ = result(broker.send(f"{STATE}/set", "on", correlation=b"7"))
        assert outcome == "failed"
        await asyncio.sleep(2.0)
        broker.send(f"{STATE}/set", "on", correlation=b"7")
        await asyncio.sleep(0.3)
        assert result(broker.said()) == ("ok", "")
        assert silo.holding[2] == 1


async def test_a_flood_of_commands_delays_no_values_and_takes_no_more_room():
    async with gateway_bench(CONFIG + WRITE) as bench:
        silo, broker, _ = await commanded(bench)
        for _ in range(3 * MOST_RESULTS):
            broker.driver.received(Delivery(f"{STATE}/set", b"blue", broker.driver.now()))
        silo.holding[10] = 50
        await asyncio.sleep(1.5)
        first = [message.topic for message in (*broker.driver.take(), *broker.driver.take())]
        assert sorted(first) == [SILO, f"{STATE}/result"]
        assert len(broker.take()) == MOST_RESULTS - 1
        assert broker.driver.publisher.dropped_results == 2 * MOST_RESULTS


REBIRTH = encode(Payload((Metric("Node Control/Rebirth", value=True, data_type=DataType.BOOLEAN),)), with_units=True)


async def test_many_hosts_that_want_a_birth_get_one_a_second():
    async with gateway_bench(CONFIG + MQTT.replace("publish", 'sparkplug = { group = "g" }\npublish', 1)) as bench:
        furnish(bench)
        broker = FakeBroker.of(bench)
        await asyncio.sleep(2.0)
        broker.connect()
        broker.messages.clear()
        for _ in range(30):
            broker.driver.received(Delivery("spBv1.0/g/NCMD/plant", REBIRTH, broker.driver.now()))
            await asyncio.sleep(0.1)
            broker.take()
        assert [message.topic.split("/")[2] for message in broker.messages].count("NBIRTH") in (2, 3)
        await asyncio.sleep(2.0)
        assert broker.take(), "the last one gets its own"
        assert await settled(broker) == {}


async def test_the_exception_of_the_device_is_the_result():
    async with gateway_bench(CONFIG + WRITE) as bench:
        silo, broker, _ = await commanded(bench)
        silo.refuses[6] = 4
        broker.send(f"{STATE}/set", "on")
        await asyncio.sleep(0.3)
        assert result(broker.said()) == ("failed", "the device answers: exception 04, server device failure")


async def test_rights_hold_for_the_client_mqtt():
    rows = '[[access]]\nlisten = ["mqtt"]\nunits = 41\nfunctions = [1, 3, 5, 16]\n'
    async with gateway_bench(CONFIG + WRITE + rows) as bench:
        silo, broker, _ = await commanded(bench)
        outcome, _ = result(broker.send(f"{STATE}/set", "on"))
        assert outcome == "failed"
        assert silo.holding[2] == 0
        assert any(isinstance(event, AccessDenied) for event in bench.events)


async def test_without_the_library_it_says_what_to_install_and_all_else_goes_on(monkeypatch):
    for module in ("paho", "paho.mqtt.client"):  # other tests may have loaded it
        monkeypatch.setitem(sys.modules, module, None)
    for module in ("gateway.plant.broker", "gateway.plant.connection"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    async with gateway_bench(CONFIG + MQTT) as bench:
        silo, _ = furnish(bench)
        publishing = bench.running.add_ons.mqtt
        await publishing.serve(bench.gateway)
        [lost] = [event for event in bench.events if isinstance(event, BrokerLost)]
        assert "is not installed" in lost.reason
        assert (publishing.status().state, publishing.status().reason) == ("down", lost.reason)
        await asyncio.sleep(2.0)
        assert silo.heard
        await publishing.stop()
        await asyncio.sleep(0.1)
        heard = len(silo.heard)
        await asyncio.sleep(5.0)
        assert len(silo.heard) == heard
        assert publishing.status() is None


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


@pytest.mark.parametrize("is_changed", [True, False])
async def test_no_command_of_earlier_points_goes_by_the_routes_of_a_reload(monkeypatch, is_changed):
    monkeypatch.setattr("gateway.plant.broker.Broker", SilentBroker)
    config = CONFIG + MQTT + "write = true\n"
    other = config.replace("unit = 1, as = 41", "unit = 3, as = 41") if is_changed else config
    async with gateway_bench(config) as bench:
        devices = SimulatedDevice(1), SimulatedDevice(3)
        bench.attach("hall", SimulatedLine("rtu", *devices))
        publishing = bench.running.add_ons.mqtt
        await publishing.serve(bench.gateway)
        driver = publishing.part.driver

        async def slowly(_: object) -> None:
            await asyncio.sleep(1.0)
            driver.received(Delivery(f"{SILO}/state/set", b"1", driver.now()))

        monkeypatch.setattr(bench.running.add_ons.fleet, "connect", slowly)
        await bench.reload(other)
        await asyncio.sleep(1.0)
        written = [frame.pdu.hex() for device in devices for frame in device.heard if frame.pdu[0] == 6]
        assert written == ([] if is_changed else ["0600020001"])
        await publishing.stop()


async def test_a_command_that_comes_again_after_a_reload_is_carried_out_once(monkeypatch):
    monkeypatch.setattr("gateway.plant.broker.Broker", SilentBroker)
    config = CONFIG + MQTT + "write = true\n"
    async with gateway_bench(config) as bench:
        silo, _ = furnish(bench)
        publishing = bench.running.add_ons.mqtt
        await publishing.serve(bench.gateway)
        driver = publishing.part.driver
        driver.received(Delivery(f"{STATE}/set", b"1", driver.now(), correlation=b"7"))
        await asyncio.sleep(0.5)
        await bench.reload(config.replace('rest    = "2 s"', 'rest    = "3 s"'))
        await asyncio.sleep(1.0)
        driver = publishing.part.driver
        driver.received(Delivery(f"{STATE}/set", b"1", driver.now(), correlation=b"7"))
        await asyncio.sleep(1.0)
        await publishing.stop()
        assert [frame.pdu.hex() for frame in silo.heard if frame.pdu[0] == 6] == ["0600020001"]
