"""What a whole gateway publishes of points that say more than type and scale, and what is written to them."""

import asyncio
import json

import pytest

from gateway.events import WriteAudit
from gateway.plant.sparkplug_payload import DataType, Metric, Payload, decode, encode
from kit.broker import FakeBroker
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench

#: A status word of sixteen alarms that the operator may acknowledge; those of a drive have labels.
ALARMS = "\n".join(
    f'  {{ name = "alarm-{bit}", holding = 20, bit = {bit}, write = true, labels = {{ 0 = "ok", 1 = "alarm" }} }},'
    for bit in range(16)
)
CONFIG = f"""
site = "plant"

[[line]]
name    = "hall"
port    = "/dev/hall"
baud    = 115200
devices = [{{ unit = 1, as = 41, name = "chiller", profile = "chiller" }}]

[profile.chiller]
timeout   = "100 ms"
functions = FUNCTIONS
points    = [
  {{ name = "supply", input = 0, type = "int16", scale = 0.1, decimals = 1, unit = "°C", invalid = 0x7FFF }},
  {{ name = "outside", input = 1, offset = -40, unit = "°C" }},
  {{ name = "counter", input = 2, type = "bcd32" }},
  {{ name = "low", input = 4, byte = "low", type = "int8" }},
  {{ name = "mode", input = 4, byte = "high", labels = {{ 0 = "off", 7 = "auto" }} }},
  {{ name = "energy", input = 5, type = "uint32", scale_from = "energy-sf", unit = "Wh" }},
  {{ name = "energy-sf", input = 9, type = "int16" }},
  {{ name = "setpoint", holding = 0, type = "int16", scale = 0.1, write = true, min = 5, max = 30, write_at = 100 }},
  {{ name = "limit", holding = 2, type = "int16", scale_from = "limit-sf", write = true }},
  {{ name = "limit-sf", holding = 4, type = "int16" }},
  {{ name = "stage", holding = 6, bits = "4-6", write = true, max = 5 }},
{ALARMS}
]

[mqtt]
broker  = "mqtt://broker"
write   = true
publish = [{{ device = "chiller", every = "5 s" }}]
"""
MASKING = CONFIG.replace("FUNCTIONS", "[3, 4, 6, 16, 22]")
TURNING = CONFIG.replace("FUNCTIONS", "[3, 4, 6]")
CHILLER = "modbus/plant/chiller"


async def begun(bench):
    chiller = SimulatedDevice(1, delay=0.002)
    chiller.input[:10] = [215, 62, 0x1234, 0x5678, 0x07FE, 0, 12, 0, 0, 2]
    chiller.holding[:7] = [200, 0, 125, 0, 0xFFFF, 0, 0b1010_0000_0011_0101]
    chiller.holding[20] = 0b1000_0000_0000_0010
    bench.attach("hall", SimulatedLine("rtu", chiller))
    broker = FakeBroker.of(bench)
    await asyncio.sleep(1.0)
    broker.connect()
    return chiller, broker


def kept(broker):
    told = json.loads(broker.retained[CHILLER])
    del told["time"]
    return told


async def wrote(broker, point, value):
    """Send a value; its result, and the reason if it failed."""
    said = broker.send(f"{CHILLER}/{point}/set", value)
    await asyncio.sleep(0.5)
    said |= broker.said()
    result = said[f"{CHILLER}/{point}/result"]
    return result["result"] if "reason" not in result else result["reason"]


def written(chiller):
    return [frame.pdu.hex() for frame in chiller.heard if frame.pdu[0] not in (3, 4)]


async def test_points_are_published_as_their_profile_says():
    async with gateway_bench(MASKING) as bench:
        _, broker = await begun(bench)
        assert kept(broker) == {
            "supply": 21.5,
            "outside": 22,
            "counter": 12345678,
            "low": -2,
            "mode": "auto",
            "energy": 1200,
            "energy-sf": 2,
            "setpoint": 20,
            "limit": 12.5,
            "limit-sf": -1,
            "stage": 3,
            **{f"alarm-{bit}": "alarm" if bit in (1, 15) else "ok" for bit in range(16)},
        }


async def test_a_point_without_a_value_is_null_and_its_device_stays_online():
    async with gateway_bench(MASKING) as bench:
        chiller, broker = await begun(bench)
        chiller.input[0], chiller.input[2], chiller.input[9] = 0x7FFF, 0x12AB, 0x8000
        await asyncio.sleep(6.0)
        assert broker.said().keys() == {CHILLER}, "nothing of its availability"
        told = kept(broker)
        assert (told["supply"], told["counter"], told["energy"], told["outside"]) == (None, None, None, 22)
        assert broker.retained[f"{CHILLER}/availability"] == b"online"
        await asyncio.sleep(20.0)
        assert broker.said() == {}, "null is no news"
        chiller.input[0] = 200
        await asyncio.sleep(6.0)
        broker.take()
        assert kept(broker)["supply"] == 20.0


async def test_the_alarms_of_a_status_word_are_read_with_one_request():
    async with gateway_bench(MASKING) as bench:
        chiller, _ = await begun(bench)
        reads = [frame.pdu.hex() for frame in chiller.heard]
        assert reads.count("0300140001") == 1


