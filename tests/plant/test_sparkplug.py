"""The gateway as an edge node, against the requirements of the Sparkplug specification 3.0.0.

The names above a test are those of the specification, there with `tck-id-` before them. Those that have no test stand
in tests/vectors/sparkplug-requirements.toml, each with the reason.
"""

import json
import tomllib
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import get_args

import pytest

from gateway.modbus.codes import Area
from gateway.plant.messages import Command, Delivery, DeviceState, Leave, Reading, Rebirth, Record
from gateway.plant.sparkplug import Sparkplug
from gateway.plant.sparkplug_payload import DataType, Metric, Payload, decode, encode, signed
from gateway.profiles.point import Point
from gateway.profiles.published import PublishedDevice, PublishedPoint
from gateway.registers import datatypes

LEFT_OUT = tomllib.loads(
    (Path(__file__).parents[1] / "vectors" / "sparkplug-requirements.toml").read_text(encoding="utf-8")
)
TESTED = Counter()

AT = 1700000000.5
SCALE = PublishedDevice(
    "silo-1",
    41,
    "Weigher",
    (
        PublishedPoint(Point("weight", Area.HOLDING, 0, "float32", count=2, unit="kg"), 1.0),
        PublishedPoint(Point("state", Area.HOLDING, 8, labels={0: "off", 1: "running"}), 1.0),
    ),
)
DRIVE = PublishedDevice(
    "drive-1",
    42,
    "Drive",
    (
        PublishedPoint(Point("speed", Area.HOLDING, 0, "int16", write="yes"), 1.0, is_writable=True),
        PublishedPoint(Point("ramp", Area.HOLDING, 1, scale=0.1, decimals=1, write="yes"), 1.0, is_writable=True),
        PublishedPoint(Point("mode", Area.HOLDING, 2, labels={1: "auto"}, write="yes"), 1.0, is_writable=True),
        PublishedPoint(Point("run", Area.COILS, 0, "bit", write="yes"), 1.0, is_writable=True),
        PublishedPoint(Point("gain", Area.HOLDING, 4, "float32", count=2, write="yes"), 1.0, is_writable=True),
        PublishedPoint(Point("hours", Area.INPUT, 4, "uint32", count=2), 1.0),
    ),
)  # fmt: skip
WEIGHED = {"weight": Reading(4999.66, AT - 1), "state": Reading("running", AT - 2)}
RUNNING = {"speed": Reading(-5, AT - 1), "run": Reading(1, AT - 1)}
STATES = (
    DeviceState(SCALE, is_available=True, readings=WEIGHED),
    DeviceState(DRIVE, is_available=True, readings=RUNNING),
)


def tck(*names):
    def mark(test):
        TESTED.update(names)
        return test

    return mark


def connected(primary_host=None):
    node = Sparkplug("plant", "gw", (SCALE, DRIVE), primary_host)
    node.will(AT)
    return node


def born():
    node = connected()
    list(node.born(STATES, AT))
    return node


def metrics(message):
    return {metric.name: metric for metric in decode(message.payload).metrics}


def state_of_host(node, *, online, timestamp, host="scada"):
    payload = json.dumps({"online": online, "timestamp": timestamp}).encode()
    return node.received(Delivery(f"spBv1.0/STATE/{host}", payload, AT, is_retained=True))


def told(node, topic, *sent, **more):
    payload = encode(Payload(sent, AT), with_units=False)
    return node.received(Delivery(topic, payload, AT, **more))


def without_type(metric):
    """The payload of a command that leaves the type out, as hosts may."""
    data = encode(Payload((metric,)), with_units=False)
    start = 4 + len(metric.name)
    assert data[start : start + 2] == bytes((0x20, metric.data_type))
    return data[:1] + bytes((data[1] - 2,)) + data[2:start] + data[start + 2 :]


def wants_rebirth(node, *, value=True):
    return told(node, "spBv1.0/plant/NCMD/gw", Metric("Node Control/Rebirth", value, DataType.BOOLEAN))


