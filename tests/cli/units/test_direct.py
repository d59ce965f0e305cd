"""Units on a port of their own, without a gateway: which points they have."""

import argparse

import pytest

from gateway.cli.kit.usage import WrongUsageError
from gateway.cli.units import direct
from gateway.config.profile_files import ProfileFiles

ON_A_PORT = argparse.Namespace(mode=None, tcp=None, timeout=None)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The folder of profiles of this machine."""
    monkeypatch.setattr(direct, "ProfileFiles", lambda: ProfileFiles((tmp_path,)))
    return tmp_path


def test_a_profile_of_this_machine_has_points_too(folder):
    place = direct._Place(ON_A_PORT)
    (folder / "meter.toml").write_text(
        '[profile.meter]\nmode = "ascii"\nfunctions = [3]\npoints = [{ name = "flow", holding = 7 }]\n'
    )
    assert [point.address for point in direct._points("meter", place)] == [7]
    assert (place.mode, place.functions) == ("ascii", frozenset({3}))


def test_a_broken_one_is_told_with_its_place(folder):
    (folder / "meter.toml").write_text("[profile.meter]\nmargin = 0\n")
    with pytest.raises(
        direct.DirectError, match=r"meter\.toml:2:10: error: profile\.meter\.margin: must be at least 1"
    ):
        direct._points("meter", direct._Place(ON_A_PORT))


def test_one_that_is_not_there_is_wrong_usage(folder):
    with pytest.raises(WrongUsageError) as wrong:
        direct._points("weighr", direct._Place(ON_A_PORT))
    assert wrong.value.remedy == 'did you mean "weigher"? modbus-gateway profile list shows all'
