"""What an operator hears who may not use a port."""

import pytest

from gateway.hardware import device_files
from gateway.hardware.device_files import advise_on_permission


@pytest.mark.parametrize(
    ("group", "remedy"),
    [
        ("dialout", "add the user to the dialout group"),
        ("uucp", "add the user to the uucp group, the service with SupplementaryGroups=uucp"),
        (
            "root",
            (
                """it belongs to root alone; give it to the group dialout: echo 'KERNEL=="plc", GROUP="dialout", """
                """MODE="0660"' | sudo tee -a /etc/udev/rules.d/70-serial.rules; """
                "sudo udevadm control --reload; sudo udevadm trigger --subsystem-match=tty"
            ),
        ),
        (
            "tty",
            "it belongs to the group tty; for a simulated port: chgrp dialout /run/plc; chmod 660 /run/plc",
        ),
    ],
)
def test_the_remedy_fits_the_group_of_the_port(group, remedy, monkeypatch):
    monkeypatch.setattr(device_files, "find_group", lambda port: group)
    assert advise_on_permission("/run/plc") == remedy