def wants(node, *sent, device="drive-1", **more):
    return told(node, f"spBv1.0/plant/DCMD/gw/{device}", *sent, **more)


def test_each_requirement_is_tested_or_left_out_for_a_reason():
    left_out = Counter(name for each in LEFT_OUT["left_out"] for name in each["ids"])
    assert not set(left_out) & set(TESTED)
    assert set(left_out.values()) == {1}
    assert len(left_out) + len(TESTED) == LEFT_OUT["total"]


@pytest.mark.parametrize(
    ("point", "value", "data_type"),
    [
        (Point("a", Area.HOLDING, 0, "uint16"), 65535, DataType.UINT16),
        (Point("a", Area.HOLDING, 0, "uint8", bits=(8, 15)), 255, DataType.UINT8),
        (Point("a", Area.HOLDING, 0, "int8", bits=(0, 7)), -128, DataType.INT8),
        (Point("a", Area.HOLDING, 0, "bcd16"), 9999, DataType.UINT16),
        (Point("a", Area.HOLDING, 0, "bcd32", count=2), 99999999, DataType.INT64),
        (Point("a", Area.HOLDING, 0, "uint32", count=2), 2**32 - 1, DataType.INT64),
        (Point("a", Area.HOLDING, 0, bits=(3, 3)), 1, DataType.BOOLEAN),
        (Point("a", Area.HOLDING, 0, bits=(3, 3), labels={0: "off", 1: "on"}), "on", DataType.STRING),
        (Point("a", Area.HOLDING, 0, bits=(4, 6)), 7, DataType.UINT16),
        (Point("a", Area.HOLDING, 0, "uint64", count=4, bits=(0, 39)), 2**40 - 1, DataType.UINT64),
        (Point("a", Area.HOLDING, 0, offset=-40.0), -40, DataType.DOUBLE),
        (Point("a", Area.HOLDING, 0, scale=0.1), 0.5, DataType.DOUBLE),
        (Point("a", Area.HOLDING, 0, scale_at=7), 1200, DataType.DOUBLE),
    ],
    ids=lambda value: getattr(value, "type", str(value)),
)
@pytest.mark.parametrize("is_known", [True, False])
def test_each_point_has_a_type_that_holds_its_values_and_says_when_it_has_none(point, value, data_type, is_known):
    device = PublishedDevice("d", 1, "Any", (PublishedPoint(point, 1.0),))
    node = Sparkplug("plant", "gw", (device,))
    node.will(AT)
    readings = {"a": Reading(value if is_known else None, AT - 1)}
    birth = list(node.born([DeviceState(device, is_available=True, readings=readings)], AT))[1]
    (data,) = node.values(device, readings, {"a"}, AT)
    for message in (birth, data):
        metric = metrics(message)["a"]
        shown = metric.value if not isinstance(metric.value, int) else signed(metric.value, data_type)
        assert (shown, metric.data_type) == (value if is_known else None, data_type)
        assert (bytes((0x38, 1)) in message.payload) is not is_known, "the field is_null"


def test_every_type_of_a_point_has_one_in_sparkplug():
    for data_type in (each for each in get_args(datatypes.DataType) if each != "bit"):
        count, bits = datatypes.registers_of(data_type), (0, 7) if data_type in datatypes.BYTE_TYPES else None
        point = Point("a", Area.INPUT, 0, data_type, count=count, bits=bits)
        device = PublishedDevice("d", 1, "Any", (PublishedPoint(point, 1.0),))
        node = Sparkplug("plant", "gw", (device,))
        node.will(AT)
        birth = list(node.born([DeviceState(device, is_available=True)], AT))[1]
        assert metrics(birth)["a"].data_type is not None


# Deaths of the node


