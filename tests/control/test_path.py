"""A service whose config has moved its control socket is found at the usual place too."""

import pytest

from gateway.control.path import usual_path_leads

SERVICE = {"RUNTIME_DIRECTORY": "/run/modbus-gateway"}


def test_a_service_has_a_link_at_the_usual_place_while_it_runs(tmp_path):
    usual, control = tmp_path / "control.sock", tmp_path / "other.sock"
    usual.symlink_to(tmp_path / "earlier.sock")  # of one that was killed
    with usual_path_leads(usual, control, SERVICE):
        assert usual.readlink() == control
    assert not usual.is_symlink()


@pytest.mark.parametrize(("moved", "environment"), [(False, SERVICE), (True, {})])
def test_others_have_none(tmp_path, moved, environment):
    usual = tmp_path / "control.sock"
    with usual_path_leads(usual, tmp_path / "other.sock" if moved else usual, environment):
        assert list(tmp_path.iterdir()) == []


def test_what_is_there_already_stays(tmp_path):
    usual = tmp_path / "control.sock"
    usual.touch()
    with usual_path_leads(usual, tmp_path / "other.sock", SERVICE):
        assert not usual.is_symlink()
    assert usual.exists()


def test_a_link_that_another_gateway_has_made_meanwhile_stays(tmp_path):
    usual = tmp_path / "control.sock"
    with usual_path_leads(usual, tmp_path / "other.sock", SERVICE):
        usual.unlink()
        usual.symlink_to(tmp_path / "third.sock")
    assert usual.is_symlink()
