"""The words for the addresses of a device that moved, and the command that forgets them."""

from shlex import quote


def show_addresses(units: tuple[int, ...]) -> str:
    """Format possible addresses: `1 or 5`."""
    return " or ".join(map(str, units))


def forget_command(device: str) -> str:
    """Return the shell command that makes the gateway forget the addresses of a device."""
    return f"modbus-gateway forget {quote(device)}"


def how_to_forget(device: str, configured: int) -> str:
    """Say how to have a device asked at its configured address again."""
    return f"if it is at {configured} again: {forget_command(device)}"