@tck(
    "topics-ndeath-topic",
    "topics-ndeath-payload",
    "topics-ndeath-seq",
    "message-flow-edge-node-birth-publish-will-message",
    "message-flow-edge-node-birth-publish-will-message-topic",
    "message-flow-edge-node-birth-publish-will-message-payload",
    "message-flow-edge-node-birth-publish-will-message-qos",
    "message-flow-edge-node-birth-publish-will-message-will-retained",
    "payloads-ndeath-seq",
    "payloads-ndeath-will-message",
    "payloads-ndeath-will-message-qos",
    "payloads-ndeath-will-message-retain",
)
def test_the_will_is_the_death_of_the_node():
    will = Sparkplug("plant", "gw", (SCALE, DRIVE)).will(AT)
    assert (will.topic, will.qos, will.retain) == ("spBv1.0/plant/NDEATH/gw", 1, False)
    assert decode(will.payload) == Payload((Metric("bdSeq", 0, DataType.INT64, AT),), AT, None)


@tck(
    "topics-nbirth-bdseq-included",
    "topics-nbirth-bdseq-matching",
    "topics-nbirth-bdseq-increment",
    "message-flow-edge-node-birth-publish-will-message-payload-bdSeq",
    "message-flow-edge-node-birth-publish-nbirth-payload-bdSeq",
    "payloads-nbirth-bdseq",
    "payloads-nbirth-bdseq-repeat",
    "payloads-ndeath-bdseq",
)
def test_birth_and_death_have_the_number_of_their_connection():
    node = Sparkplug("plant", "gw", (SCALE, DRIVE))
    numbers = []
    for _ in range(258):
        will = node.will(AT)
        birth, *_ = node.born((), AT)
        assert metrics(will)["bdSeq"] == metrics(birth)["bdSeq"]
        assert metrics(birth)["bdSeq"].data_type is DataType.INT64
        numbers.append(metrics(will)["bdSeq"].value)
    assert numbers == [*range(256), 0, 1]


@tck(
    "operational-behavior-edge-node-intentional-disconnect-ndeath",
    "payloads-ndeath-will-message-publisher",
    "payloads-ndeath-will-message-publisher-disconnect-mqtt311",
)
def test_a_node_that_leaves_says_so():
    node = connected()
    will = node.will(AT)
    list(node.born(STATES, AT))
    (death,) = node.ended(AT)
    assert (death.topic, metrics(death)) == (will.topic, metrics(will))


@tck("payloads-ndeath-will-message-publisher-disconnect-mqtt50")
def test_with_mqtt_5_the_will_goes_out_too():
    assert Sparkplug.leaves_with_will


# Births


@tck(
    "principles-birth-certificates-order",
    "topic-structure",
    "topic-structure-namespace-a",
    "topics-nbirth-topic",
    "topics-nbirth-mqtt",
    "topics-nbirth-seq-num",
    "topics-nbirth-timestamp",
    "topics-nbirth-metric-reqs",
    "topics-nbirth-metrics",
    "topics-nbirth-rebirth-metric",
    "message-flow-edge-node-birth-publish-nbirth-topic",
    "message-flow-edge-node-birth-publish-nbirth-payload",
    "message-flow-edge-node-birth-publish-nbirth-qos",
    "message-flow-edge-node-birth-publish-nbirth-retained",
    "message-flow-edge-node-birth-publish-nbirth-payload-seq",
    "operational-behavior-data-publish-nbirth",
    "operational-behavior-data-publish-nbirth-values",
    "operational-behavior-data-publish-nbirth-order",
    "operational-behavior-data-commands-rebirth-name",
    "operational-behavior-data-commands-rebirth-name-aliases",
    "operational-behavior-data-commands-rebirth-datatype",
    "operational-behavior-data-commands-rebirth-value",
    "payloads-nbirth-timestamp",
    "payloads-nbirth-seq",
    "payloads-nbirth-rebirth-req",
    "payloads-nbirth-qos",
    "payloads-nbirth-retain",
    "payloads-sequence-num-req-nbirth",
)
def test_the_node_is_born_first():
    birth, *_ = connected().born(STATES, AT)
    assert (birth.topic, birth.qos, birth.retain) == ("spBv1.0/plant/NBIRTH/gw", 0, False)
    assert decode(birth.payload) == Payload(
        (
            Metric("bdSeq", 0, DataType.INT64, AT),
            Metric("Node Control/Rebirth", value=False, data_type=DataType.BOOLEAN, at=AT),
        ),
        AT,
        0,
    )


