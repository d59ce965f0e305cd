"""What udev is told about a port that belongs to root alone."""


def udev_rule(name: str) -> str:
    """The commands by which /dev/NAME belongs to the group dialout, now and whenever it is plugged in."""
    rule = f'KERNEL=="{name}", GROUP="dialout", MODE="0660"'
    write = f"echo '{rule}' | sudo tee -a /etc/udev/rules.d/70-serial.rules"
    return f"{write}; sudo udevadm control --reload; sudo udevadm trigger --subsystem-match=tty"
