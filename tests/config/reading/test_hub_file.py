"""The file of `fleet hub`: what is wrong with it is told, with its place and what to do."""

import pytest

from gateway.config.reading.hub_file import parse_hub_file

SITES = 'control = "control"\nsites = ["east", "north"]\n'


def told(text: str) -> list[str]:
    return [str(problem) for problem in parse_hub_file(text, "fleet.toml").problems]


def test_two_keys_are_enough():
    read = parse_hub_file(SITES, "fleet.toml")
    assert read.problems == ()
    assert read.hub is not None
    assert (read.hub.control, read.hub.sites) == (("control",), ("east", "north"))


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("control = \n", "1:11: error: invalid value"),
        ('sites = ["east"]', "1:1: error: control: control is missing"),
        ('control = "control"\nsites = []', "2:9: error: sites: names no site"),
        ('control = []\nsites = ["east"]', "1:11: error: control: names no site"),
        ('control = "a b"\nsites = ["east"]', '1:11: error: control: "a b" is not the name of a site'),
        ('control = "a"\nsites = ["e.1"]', '2:10: error: sites[0]: "e.1" is not the name of a site'),
        ('control = "a"\nsites = ["east", 5]', "2:18: error: sites[1]: must be text"),
        ('control = "a"\nsites = ["east", "east"]', "2:18: error: sites[1]: east is there twice"),
        ('control = "a"\nsites = ["east", "East"]', "2:18: error: sites[1]: East differs from east only in capitals"),
        ('control = ["a", "a"]\nsites = ["east"]', "1:11: error: control: a is there twice"),
        ('control = "a"\nsites = ["east", "a"]', "2:18: error: sites[1]: a is control too"),
        (f'{SITES}asks = {{ west = ["east"] }}', '3:10: error: asks.west: there is no site "west"'),
        (f'{SITES}asks = {{ east = ["west"] }}', '3:18: error: asks.east[0]: there is no site "west"'),
        (f'{SITES}asks = {{ east = ["east"] }}', "3:18: error: asks.east[0]: east needs no right to its own units"),
        (f'{SITES}asks = {{ control = ["east"] }}', "3:10: error: asks.control: control may ask all sites anyway"),
        (f'{SITES}asks = {{ east = ["north", "north"] }}', "3:27: error: asks.east[1]: north is there twice"),
        (f'{SITES}leases = ["hall"]', '3:11: error: leases[0]: "hall" does not say whose lease it is'),
        (f'{SITES}leases = ["west.hall"]', '3:11: error: leases[0]: there is no site "west"'),
        (f'{SITES}leases = ["east.a", "east.a"]', "3:21: error: leases[1]: east.a is there twice"),
        (f'{SITES}leaf_nodes = ["east"]', "3:14: error: leaf_nodes: leaf nodes need the address of the hub"),
        (
            'control = "control"\nsites = ["hub"]\naddress = "10.0.0.1"\nleaf_nodes = ["hub"]',
            "4:15: error: leaf_nodes[0]: hub is the name of the server itself",
        ),
        (f'{SITES}address = "hub"\nleaf_nodes = ["control"]', "4:15: error: leaf_nodes[0]: control makes the buckets"),
        (f'{SITES}address = "tls://hub"', "3:11: error: address: has a protocol"),
        (f'{SITES}address = "hub:0"', "3:11: error: address: port 0"),
        (f'{SITES}certificate = "/etc/nats/server.crt"', "3:15: error: certificate: has no effect without key"),
        (f'{SITES}ca = "/etc/ca.crt"', "3:6: error: ca: has no effect without certificate"),
        (f'{SITES}store = "nats"', "3:9: error: store: is not an absolute path"),
        (f'{SITES}site = "west"', "3:1: error: site: unknown key"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(text, problem):
    assert any(each.startswith(f"fleet.toml:{problem}") for each in told(text)), told(text)


def test_all_problems_are_told_each_with_what_to_do():
    found = told(f'{SITES}asks = {{ west = ["nort"] }}\nleases = ["estt.hall"]')
    assert [each.partition("help: ")[2] for each in found] == [
        'did you mean "east"?',
        'did you mean "north"?',
        'did you mean "east"?',
    ]
