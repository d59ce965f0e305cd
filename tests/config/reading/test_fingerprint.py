"""Whether two sites have the same config."""

import re

import pytest

from gateway.config.reading.masking import fingerprint

CONFIG = """
site = "plant-7"            # the name
[[line]]
port = "/dev/ttyS1"
baud = 19200
lease = "plant-7.hall"
[fleet]
servers = ["nats://hub"]
credentials = "/etc/modbus-gateway/plant-7.creds"
"""


def test_sites_from_one_template_have_the_same():
    there = CONFIG.replace("plant-7", "north").replace("# the name", "# north, since May")
    assert fingerprint(there, "north") == fingerprint(CONFIG, "plant-7")
    assert re.fullmatch("[0-9a-f]{12}", fingerprint(CONFIG, "plant-7"))


@pytest.mark.parametrize(
    ("one", "other"), [("19200", "9600"), ("/dev/ttyS1", "/dev/ttyS2"), ('"plant-7.hall"', '"plant-77.hall"')]
)
def test_any_other_difference_is_one(one, other):
    assert fingerprint(CONFIG.replace(one, other), "plant-7") != fingerprint(CONFIG, "plant-7")


def test_the_name_of_another_site_stays():
    text = 'site = "plant-7"\n[[listen]]\nbind = "tcp://[::]"\nsite = "{}"\n'
    assert fingerprint(text.format("plant-70"), "plant-7") != fingerprint(text.format("plant-71"), "plant-7")


def test_a_secret_leaves_no_trace():
    text = 'site = "a"\n[[image]]\nunit = 1\noptions = {{ password = "{}" }}\n'
    assert fingerprint(text.format("x"), "a") == fingerprint(text.format("y"), "a")


def test_a_config_without_text_has_none():
    assert fingerprint("", "a") == ""
