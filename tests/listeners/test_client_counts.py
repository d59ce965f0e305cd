"""What is kept of clients that were rejected, or left before they had their responses."""

from gateway.listeners.client_counts import MOST_HOSTS, ClientCounts


def test_each_address_has_its_count_and_how_long_it_waited_last() -> None:
    counts = ClientCounts()
    for host, waited in (("a", 0.5), ("b", 2.0), ("a", 0.6)):
        counts.add_departure(host, waited, 0.0)
    assert {host: (each.count, each.waited) for host, each in counts.departures.items()} == {
        "a": (2, 0.6),
        "b": (1, 2.0),
    }


def test_each_address_has_its_rejections_and_why_it_was_rejected_last() -> None:
    counts = ClientCounts()
    for host, reason, now in (("a", "full", 1.0), ("b", "no right", 2.0), ("a", "idle", 3.0)):
        counts.add_rejection(host, reason, now)
    assert counts.rejected == 3
    assert [(host, each.count, each.at, each.reason) for host, each in counts.rejections.items()] == [
        ("b", 1, 2.0, "no right"),
        ("a", 2, 3.0, "idle"),
    ]


def test_of_too_many_addresses_those_are_forgotten_to_which_it_happened_the_longest_time_ago() -> None:
    counts = ClientCounts()
    for number in range(MOST_HOSTS + 1):
        for host in (f"host-{number}", "often"):
            counts.add_departure(host, 1.0, number)
            counts.add_rejection(host, "full", number)
    for by_host in (counts.departures, counts.rejections):
        assert len(by_host) == MOST_HOSTS
        assert by_host["often"].count == MOST_HOSTS + 1
        assert "host-0" not in by_host
    assert counts.rejected == 2 * (MOST_HOSTS + 1)
