"""What a user hears whom the running gateway does not answer."""

import errno
import json
import socket
from pathlib import Path

import pytest

from gateway.cli.kit import daemon
from gateway.cli.kit.daemon import Conversation, Meant
from gateway.errors import DaemonError
from gateway.version import __version__

SERVICE = Path("/run/modbus-gateway/control.sock")


@pytest.mark.parametrize(
    ("gateway", "remedy"), [(SERVICE, "use sudo"), (Path("/run/gw.sock"), "use sudo, with --control /run/gw.sock")]
)
def test_a_user_without_the_right_is_told_who_has_it(gateway, remedy, monkeypatch):
    def refused(sock, path):
        raise OSError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(socket.socket, "connect", refused)
    told = f"^only root, the gateway's user and its group may use {gateway}: {remedy}$"
    with pytest.raises(DaemonError, match=told):
        Conversation(Meant(gateway))


def test_a_gateway_that_does_not_run_is_asked_for(tmp_path, monkeypatch):
    monkeypatch.setattr(daemon, "SYSTEM_SOCKET", tmp_path / "none")
    with pytest.raises(DaemonError, match=r"control\.sock: No such file or directory\); --control PATH"):
        Conversation(Meant(tmp_path / "control.sock"))


def test_where_the_gateway_of_the_service_runs_its_socket_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(daemon, "SYSTEM_SOCKET", tmp_path)
    with pytest.raises(
        DaemonError, match=rf"--config FILE names another one, and --control {tmp_path} that of the service$"
    ):
        Conversation(Meant(tmp_path / "control.sock"))


def test_a_path_that_is_too_long_for_a_socket_is_said_to_be(tmp_path):
    with pytest.raises(DaemonError, match=r"/x{200}: AF_UNIX path too long\); "):
        Conversation(Meant(tmp_path / ("x" * 200)))


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