@tck(
    "topic-structure-namespace-device-id-associated-message-types",
    "topic-structure-namespace-device-id-non-associated-message-types",
    "topics-dbirth-topic",
    "topics-dbirth-mqtt",
    "topics-dbirth-seq",
    "topics-dbirth-timestamp",
    "message-flow-device-birth-publish-nbirth-wait",
    "message-flow-device-birth-publish-dbirth-topic",
    "message-flow-device-birth-publish-dbirth-match-edge-node-topic",
    "message-flow-device-birth-publish-dbirth-payload",
    "message-flow-device-birth-publish-dbirth-qos",
    "message-flow-device-birth-publish-dbirth-retained",
    "message-flow-device-birth-publish-dbirth-payload-seq",
    "payloads-dbirth-timestamp",
    "payloads-dbirth-seq",
    "payloads-dbirth-order",
    "payloads-dbirth-qos",
    "payloads-dbirth-retain",
)
def test_devices_are_born_after_their_node():
    _, *births = connected().born(STATES, AT)
    assert [each.topic for each in births] == ["spBv1.0/plant/DBIRTH/gw/silo-1", "spBv1.0/plant/DBIRTH/gw/drive-1"]
    assert {(each.qos, each.retain) for each in births} == {(0, False)}
    assert [decode(each.payload).seq for each in births] == [1, 2]
    assert {decode(each.payload).at for each in births} == {AT}


@tck(
    "topics-dbirth-metric-reqs",
    "topics-dbirth-metrics",
    "operational-behavior-data-publish-dbirth",
    "operational-behavior-data-publish-dbirth-values",
    "payloads-name-requirement",
    "payloads-metric-datatype-value-type",
    "payloads-metric-datatype-value",
    "payloads-metric-datatype-req",
)
def test_the_birth_of_a_device_has_all_of_its_points():
    *_, birth = connected().born(STATES, AT)
    told = metrics(birth)
    assert {name: (each.data_type, each.value) for name, each in told.items()} == {
        "speed": (DataType.INT16, 2**32 - 5),
        "ramp": (DataType.DOUBLE, None),
        "mode": (DataType.STRING, None),
        "run": (DataType.BOOLEAN, True),
        "gain": (DataType.FLOAT, None),
        "hours": (DataType.INT64, None),
    }


@tck("payloads-timestamp-in-UTC", "payloads-metric-timestamp-in-UTC", "payloads-name-birth-data-requirement")
def test_each_metric_has_the_time_when_its_device_answered():
    _, birth, _ = connected().born(STATES, AT)
    assert {name: each.at for name, each in metrics(birth).items()} == {"weight": AT - 1, "state": AT - 2}


@tck("operational-behavior-data-publish-dbirth-order")
def test_metrics_are_in_the_order_of_their_times():
    node = connected()
    _, birth, _ = node.born(STATES, AT)
    (data,) = node.values(SCALE, WEIGHED, {"weight", "state"}, AT)
    for message in (birth, data):
        assert [metric.name for metric in decode(message.payload).metrics] == ["state", "weight"]


@tck(
    "payloads-propertyset-keys-array-size",
    "payloads-propertyset-values-array-size",
    "payloads-metric-propertyvalue-type-type",
    "payloads-metric-propertyvalue-type-value",
    "payloads-metric-propertyvalue-type-req",
)
def test_the_unit_is_a_property_of_the_birth():
    _, birth, _ = connected().born(STATES, AT)
    key, value = b"\x0a\x07engUnit", b"\x12\x06\x08\x0c\x42\x02kg"
    assert key + value in birth.payload
    assert birth.payload.count(b"engUnit") == 1


def test_a_device_that_does_not_answer_is_not_born():
    messages = [*connected().born([replace(STATES[0], is_available=False, readings={}), STATES[1]], AT)]
    assert [each.topic.split("/")[2] for each in messages] == ["NBIRTH", "DBIRTH"]


