"""What a user hears whom the running gateway does not answer."""

import errno
import json
import socket
from pathlib import Path

import pytest

from gateway import __version__
from gateway.cli import daemon
from gateway.cli.daemon import ask
from gateway.errors import DaemonError

SERVICE = "/run/modbus-gateway/control.sock"


@pytest.fixture
def own(tmp_path, monkeypatch):
    """Where this user's own gateway is, asked before that of the service, which refuses the user."""
    connect = socket.socket.connect

    def refused(sock, path):
        if path == SERVICE:
            raise OSError(errno.EACCES, "Permission denied")
        connect(sock, path)

    monkeypatch.setattr(socket.socket, "connect", refused)
    monkeypatch.setattr(daemon, "_read_config", lambda reasons: [Path(SERVICE)])
    monkeypatch.setattr(daemon, "control_path", lambda config: tmp_path / "control.sock")
    return str(tmp_path / "control.sock")


def test_a_user_without_the_right_is_told_who_has_it(own):
    with pytest.raises(
        DaemonError, match=rf"^only root, the gateway's user and its group may use {SERVICE}: use sudo$"
    ):
        ask("status", None)


def test_a_user_is_answered_by_a_gateway_of_the_same_user(own):
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(own)
        server.listen()
        with daemon._connect(None) as connection:
            assert connection.getpeername() == own


def test_a_gateway_that_does_not_run_is_asked_for(tmp_path):
    with pytest.raises(DaemonError, match=r"control\.sock: No such file or directory\); --control PATH says"):
        ask("status", str(tmp_path / "control.sock"))


def test_a_path_that_is_too_long_for_a_socket_is_said_to_be(tmp_path):
    with pytest.raises(DaemonError, match=r"/x{200}: AF_UNIX path too long\); --control PATH says"):
        ask("status", str(tmp_path / ("x" * 200)))


@pytest.mark.parametrize(
    ("version", "said"),
    [
        ({"version": __version__}, ""),
        (
            {"version": "9.0"},
            f"versions differ: the gateway has 9.0, this command {__version__}: restart the gateway if",
        ),
        ({}, f"versions differ: the gateway has an earlier one, this command {__version__}: restart the gateway if"),
    ],
)
def test_a_daemon_of_another_version_is_told(version, said, capsys):
    """On standard error: what a program reads stays JSON."""
    assert daemon._read_answer(json.dumps({"ok": True, **version}).encode()) == {"ok": True, **version}
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.startswith(said)
    assert bool(told.err) == bool(said)


def test_a_verb_that_an_older_daemon_does_not_have_is_told_with_the_versions(capsys):
    with pytest.raises(DaemonError, match='the gateway says: "verb" must be one of status'):
        daemon._read_answer(b'{"ok": false, "error": "\\"verb\\" must be one of status"}')
    assert "earlier one" in capsys.readouterr().err
