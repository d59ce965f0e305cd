"""The systemd journal: one datagram for each event, with its fields as journal fields (systemd.journal-fields(7)).

journalctl -u modbus-gateway MODBUS_DEVICE=press
journalctl -u modbus-gateway MODBUS_CLIENT_ADDRESS=10.2.0.7
journalctl -u modbus-gateway MODBUS_EVENT=request_timeout + MODBUS_EVENT=late_response
"""

import logging
import os
import socket
from collections.abc import Mapping
from struct import Struct
from typing import Final

from gateway.observe.backlog import Entry

#: Where systemd-journald listens.
JOURNAL: Final = "/run/systemd/journal/socket"

#: Priorities of syslog(3) for the levels of Python's logging, the most urgent first.
_PRIORITIES: Final = ((logging.CRITICAL, 2), (logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6))
_DEBUG: Final = 7
_LENGTH: Final = Struct("<Q")


def leads_to_journal(descriptor: int, environment: Mapping[str, str] = os.environ) -> bool:
    """Tell whether `descriptor` is connected to the journal: systemd names the stream in JOURNAL_STREAM."""
    try:
        found = os.fstat(descriptor)
    except OSError:
        return False
    return environment.get("JOURNAL_STREAM") == f"{found.st_dev}:{found.st_ino}"


class Journal:
    """Writes entries to the journal. Reconnects after a restart of the journal."""

    def __init__(self, path: str = JOURNAL) -> None:
        self._path = path
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)

    def write(self, entry: Entry) -> None:
        """Write one entry; may block.

        Raises:
            OSError: there is no journal, or it does not accept the entry.
        """
        self._socket.sendto(encode(entry), self._path)


def encode(entry: Entry) -> bytes:
    """Encode an entry as a datagram."""
    texts = {name: _text(value) for name, value in entry.fields.items()}
    message = " ".join([entry.name, *(f"{name}={text}" for name, text in texts.items() if "\n" not in text)])
    fields = {
        "MESSAGE": message,
        "PRIORITY": str(next((priority for level, priority in _PRIORITIES if entry.level >= level), _DEBUG)),
        "SYSLOG_IDENTIFIER": "modbus-gateway",
        "MODBUS_EVENT": entry.name,
        **{f"MODBUS_{name.upper()}": text for name, text in texts.items()},
        **_host(texts.get("client", "")),
    }
    return b"".join(_field(name, text.encode("utf-8", "backslashreplace")) for name, text in fields.items())


def _host(client: str) -> dict[str, str]:
    """Return a client's address without port, because the journal matches whole values. A server line has none."""
    host, _, port = client.rpartition(":")
    return {"MODBUS_CLIENT_ADDRESS": host.strip("[]")} if port.isdecimal() and host else {}


def _text(value: object) -> str:
    return ", ".join(map(str, value)) if isinstance(value, tuple) else str(value)


def _field(name: str, value: bytes) -> bytes:
    """Encode `NAME=value`; a value of several lines is written after its length instead."""
    if b"\n" not in value:
        return name.encode() + b"=" + value + b"\n"
    return name.encode() + b"\n" + _LENGTH.pack(len(value)) + value + b"\n"
