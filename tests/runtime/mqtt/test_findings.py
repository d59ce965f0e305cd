from dataclasses import replace

from gateway.plant.status import BrokerStatus
from gateway.runtime.mqtt.findings import findings_about

FINE = BrokerStatus("mqtt://broker:1883", "gateway.toml:9", "up", "", None, "5", 1, 3, 2, 3, 9, 0, 0, 0, 0, 0)


def found(**other):
    [finding] = findings_about(replace(FINE, **other))
    return finding.level, finding.what, finding.remedy


def test_what_is_said_of_a_broker():
    assert found() == ("ok", "takes the values of 2 of 3 devices", "")
    assert found(reason="it refuses user and password") == (
        "fix",
        "nothing is published: it refuses user and password",
        "see [mqtt] in gateway.toml:9",
    )
    assert found(unsteady="the connection was lost 3 times") == (
        "fix",
        "the connection was lost 3 times",
        "see [mqtt] in gateway.toml:9",
    )
    assert found(refused_messages=4) == (
        "fix",
        "has refused 4 messages",
        "give the user of the gateway the right to publish there",
    )


def test_a_broker_that_gets_nothing_because_no_device_answers_is_a_note():
    assert found(available=0)[:2] == ("note", "there is nothing to publish: no published device answers")


def test_refusals_of_long_ago_are_a_note():
    assert found(refused_messages=4, last_refused_ms=720_000.0)[:2] == (
        "note",
        "has refused 4 messages, the last one 12 min ago",
    )
