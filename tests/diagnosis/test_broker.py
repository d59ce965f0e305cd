from dataclasses import replace

from gateway.diagnosis.broker import BrokerEvidence, about_broker

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
    assert found(refused=4) == (
        "fix",
        "has refused 4 messages",
        "give the user of the gateway the right to publish there",
    )
