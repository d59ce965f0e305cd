"""What counts as one address."""

import pytest

from gateway.listeners.share_keys import KEPT, MOST_READ, ShareKeys, read_routes
from kit.ipv6 import needs_ipv6

#: As the system shows them: a link, what is reached through a router, a tunnel for everything, an address of our own.
LINK = "20010db8000000010000000000000000 40 {0} 00 {0} 00000100 00000001 00000000 00000001 eth0"
SITE_LINK = "fd123456789a00000000000000000000 30 {0} 00 {0} 00000100 00000001 00000000 00000001 eth1"
ROUTED = "20010db8000200000000000000000000 30 {0} 00 fe800000000000000000000000000001 400 1 0 00000003 eth0"
TUNNEL = "20000000000000000000000000000000 03 {0} 00 {0} 00000400 00000001 00000000 00000001 wg0"
OURS = "20010db8000300000000000000000000 40 {0} 00 {0} 00000000 00000004 00000000 80200001 lo"
ROUTES = f"{LINK}\n{SITE_LINK}\n{ROUTED}\n{TUNNEL}\n{OURS}\n20010d".format("0" * 32)


@pytest.mark.parametrize(
    ("host", "origin"),
    [
        ("10.0.0.7", "10.0.0.7"),
        ("", ""),
        ("::1", "::1"),
        ("2001:db8:0:1::7", "2001:db8:0:1::7"),
        ("fd12:3456:789a:5::7", "fd12:3456:789a:5::7"),
        ("2001:db8:2:3:4:5:6:7", "2001:db8:2:3::/64"),
        ("2001:db8:2:3::1", "2001:db8:2:3::/64"),
        ("2001:db8:2:4::1", "2001:db8:2:4::/64"),
        ("2001:db8:3::1", "2001:db8:3::/64"),
        ("fe80::1%eth0", "fe80::/64"),
    ],
)
def test_an_ipv6_network_counts_as_one_address_unless_it_is_a_link_of_ours(host: str, origin: str) -> None:
    assert ShareKeys(lambda: ROUTES).of(host, 0.0) == origin


def test_routes_that_change_are_seen_after_a_while() -> None:
    routes = [""]
    origins = ShareKeys(lambda: routes[0])
    assert origins.of("2001:db8:0:1::7", 100.0) == "2001:db8:0:1::/64"
    routes[0] = ROUTES
    assert origins.of("2001:db8:0:1::7", 100.0 + KEPT - 0.1) == "2001:db8:0:1::/64"
    assert origins.of("2001:db8:0:1::7", 100.0 + KEPT) == "2001:db8:0:1::7"


def test_where_there_is_no_ipv6_there_are_no_routes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.listeners.share_keys.ROUTES", "/nowhere")
    assert read_routes() == ""


@needs_ipv6
def test_the_routes_of_this_machine_can_be_read() -> None:
    routes = read_routes()
    assert len(routes) <= MOST_READ
    assert all(len(line.split()) == 10 for line in routes.splitlines()[:-1])
    assert ShareKeys().of("2001:db8:ffff::1", 0.0) == "2001:db8:ffff::/64"
