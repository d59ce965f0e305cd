"""Clients that leave before they have their responses."""

from gateway.listeners.departures import MOST_HOSTS, Departures


def test_each_address_has_its_count_and_how_long_it_waited_last() -> None:
    departures = Departures()
    for host, waited in (("a", 0.5), ("b", 2.0), ("a", 0.6)):
        departures.add(host, waited, 0.0)
    assert {host: (each.count, each.waited) for host, each in departures.by_host.items()} == {
        "a": (2, 0.6),
        "b": (1, 2.0),
    }


def test_those_are_forgotten_that_have_not_done_it_for_longest() -> None:
    departures = Departures()
    departures.add("often", 1.0, 0.0)
    for number in range(MOST_HOSTS):
        departures.add(f"host-{number}", 1.0, 0.0)
        departures.add("often", 1.0, 0.0)
    assert len(departures.by_host) == MOST_HOSTS
    assert departures.by_host["often"].count == MOST_HOSTS + 1
    assert "host-0" not in departures.by_host
