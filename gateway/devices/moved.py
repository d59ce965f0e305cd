"""How messages name the addresses of a device that moved, and the command that ends what is remembered of it."""

from shlex import quote


def show_addresses(units: tuple[int, ...]) -> str:
    """Show possible addresses: `1 or 5`."""
    return " or ".join(map(str, units))


def forget_command(device: str) -> str:
    """Return the command that ends what is remembered of a device, as a shell takes it."""
    return f"modbus-gateway forget {quote(device)}"


def how_to_forget(device: str, configured: int) -> str:
    """Say how to ask a device that moved where the config says again."""
    return f"if it is at {configured} again: {forget_command(device)}"
