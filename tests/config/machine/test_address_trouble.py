"""What can be seen of an address without listening there."""

import pytest

from gateway.config.machine.troubles import address_trouble


@pytest.mark.parametrize("host", ["0.0.0.0", "127.0.0.1"])
def test_an_address_of_this_machine_is_no_trouble(host):
    assert address_trouble(host) is None


@pytest.mark.parametrize("host", ["192.0.2.1", "2001:db8::1"])
def test_an_address_of_another_machine(host):
    """Those are addresses for documents, which nobody has (RFC 5737, RFC 3849)."""
    assert address_trouble(host) == f"this machine has no address {host} at the moment"


def test_a_name_is_not_looked_up():
    assert address_trouble("no-such-host.invalid") is None


@pytest.mark.parametrize("host", ["fe80::1%no-such-link", "::1%no-such-link"])
def test_a_network_interface_that_is_not_there(host):
    assert address_trouble(host) == "this machine has no network interface no-such-link at the moment"
