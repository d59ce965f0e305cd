"""What a user hears whom the running gateway does not answer."""

import errno
import socket
from pathlib import Path

import pytest

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
    monkeypatch.setattr(daemon, "_configured", lambda reasons: [Path(SERVICE)])
    monkeypatch.setattr(daemon, "control_path", lambda config: tmp_path / "control.sock")
    return str(tmp_path / "control.sock")


def test_a_user_without_the_right_is_told_who_has_it(own):
    with pytest.raises(DaemonError, match=rf"^only root and the gateway's own user may ask at {SERVICE}: use sudo$"):
        ask("status", None)


def test_a_user_is_answered_by_a_gateway_of_the_same_user(own):
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(own)
        server.listen()
        with daemon._connected(None) as connection:
            assert connection.getpeername() == own


def test_a_gateway_that_does_not_run_is_asked_for(tmp_path):
    with pytest.raises(DaemonError, match=r"control\.sock: No such file or directory\); is it running\?"):
        ask("status", str(tmp_path / "control.sock"))
