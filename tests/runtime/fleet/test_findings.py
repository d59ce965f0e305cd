from dataclasses import replace

from gateway.fleet.status import FleetStatus
from gateway.runtime.fleet.findings import findings_about

DROPPED = FleetStatus("nats://nats:4222", "gateway.toml:9", "a", "up", "", "", None, 1, 0, 0, 0, 0, 0, 4, 0, 0)


def test_requests_under_a_wrong_name_of_long_ago_are_a_note():
    assert [each.level for each in findings_about(DROPPED)] == ["ok", "fix"]
    _, row = findings_about(replace(DROPPED, last_dropped_ms=720_000.0))
    assert row.level == "note"
    assert row.what.endswith("or for its answers, the last one 12 min ago; none was carried out")
