"""Where the keys of a table stand, for who is told to change one."""

import pickle

from gateway.config.load import parse
from gateway.config.reading.source import Source, place_of, to_write
from gateway.config.resolve import resolve
from gateway.readconfig.process import ConfigRead
from gateway.readconfig.reader import packed

TEXT = """
[[line]]
name = "hall"
port = "/dev/hall"

baud = 19200
devices = [{ unit = 1, name = "silo" }]

[[line]]
port = "/dev/yard"

[[line.devices]]
name = "crane"
unit = 7
"""


def plan(text=TEXT):
    return resolve(parse(text, port_trouble=lambda _: None).config)


def test_a_key_has_its_own_line_and_one_that_is_not_there_that_of_its_table():
    hall, yard = plan().lines
    assert (hall.line.source, yard.devices[0].source) == ("gateway.toml:2", "gateway.toml:12")
    assert place_of(hall.line.source, "baud") == "gateway.toml:6"
    assert place_of(hall.line.source, "format") == "gateway.toml:2"
    assert place_of(hall.devices[0].source, "unit") == hall.devices[0].source == "gateway.toml:7"
    assert place_of(yard.devices[0].source, "unit") == "gateway.toml:14"


def test_what_is_to_be_written_is_told_line_by_line():
    source = plan().lines[0].line.source
    assert (
        to_write(source, {"baud": "9600", "format": '"8N1"'})
        == 'gateway.toml:6: baud = 9600; gateway.toml:2: format = "8N1"'
    )
    assert to_write(source, {"echo": "true", "wire": '"direct"'}) == 'gateway.toml:2: echo = true and wire = "direct"'
    assert to_write("plant.toml:3", {"baud": "9600"}) == "plant.toml:3: baud = 9600"


def test_places_are_handed_over_to_the_gateway():
    found = plan()
    read = pickle.loads(packed(ConfigRead(found, ())))
    assert place_of(read.plan.lines[0].line.source, "baud") == "gateway.toml:6"
    assert isinstance(pickle.loads(pickle.dumps(found.lines[0].line.source)), Source)
