"""What a lease needs, and how long it must be."""

import pytest

from gateway.config.load import parse

CONFIG = """
site = "plant-2"
[fleet]
servers = ["nats://127.0.0.1:4222"]
{fleet}
[[line]]
name    = "hall-a"
port    = "/dev/hall-a"
baud    = {baud}
lease   = "plant-2.hall-a"
devices = [{{ unit = 1 }}]
{more}
"""


def problems(*, fleet: str = "", baud: int = 19200, more: str = "") -> list[str]:
    text = CONFIG.format(fleet=fleet, baud=baud, more=more)
    return [str(each) for each in parse(text, port_trouble=lambda _: None, real_path=lambda port: port).problems]


def test_a_lease_of_five_seconds_is_long_enough_for_usual_lines():
    assert problems() == []


@pytest.mark.parametrize(("baud", "fleet", "enough"), [(1200, "", "9 s"), (19200, 'lease = "2 s"', "3 s")])
def test_a_lease_is_longer_than_the_transactions_on_its_line(baud, fleet, enough):
    (found,) = problems(baud=baud, fleet=fleet)
    assert "too long for a lease of" in found
    assert f'set lease = "{enough}" or longer in [fleet]' in found
    assert problems(baud=baud, fleet=f'lease = "{enough}"') == []


def test_hold_lets_two_ask_and_is_warned_of():
    (found,) = problems(fleet='fallback = "hold"')
    assert "warning: fleet.fallback: lets two gateways ask on one line while NATS cannot be reached" in found


def test_each_line_has_a_lease_of_its_own():
    more = '[[line]]\nname = "hall-b"\nport = "/dev/hall-b"\nlease = "plant-2.hall-a"\ndevices = [{ unit = 2 }]'
    (found,) = problems(more=more)
    assert '"plant-2.hall-a" is already used in' in found


@pytest.mark.parametrize("name", ["", "hall a", "a..b", ".a", "a.*", ">"])
def test_the_name_is_a_key_of_a_bucket(name):
    text = CONFIG.format(fleet="", baud=19200, more="").replace("plant-2.hall-a", name)
    (found,) = parse(text, port_trouble=lambda _: None, real_path=lambda port: port).problems
    assert "is not the name of a lease" in str(found)