def test_a_number_without_label_is_text_too():
    node = born()
    (data,) = node.values(SCALE, {"state": Reading(5, AT)}, {"state"}, AT)
    assert metrics(data)["state"].value == "5"


# Data


@tck(
    "principles-rbe-recommended",
    "topics-ddata-topic",
    "topics-ddata-mqtt",
    "topics-ddata-timestamp",
    "topics-ddata-payload",
    "operational-behavior-data-publish-dbirth-change",
    "payloads-ddata-timestamp",
    "payloads-ddata-qos",
    "payloads-ddata-retain",
)
def test_data_has_what_has_changed():
    node = born()
    (data,) = node.values(SCALE, WEIGHED, {"weight"}, AT + 1)
    assert (data.topic, data.qos, data.retain) == ("spBv1.0/plant/DDATA/gw/silo-1", 0, False)
    assert decode(data.payload) == Payload((Metric("weight", 4999.66, DataType.FLOAT, AT - 1),), AT + 1, 3)


def test_what_is_not_known_any_more_is_null():
    node = born()
    (data,) = node.values(SCALE, {"state": WEIGHED["state"]}, {"weight"}, AT + 1)
    [metric] = decode(data.payload).metrics
    assert (metric.name, metric.value, metric.at) == ("weight", None, AT + 1)


@tck(
    "topics-ddata-seq-num",
    "topics-ddeath-seq-num",
    "payloads-sequence-num-always-included",
    "payloads-sequence-num-incrementing",
    "payloads-dbirth-seq-inc",
    "payloads-ddata-seq",
    "payloads-ddata-seq-inc",
    "payloads-ddeath-seq",
    "payloads-ddeath-seq-inc",
    "payloads-ddeath-seq-number",
)
def test_messages_are_numbered_from_0_to_255_and_again():
    node = connected()
    messages = [*node.born(STATES, AT)]
    for _ in range(100):
        messages += node.values(SCALE, WEIGHED, {"weight"}, AT)
        messages += node.availability(replace(STATES[1], is_available=False), AT)
        messages += node.availability(STATES[1], AT)
    assert [decode(each.payload).seq for each in messages] == [number % 256 for number in range(303)]


@tck("payloads-ddata-order")
def test_a_device_that_is_not_born_has_no_data():
    node = connected()
    list(node.born([replace(STATES[0], is_available=False, readings={})], AT))
    assert node.values(SCALE, WEIGHED, {"weight"}, AT) == []


# Deaths of devices


@tck(
    "topics-ddeath-topic",
    "topics-ddeath-mqtt",
    "operational-behavior-device-ddeath",
    "payloads-ddeath-timestamp",
)
def test_a_device_that_stops_answering_dies():
    node = born()
    (death,) = node.availability(replace(STATES[0], is_available=False), AT + 1)
    assert (death.topic, death.qos, death.retain) == ("spBv1.0/plant/DDEATH/gw/silo-1", 0, False)
    assert decode(death.payload) == Payload((), AT + 1, 3)
    assert node.values(SCALE, WEIGHED, {"weight"}, AT) == []
    assert node.availability(replace(STATES[0], is_available=False), AT + 2) == []


def test_a_device_that_answers_again_is_born_again():
    node = born()
    node.availability(replace(STATES[0], is_available=False), AT)
    (birth,) = node.availability(STATES[0], AT)
    assert birth.topic == "spBv1.0/plant/DBIRTH/gw/silo-1"
    assert set(metrics(birth)) == {"weight", "state"}
    assert len(node.values(SCALE, WEIGHED, {"weight"}, AT)) == 1


# Commands


@tck("message-flow-edge-node-ncmd-subscribe", "message-flow-device-dcmd-subscribe")
def test_commands_are_subscribed_to():
    node = connected()  # and not born yet
    assert node.early_subscriptions() == ["spBv1.0/plant/NCMD/gw"]
    assert node.command_subscriptions() == ["spBv1.0/plant/DCMD/gw/drive-1"]


