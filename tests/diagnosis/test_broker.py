from dataclasses import replace

from gateway.diagnosis.broker import BrokerEvidence, about_broker
from gateway.diagnosis.fleet import FleetEvidence, about_fleet
from gateway.diagnosis.last import Last

FINE = BrokerEvidence("mqtt://broker:1883", "gateway.toml:9", "", devices=3, available=2, refused=0)


def found(**other):
    [finding] = about_broker(replace(FINE, **other))
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
    assert found(refused=4) == (
        "fix",
        "has refused 4 messages",
        "give the user of the gateway the right to publish there",
    )


def test_refusals_of_long_ago_are_a_note():
    assert found(refused=4, last_refused=Last(720.0))[:2] == ("note", "has refused 4 messages, the last one 12 min ago")


def test_requests_under_a_wrong_name_of_long_ago_are_a_note():
    fleet = FleetEvidence("nats://nats:4222", "gateway.toml:9", "", "", dropped=4)
    assert [each.level for each in about_fleet(fleet)] == ["ok", "fix"]
    _, row = about_fleet(replace(fleet, last_dropped=Last(720.0)))
    assert row.level == "note"
    assert row.what.endswith("or for its answers, the last one 12 min ago; none was carried out")
