"""What can be seen of a port without opening it."""

import os
import stat
from pathlib import Path

import pytest

from gateway.config.machine.troubles import port_trouble


def test_a_character_device_that_this_user_may_open_is_no_trouble():
    assert port_trouble("/dev/null") is None


@pytest.mark.parametrize("path", ["/dev/no-such-port", "/dev/null/absent"])
def test_an_absent_port(path):
    assert port_trouble(path) == "there is no such port at the moment"


def test_a_file_is_no_port(tmp_path):
    assert port_trouble(str(tmp_path)) == "is not a serial port"


def test_a_path_that_the_system_refuses():
    assert port_trouble("/dev/" + "x" * 5000) == "cannot be checked: File name too long"


def test_a_port_that_this_user_may_not_open(monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: not mode & os.W_OK)
    assert str(port_trouble("/dev/null")).startswith("this user may not open it: ")


def test_a_port_of_the_group_of_the_service(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    monkeypatch.setattr("gateway.config.machine.troubles.find_group", lambda port: "dialout")
    monkeypatch.setattr(Path, "stat", lambda path: os.stat_result((stat.S_IFCHR | 0o660, *[0] * 9)))
    assert port_trouble("/dev/ttyUSB0") == "this user may not open it, the service may: it is in the group dialout"
