"""What an earlier run has left behind, and when it counts for nothing."""

import pytest

from gateway.config.load import parse
from gateway.config.plan.settings import Plan
from gateway.config.resolve import resolve
from gateway.events import AddressRemembered, BaudRemembered
from gateway.runtime.remembered import address_key, addresses, forget, in_force, rate, rate_key
from gateway.state.memory import Memory

HALL = """
[[line]]
name    = "hall-a"
port    = "/dev/hall-a"
baud    = 9600
devices = [
  { unit = 1, as = 41, name = "silo-1", profile = "weigher" },
  { unit = 2, as = 42, name = "silo-2", profile = "weigher" },
]
"""


def plan(config: str = HALL) -> Plan:
    loaded = parse(config, port_trouble=lambda _: None, real_path=str)
    assert loaded.config is not None
    return resolve(loaded.config)


def left_behind(*moves: tuple[str | int, ...], baud: int = 9600) -> Memory:
    """Devices of HALL that have moved, by name, and the rate that its line has changed to."""
    memory, (line,) = Memory("/var/lib/x/addresses.json"), plan().lines
    devices = {device.name: device for device in line.devices}
    for name, *values in moves:
        memory.remember(address_key(line, devices[name]), *values)
    memory.remember(rate_key(line), 9600, baud)
    return memory


def test_nothing_is_in_force_as_long_as_nothing_has_changed() -> None:
    assert list(in_force(plan(), left_behind())) == []


def test_each_value_is_told_with_what_the_config_says_and_how_to_be_rid_of_it() -> None:
    assert list(in_force(plan(), left_behind(("silo-2", 2, 5), baud=19200))) == [
        BaudRemembered(
            "hall-a",
            19200,
            9600,
            "its device changed the rate in an earlier run; set baud = 19200 in gateway.toml:5; "
            "to forget it: modbus-gateway forget silo-1",
        ),
        AddressRemembered(
            "hall-a",
            "silo-2",
            5,
            2,
            "it moved in an earlier run; set unit = 5 in gateway.toml:8; "
            "if it is at 2 again: modbus-gateway forget silo-2",
        ),
    ]


def test_a_config_with_the_same_names_on_another_port_knows_nothing_of_it() -> None:
    elsewhere = plan(HALL.replace("/dev/hall-a", "/dev/hall-b"))
    assert list(in_force(elsewhere, left_behind(("silo-1", 1, 5), baud=19200))) == []


def test_two_devices_can_have_changed_places() -> None:
    memory = left_behind(("silo-1", 1, 2), ("silo-2", 2, 1))
    assert addresses(plan().lines[0], memory) == {"silo-1": (2,), "silo-2": (1,)}


@pytest.mark.parametrize(("north", "south"), [(1, 2), (2, 1)], ids=["new names", "new names and present addresses"])
def test_devices_that_changed_places_and_get_new_names_are_not_asked_until_they_are_forgotten(
    north: int, south: int
) -> None:
    """The config does not tell which of the two is meant: each could have the weight of the other."""
    memory = left_behind(("silo-1", 1, 2), ("silo-2", 2, 1))
    renamed = HALL.replace('unit = 1, as = 41, name = "silo-1"', f'unit = {north}, as = 41, name = "north"')
    edited = plan(renamed.replace('unit = 2, as = 42, name = "silo-2"', f'unit = {south}, as = 42, name = "south"'))
    (line,) = edited.lines
    assert addresses(line, memory) == {"north": (), "south": ()}
    assert [told.device for told in in_force(edited, memory)] == ["north", "south"]
    assert next(in_force(edited, memory)).advice == (
        f"it is not asked: silo-{north} and silo-{south} had changed places, and it may be either; "
        "if the unit in gateway.toml:7 is right: modbus-gateway forget north"
    )
    forget(line, memory, line.devices[0])
    assert addresses(line, memory) == {"north": (north,), "south": (south,)}
    assert list(in_force(edited, memory)) == []


def test_one_device_with_a_new_name_is_where_the_config_says() -> None:
    renamed = plan(HALL.replace("silo-1", "north"))
    assert addresses(renamed.lines[0], left_behind(("silo-1", 1, 5))) == {"north": (1,), "silo-2": (2,)}


@pytest.mark.parametrize("profile", ["weigher", "generic"])
def test_a_new_device_at_the_old_address_of_one_that_was_written_into_the_config_is_asked_there(profile: str) -> None:
    """That one got its present address and a new name in one edit."""
    memory = left_behind(("silo-1", 1, 5))
    north = HALL.replace('unit = 1, as = 41, name = "silo-1"', 'unit = 5, as = 41, name = "north"')
    edited = plan(
        north.replace("devices = [", f'devices = [{{ unit = 1, as = 43, name = "new", profile = "{profile}" }},')
    )
    assert list(in_force(edited, memory)) == []
    assert addresses(edited.lines[0], memory) == {"new": (1,), "north": (5,), "silo-2": (2,)}


def test_a_device_that_may_have_moved_is_at_either_address_and_that_is_told() -> None:
    memory = left_behind(("silo-1", 1, 1, 5))
    assert addresses(plan().lines[0], memory) == {"silo-1": (1, 5), "silo-2": (2,)}
    (told,) = in_force(plan(), memory)
    assert (told.unit, told.configured) == (1, 1)
    assert told.advice == (
        "a change of its address was not answered: it is at 1 or 5, and its next answer settles it; "
        "if it is at 1 again: modbus-gateway forget silo-1"
    )


def test_where_the_config_has_another_device_by_now_neither_is_asked() -> None:
    edited = plan(HALL.replace("unit = 2,", "unit = 5,"))
    (line,) = edited.lines
    assert addresses(line, left_behind(("silo-1", 1, 5))) == {"silo-1": (), "silo-2": ()}
    assert addresses(line, left_behind(("silo-1", 1, 1, 5))) == {"silo-1": (1,), "silo-2": ()}
    told, other = in_force(edited, left_behind(("silo-1", 1, 5)))
    assert other.advice == (
        "it is not asked: silo-1 may be at its address; modbus-gateway forget silo-1, or set its unit in gateway.toml:8"
    )
    assert told.advice == (
        "it is not asked: the config has another device there by now; set its unit in gateway.toml:7; "
        "if it is at 1 again: modbus-gateway forget silo-1"
    )
    told, _ = in_force(edited, left_behind(("silo-1", 1, 1, 5)))
    assert told.advice == (
        "a change of its address was not answered: it is at 1 or 5, and asked at 1 only, as the config has another "
        "device by now; set its unit in gateway.toml:7; if it is at 1 again: modbus-gateway forget silo-1"
    )


def test_of_two_devices_at_one_address_neither_is_asked_there() -> None:
    memory = left_behind(("silo-1", 1, 5), ("silo-2", 2, 7, 5))
    assert addresses(plan().lines[0], memory) == {"silo-1": (), "silo-2": (7,)}


def test_what_no_device_can_have_counts_for_nothing() -> None:
    (line,) = plan().lines
    for unit, baud in ((0, 0), (248, 1), (999, 100_000_000)):
        memory = left_behind(("silo-1", 1, unit), baud=baud)
        assert rate(line, memory) == 9600
        assert addresses(line, memory)["silo-1"] == (1,)


def test_a_device_that_may_have_left_a_reserved_address_may_still_be_there() -> None:
    (line,) = plan(HALL.replace("unit = 1,", "unit = 250,")).lines
    memory = Memory()
    memory.remember(address_key(line, line.devices[0]), 250, 250, 5)
    assert addresses(line, memory)["silo-1"] == (250, 5)
