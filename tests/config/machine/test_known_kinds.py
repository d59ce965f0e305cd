"""What is read of profiles to recognise their kinds."""

import pytest

from gateway.config.machine.known_kinds import kinds_in, known_kinds
from gateway.modbus.codes import Area
from gateway.profiles.identity import Identity, RegisterIdentity
from gateway.profiles.sunspec import Model


def test_the_kinds_of_a_file():
    text = """
[[line]]
port = "/dev/ttyS0"
[profile.meter]
mode = "rtu"
identity = { input = 7, equals = 9 }
[profile.plain]
[profile.inverter]
identity = { sunspec = [1, 103] }
points = [{ name = "n", input = 3 }, { name = "a", holding = "40071-40074" }, { name = "b", holding = 40120 }]
"""
    found = dict(kinds_in(text))
    assert found["plain"] is None
    assert found["meter"] == ("meter", Identity(register=RegisterIdentity(Area.INPUT, 7, 9)), "rtu", ())
    assert found["inverter"].models == (Model(1, 40002, 65), Model(103, 40069, 50))


@pytest.mark.parametrize(
    "text",
    [
        "no TOML",
        "profile = 1",
        "[profile]\nmeter = 1",
        "[profile.meter]\nidentity = 5",
        "[profile.meter]\nidentity = { sunspec = [1] }\npoints = [5]",
        '[profile.meter]\nidentity = { sunspec = [1] }\npoints = [{ holding = "x" }]',
    ],
)
def test_a_file_with_errors_has_no_kinds(text):
    assert [kind for _, kind in kinds_in(text) if kind is not None] == []


def test_the_nearest_of_a_name_counts(tmp_path):
    file = tmp_path / "gateway.toml"
    file.write_text('[profile.weigher]\nidentity = { fc43 = "W" }\n[profile.own]\nidentity = { fc43 = "O" }\n')
    names = {kind.name: kind.identity.fc43 for kind in known_kinds(file)}
    assert (names["weigher"], names["own"]) == ("W", "O")
    assert {kind.name for kind in known_kinds(None)} == names.keys() - {"weigher", "own"}
    assert known_kinds(tmp_path / "missing.toml") == known_kinds(None)