@tck(
    "operational-behavior-data-commands-rebirth-action-1",
    "operational-behavior-data-commands-rebirth-action-2",
    "operational-behavior-data-commands-rebirth-action-3",
)
def test_a_rebirth_is_a_whole_birth_of_the_same_session():
    node = connected()
    first = list(node.born(STATES, AT))
    node.values(SCALE, WEIGHED, {"weight"}, AT)
    assert wants_rebirth(node) == [Rebirth()]
    assert list(node.born(STATES, AT)) == first


def test_a_rebirth_that_is_not_wanted_is_none():
    assert wants_rebirth(born(), value=False) == []
    assert told(born(), "spBv1.0/plant/NCMD/gw", Metric("Node Control/Reboot", value=True, data_type=None)) == []


@pytest.mark.parametrize(
    ("metric", "text"),
    [
        (Metric("speed", -7, DataType.INT16), "-7"),
        (Metric("ramp", 2.5, DataType.DOUBLE), "2.5"),
        (Metric("ramp", 0.1, DataType.FLOAT), "0.1"),
        (Metric("mode", "auto", DataType.STRING), "auto"),
        (Metric("run", value=True, data_type=DataType.BOOLEAN), "1"),
        (Metric("run", value=False, data_type=DataType.BOOLEAN), "0"),
        (Metric("gain", 1.2, DataType.FLOAT), "1.2"),
    ],
)
def test_a_command_has_its_value_as_a_user_would_type_it(metric, text):
    node = born()
    (typed,) = wants(node, metric)
    (untyped,) = node.received(Delivery("spBv1.0/plant/DCMD/gw/drive-1", without_type(metric), AT))
    for command in (typed, untyped):
        assert isinstance(command, Command)
        assert (command.device, command.point.name, command.text, command.refusal) == (DRIVE, metric.name, text, "")


def test_a_message_may_have_several_commands():
    commands = wants(born(), Metric("speed", 1, DataType.INT16), Metric("run", value=True, data_type=DataType.BOOLEAN))
    assert [(each.point.name, each.text) for each in commands] == [("speed", "1"), ("run", "1")]


def test_a_point_that_must_not_be_written_is_refused():
    (command,) = wants(born(), Metric("hours", 1, DataType.UINT32))
    assert command.refusal


def test_a_command_without_value_is_refused():
    (command,) = wants(born(), Metric("speed", None, DataType.INT16))
    assert command.refusal


@pytest.mark.parametrize("flag", ["is_retained", "is_duplicate"])
def test_a_command_that_may_be_old_is_refused(flag):
    (command,) = wants(born(), Metric("speed", 1, DataType.INT16), **{flag: True})
    assert command.refusal


def test_a_value_of_earlier_is_no_command():
    (command,) = wants(born(), Metric("speed", 1, DataType.INT16, AT, is_historical=True))
    assert command.refusal


def test_what_nobody_has_is_ignored():
    assert wants(born(), Metric("other", 1, DataType.INT16)) == []
    assert wants(born(), Metric("speed", 1, DataType.INT16), device="silo-1") == []
    assert wants(born(), Metric("speed", 1, DataType.INT16), device="other") == []
    assert born().received(Delivery("spBv1.0/plant/DCMD/gw/drive-1", b"\xff", AT)) == []


# The primary host


@tck(
    "message-flow-edge-node-birth-publish-phid-wait",
    "message-flow-edge-node-birth-publish-phid-wait-id",
    "message-flow-edge-node-birth-publish-phid-wait-online",
    "operational-behavior-edge-node-birth-sequence-wait",
)
def test_a_node_waits_for_its_primary_host():
    node = connected("scada")
    assert node.early_subscriptions() == ["spBv1.0/STATE/scada", "spBv1.0/plant/NCMD/gw"]
    assert node.is_held
    assert state_of_host(node, online=True, timestamp=1, host="other") == []
    assert state_of_host(node, online=False, timestamp=1) == []
    assert wants_rebirth(node) == []
    assert node.is_held
    assert state_of_host(node, online=True, timestamp=2) == [Rebirth()]
    assert not node.is_held


