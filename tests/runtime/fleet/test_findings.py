from dataclasses import replace

import pytest

from gateway.fleet.status import FleetStatus
from gateway.runtime.fleet.findings import findings_about

DROPPED = FleetStatus("nats://nats:4222", "gateway.toml:9", "a", "up", "", "", None, 1, 0, 0, 0, 0, 0, 4, 0, 0)


def test_requests_under_a_wrong_name_of_long_ago_are_a_note():
    assert [each.level for each in findings_about(DROPPED)] == ["ok", "fix"]
    _, row = findings_about(replace(DROPPED, last_dropped_ms=720_000.0))
    assert row.level == "note"
    assert row.what.endswith("or for its answers, the last one 12 min ago; none was carried out")


@pytest.mark.parametrize(
    ("version", "is_old"),
    [("2.9.10", True), ("2.9.14", True), ("2.9.15", False), ("2.15.1", False), ("", False), ("2.9.10-beta", False)],
)
def test_a_hub_that_any_site_can_end_is_a_note(version, is_old):
    found = [*findings_about(replace(DROPPED, dropped=0, server_version=version))]
    assert [each.level for each in found] == (["ok", "note"] if is_old else ["ok"])
    assert not is_old or version in found[1].what
