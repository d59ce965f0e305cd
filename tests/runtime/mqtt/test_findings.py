from dataclasses import replace

from gateway.plant.status import BrokerStatus, KeptStatus
from gateway.runtime.mqtt.findings import findings_about
from gateway.runtime.mqtt.metrics import metrics_of

FINE = BrokerStatus("mqtt://broker:1883", "gateway.toml:9", "up", "", None, "5", 1, 3, 2, 3, 9, 0, 0, 0, 0, 0)


KEPT = KeptStatus(0, None, None, 8192, 64 * 2**20, None, 0, None, "")
WAITS = replace(KEPT, values=12340, since="2026-05-01T10:05:00Z", age_ms=1_200_000.0, bytes=3 * 2**20)


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


def about_kept(kept, **other):
    _, *findings = findings_about(replace(FINE, kept=kept, **other))
    return [(finding.level, finding.what) for finding in findings]


AWAY = {"reason": "no network", "down_ms": 1_200_000.0, "state": "down"}


def test_a_broker_that_is_away_while_nothing_is_kept_is_a_note():
    [(level, what)] = about_kept(None, **AWAY)
    assert level == "note"
    assert what == "nothing is kept while it is away: of each point only the last value will be published"


def test_what_waits_is_said_with_its_age_and_what_it_takes():
    what = "12340 values of the last 20 min (3.0/64 MiB) wait to be sent"
    assert about_kept(WAITS, **AWAY) == [("note", what)]
    assert about_kept(WAITS) == [("ok", what)], "they are being sent"
    assert about_kept(KEPT) == []


def test_values_that_were_given_up_are_to_be_seen_to_and_later_a_note():
    what = "7 kept values were given up and will never be sent"
    assert about_kept(replace(KEPT, given_up=7, given_up_ms=0.0)) == [("fix", what)]
    long_ago = about_kept(replace(KEPT, given_up=7, given_up_ms=7_200_000.0))
    assert long_ago == [("note", f"{what}, the last one 2 h ago")]


def test_room_that_is_soon_used_up_is_to_be_seen_to():
    assert about_kept(replace(WAITS, full_in_ms=7_200_000.0), **AWAY)[1:] == []
    (soon,) = about_kept(replace(WAITS, full_in_ms=1_800_000.0), **AWAY)[1:]
    assert soon == ("fix", "the room for kept values lasts for 30 min more; then the oldest are given up")
    (now,) = about_kept(replace(WAITS, full_in_ms=0.0), **AWAY)[1:]
    assert now == ("fix", "the room for kept values is used up: the oldest are given up")
    assert about_kept(replace(WAITS, full_in_ms=0.0))[1:] == [], "it is being emptied"


def test_a_disk_that_fails_is_to_be_seen_to():
    (trouble,) = about_kept(replace(KEPT, trouble="disk full"))
    assert trouble == ("fix", "values are kept in memory only, and the last ones alone: disk full")


def metrics(kept):
    known = [each.name for each in metrics_of(FINE)]
    return {each.name: each.values for each in metrics_of(replace(FINE, kept=kept)) if each.name not in known}


def test_metrics_tell_what_waits_and_no_age_of_nothing():
    assert metrics(None) == {}
    assert metrics(replace(WAITS, given_up=7)) == {
        "mqtt_kept_values": [((), 12340)],
        "mqtt_kept_bytes": [((), 3 * 2**20)],
        "mqtt_kept_limit_bytes": [((), 64 * 2**20)],
        "mqtt_kept_since_seconds": [((), 1200.0)],
        "mqtt_given_up_values": [((), 7)],
    }
    assert metrics(KEPT)["mqtt_kept_since_seconds"] == []
