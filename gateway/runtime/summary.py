"""The state of a gateway in one line, as `systemctl status` shows it."""

from typing import Final

from gateway.runtime.gateway import Gateway, Part

#: Its approximate limit in characters: systemd ignores messages longer than 4096 bytes.
_LONGEST: Final = 1000


def summary(gateway: Gateway) -> str:
    """Write the state of the gateway in one line: `3 of 4 lines up, 7 clients; hall-a: /dev/ttyUSB0 does not exist`."""
    troubles = [trouble for part in gateway.parts if (trouble := _trouble(part))]
    count = len(gateway.parts)
    clients = sum(listener.clients for listener in gateway.listeners)
    text = f"{count - len(troubles)} of {count} lines up, {clients} clients"
    for told, trouble in enumerate(troubles):
        if len(text) + len(trouble) > _LONGEST:
            return f"{text}; and {len(troubles) - told} more"
        text += f"; {trouble}"
    return text


def _trouble(part: Part) -> str:
    """Say why a part's port is not open; empty if it is."""
    reconnector = part.reconnector
    if not reconnector.tried.is_set():
        return f"{part.name}: not tried yet"
    return "" if reconnector.error is None else f"{part.name}: {reconnector.error}"
