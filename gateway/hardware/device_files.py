"""The file of a serial port under /dev: whether its port is virtual, who may use it, and what grants that right."""

import grp
from pathlib import Path
from typing import Final

#: Major device numbers of pseudo-terminals (the kernel's devices.txt), which are virtual. `ttyACM` is not: real
#: adapters have that name too.
VIRTUAL_MAJORS: Final = range(136, 144)

#: What gives a user the right to a port, by the port's group; for pseudo-terminals that is tty.
_PERMISSION: Final = {
    "root": "it belongs to root alone; give it to the group dialout: {rule}",
    "tty": "it belongs to the group tty; for a simulated port: chgrp dialout {port}; chmod 660 {port}",
    "dialout": "add the user to the dialout group",
}
_ANOTHER_GROUP: Final = "add the user to the {group} group, the service with SupplementaryGroups={group}"


def find_group(port: str) -> str:
    """Name the group that may use the port: dialout on Debian, uucp elsewhere."""
    try:
        return grp.getgrgid(Path(port).stat().st_gid).gr_name
    except (OSError, KeyError):
        return "dialout"


def advise_on_permission(port: str) -> str:
    """Say what to do if a user may not use the port."""
    group, rule = find_group(port), make_udev_rule(Path(port).resolve().name)
    return _PERMISSION.get(group, _ANOTHER_GROUP).format(port=port, group=group, rule=rule)


def make_udev_rule(name: str) -> str:
    """Make the commands by which /dev/NAME belongs to the group dialout, now and whenever it is plugged in."""
    rule = f'KERNEL=="{name}", GROUP="dialout", MODE="0660"'
    write = f"echo '{rule}' | sudo tee -a /etc/udev/rules.d/70-serial.rules"
    return f"{write}; sudo udevadm control --reload; sudo udevadm trigger --subsystem-match=tty"
