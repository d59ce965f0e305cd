"""What devices are called."""

from gateway.config.plan.names import all_device_names
from gateway.config.schema.line import Line


def test_a_device_without_a_name_is_called_after_its_line_and_unit():
    line = Line.model_validate({"name": "hall-a", "port": "/dev/x", "devices": [{"unit": 7, "as": 17}, {"unit": 8}]})
    assert all_device_names(line) == ["hall-a/17", "hall-a/8"]


def test_a_star_in_a_name_becomes_the_unit_that_clients_use():
    line = Line.model_validate(
        {
            "port": "/dev/x",
            "devices": [{"unit": "10-11", "as": "110-111", "name": "drive-*"}, {"unit": 5, "name": "fan"}],
        }
    )
    assert all_device_names(line) == ["drive-110", "drive-111", "fan"]


def test_every_device_of_a_line_that_passes_through_has_a_name():
    names = all_device_names(Line.model_validate({"name": "hall-a", "port": "/dev/x"}))
    assert (names[0], names[-1], len(names)) == ("hall-a/1", "hall-a/247", 247)