@pytest.mark.parametrize(("config", "pdus"), [
    (MASKING, ["160014fffd0000", "160014fffe0001"]),
    (TURNING, ["0600148000", "0600148001"]),
], ids=["22", "a read and a write"])  # fmt: skip
async def test_an_alarm_that_is_written_leaves_the_others_alone(config, pdus):
    async with gateway_bench(config) as bench:
        chiller, broker = await begun(bench)
        assert await wrote(broker, "alarm-1", "ok") == "ok"
        assert await wrote(broker, "alarm-0", "1") == "ok"
        assert chiller.holding[20] == 0b1000_0000_0000_0001
        assert written(chiller) == pdus
        told = kept(broker)
        assert {name for name, value in told.items() if value == "alarm"} == {"alarm-0", "alarm-15"}, "read again soon"


@pytest.mark.parametrize("config", [MASKING, TURNING], ids=["22", "a read and a write"])
async def test_some_bits_of_a_register_are_a_number_of_their_own(config):
    async with gateway_bench(config) as bench:
        chiller, broker = await begun(bench)
        assert await wrote(broker, "stage", "5") == "ok"
        assert chiller.holding[6] == 0b1010_0000_0101_0101
        assert await wrote(broker, "stage", "6") == "6 is too high: stage must be at most 5"
        assert chiller.holding[6] == 0b1010_0000_0101_0101


async def test_a_value_beyond_the_limits_is_refused_and_audited():
    async with gateway_bench(MASKING) as bench:
        chiller, broker = await begun(bench)
        assert await wrote(broker, "setpoint", "30.1") == "30.1 is too high: setpoint must be 5 to 30"
        assert await wrote(broker, "setpoint", "4.9") == "4.9 is too low: setpoint must be 5 to 30"
        assert written(chiller) == []
        audits = [event for event in bench.events if isinstance(event, WriteAudit)]
        assert [(each.address, each.function, each.result) for each in audits] == [(100, 6, "refused")] * 2


async def test_a_point_is_written_where_its_profile_says_and_read_at_its_own_place():
    async with gateway_bench(MASKING) as bench:
        chiller, broker = await begun(bench)
        chiller.heard.clear()
        assert await wrote(broker, "setpoint", "22.5") == "ok"
        assert (chiller.holding[0], chiller.holding[100]) == (200, 225)
        assert "0300000001" in [frame.pdu.hex() for frame in chiller.heard], "its own place is read again at once"


async def test_a_point_with_a_scale_register_is_written_with_the_scale_that_is_there_now():
    async with gateway_bench(MASKING) as bench:
        chiller, broker = await begun(bench)
        chiller.holding[4] = 1
        chiller.heard.clear()
        assert await wrote(broker, "limit", "70") == "ok"
        assert chiller.holding[2] == 7
        assert [frame.pdu.hex() for frame in chiller.heard[:2]] == ["0300020003", "0600020007"]
        assert kept(broker)["limit"] == 70
        chiller.holding[4] = 0x8000
        assert await wrote(broker, "limit", "70") == "the device has no scale for limit now"
        assert chiller.holding[2] == 7


async def test_a_scale_that_cannot_be_read_is_the_reason_that_nothing_is_written():
    async with gateway_bench(MASKING) as bench:
        chiller, broker = await begun(bench)
        chiller.refuses[3] = 4
        assert "04" in await wrote(broker, "limit", "70")
        assert written(chiller) == []


async def test_a_reload_between_scale_and_write_stops_the_write():
    async with gateway_bench(MASKING) as bench:
        chiller, broker = await begun(bench)
        chiller.delay = 0.05
        broker.send(f"{CHILLER}/limit/set", "70")
        await asyncio.sleep(0.01)
        broker.driver.close()
        await asyncio.sleep(1.0)
        result = broker.said()[f"{CHILLER}/limit/result"]
        assert (result["result"], result["reason"][:18]) == ("failed", "the gateway stops,")
        assert written(chiller) == []


async def test_a_host_of_sparkplug_sets_bits_and_sees_null():
    config = MASKING.replace("write   = true", 'write   = true\nsparkplug = { group = "plant" }').replace(
        ', labels = { 0 = "ok", 1 = "alarm" }', ""
    )
    async with gateway_bench(config) as bench:
        chiller, broker = await begun(bench)
        chiller.input[0] = 0x7FFF
        births = [each for each in broker.messages if "/DBIRTH/" in each.topic]
        birth = {metric.name: metric for metric in decode(births[0].payload).metrics}
        assert (birth["alarm-1"].value, birth["alarm-1"].data_type) == (True, DataType.BOOLEAN)
        assert (birth["stage"].value, birth["counter"].value) == (3, 12345678)
        await asyncio.sleep(6.0)
        (data,) = (each for each in broker.take() if "/DDATA/" in each.topic)
        (supply,) = decode(data.payload).metrics
        assert (supply.name, supply.value, supply.data_type) == ("supply", None, DataType.DOUBLE)
        command = Payload((Metric("alarm-1", value=False, data_type=DataType.BOOLEAN),), 0.0)
        broker.send_bytes("spBv1.0/plant/DCMD/plant/chiller", encode(command, with_units=False))
        await asyncio.sleep(0.5)
        assert chiller.holding[20] == 0b1000_0000_0000_0000