@tck("message-flow-edge-node-birth-publish-phid-wait-timestamp")
def test_an_older_state_does_not_count():
    node = connected("scada")
    state_of_host(node, online=False, timestamp=10)
    assert state_of_host(node, online=True, timestamp=9) == []
    assert node.is_held
    assert state_of_host(node, online=True, timestamp=10) == [Rebirth()]


@tck("message-flow-edge-node-birth-publish-phid-offline", "operational-behavior-edge-node-termination-host-offline")
def test_a_node_leaves_when_its_primary_host_does():
    node = connected("scada")
    state_of_host(node, online=True, timestamp=10)
    list(node.born(STATES, AT))
    assert state_of_host(node, online=False, timestamp=10) == [Leave()]
    (death,) = node.ended(AT)
    assert death.topic == "spBv1.0/plant/NDEATH/gw"
    node.will(AT)
    assert node.is_held


@tck("operational-behavior-edge-node-termination-host-offline-timestamp")
def test_a_node_stays_when_its_primary_host_was_offline_earlier():
    node = connected("scada")
    state_of_host(node, online=True, timestamp=10)
    assert state_of_host(node, online=False, timestamp=9) == []
    assert not node.is_held


def test_a_new_connection_waits_for_the_primary_host_again():
    node = connected("scada")
    state_of_host(node, online=True, timestamp=10)
    node.will(AT)
    assert node.is_held
    assert node.ended(AT) == []
    assert state_of_host(node, online=True, timestamp=10) == [Rebirth()]


def test_a_host_whose_clock_was_set_back_counts_in_the_next_connection():
    node = connected("scada")
    state_of_host(node, online=True, timestamp=10)
    node.will(AT)
    assert state_of_host(node, online=True, timestamp=9) == [Rebirth()]


def test_a_host_that_says_again_that_it_is_online_changes_nothing():
    node = connected("scada")
    state_of_host(node, online=True, timestamp=10)
    assert state_of_host(node, online=True, timestamp=11) == []


@pytest.mark.parametrize(
    "payload", [b"ONLINE", b"[]", b"{}", b'{"online":1,"timestamp":1}', b'{"online":true}', b"\xff", b"[" * 100_000]
)
def test_what_is_no_state_is_ignored(payload):
    node = connected("scada")
    assert node.received(Delivery("spBv1.0/STATE/scada", payload, AT)) == []
    assert node.is_held


def test_a_large_command_is_not_even_read():
    node = born()
    payload = encode(
        Payload((Metric("Node Control/Rebirth", value=True, data_type=DataType.BOOLEAN),)), with_units=True
    )
    assert node.received(Delivery("spBv1.0/plant/NCMD/gw", payload, AT)) == [Rebirth()]
    assert node.received(Delivery("spBv1.0/plant/NCMD/gw", payload + bytes((8, 0)) * 8192, AT)) == []


@pytest.mark.parametrize(
    ("options", "fits", "others"),
    [
        ({"type": "uint16"}, [0, 65535, None], [1.5, -1, 65536, "on", 2**70, 10**400]),
        ({"type": "int32"}, [7, 2**31 - 1], [2**31, 0.5, "on"]),
        ({"type": "float32"}, [1.5, 7], [1e39, -(10**400), "on"]),
        ({"type": "uint16", "scale": 0.1}, [1.5, 1e300], [10**400, "on"]),
        ({"type": "string"}, ["on", ""], [1, 1.5]),
    ],
)
def test_history_leaves_out_what_was_kept_under_another_type_of_the_point(options, fits, others):
    device = PublishedDevice("d", 1, "p", (PublishedPoint(Point("p", "holding", 0, **options), 1.0),))
    form = Sparkplug("g", "n", (device,))
    records = [Record(1_800_000_000.0, {"p": value}) for value in (*others, *fits)]
    message = form.history("d", records, 0.0)
    assert [metric.value for metric in decode(message.payload).metrics] == fits
    assert form.history("d", records[: len(others)], 0.0) is None
