"""What a user hears whom the running gateway does not answer."""

import errno
import socket

import pytest

from gateway.cli.daemon import ask
from gateway.errors import DaemonError


def test_a_user_without_the_right_is_told_who_has_it(monkeypatch):
    def refused(sock, path):
        raise OSError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(socket.socket, "connect", refused)
    with pytest.raises(DaemonError, match=r"only root and the gateway's own user may ask at /run/gw\.sock: use sudo"):
        ask("status", "/run/gw.sock")


def test_a_gateway_that_does_not_run_is_asked_for(tmp_path):
    with pytest.raises(DaemonError, match=r"control\.sock: No such file or directory\); is it running\?"):
        ask("status", str(tmp_path / "control.sock"))
