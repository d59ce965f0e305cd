"""What the gateway must not forget over a restart: devices that moved, and lines that changed their rate.

    {"/dev/ttyS1 silo-1": {"configured": 1, "now": 5}, "/dev/ttyS1": {"configured": 9600, "now": 19200}}

An entry holds as long as the config says what it said then: who edits the config knows better.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from gateway.errors import StateError
from gateway.events import Emit
from gateway.service.shared_file import Entries, SharedFile, read_content

FILE_NAME: Final = "addresses.json"
_HIGHEST_RATE: Final = 100_000_000


def state_folder(environment: Mapping[str, str] = os.environ, *, is_root: bool = os.geteuid() == 0) -> Path:
    """Where state is kept: where systemd says, in /var/lib as root, else in the user's own state folder."""
    if given := environment.get("STATE_DIRECTORY"):
        return Path(given.split(":")[0])
    if is_root:
        return Path("/var/lib/modbus-gateway")
    home = environment.get("XDG_STATE_HOME") or Path(environment.get("HOME", "/")) / ".local" / "state"
    return Path(home) / "modbus-gateway"


class Memory:
    """Remembered values, one integer a key. `file` is where they come from."""

    def __init__(self, file: str = "", entries: Entries | None = None) -> None:
        self.file = file
        self._entries = entries or {}

    def recall(self, key: str, configured: int) -> int:
        """The value of `key` now: the remembered one, unless the config has changed since."""
        entry = self._entries.get(key, {})
        now: int = entry.get("now", configured) if entry.get("configured") == configured else configured
        return now

    def remember(self, key: str, configured: int, now: int) -> None:
        """Keep the value of `key`; nothing is kept once it is what the config says."""
        self._entries.pop(key, None)
        if now != configured:
            self._entries[key] = {"configured": configured, "now": now}

    def close(self) -> None:
        """Nothing more is remembered."""


def read_memory(folder: Path) -> Memory:
    """What is remembered in `folder`, to look at.

    Raises:
        StateError: the file is damaged, or cannot be read.
    """
    file = folder / FILE_NAME
    try:
        entries, damage = read_content(file, _is_entry)
    except OSError as error:
        raise StateError(f"{file} cannot be read: {error.strerror}; the gateway starts without it") from error
    if damage:
        raise StateError(
            f"{file} is damaged ({damage}); the gateway moves it aside, and starts with what it could read"
        )
    return Memory(str(file), entries)


class StateFile(Memory):
    """A memory in a file, which follows each change. A damaged one is moved aside: see SharedFile."""

    def __init__(self, folder: Path, emit: Emit) -> None:
        self._shared = SharedFile(folder / FILE_NAME, _is_entry, emit)
        super().__init__(str(self._shared.file), self._shared.read())

    def remember(self, key: str, configured: int, now: int) -> None:
        """See Memory."""
        super().remember(key, configured, now)
        self._shared.change(key, self._entries.get(key))

    def close(self) -> None:
        """Nothing more is remembered; returns when the file has been written."""
        self._shared.close()


def _is_entry(value: object) -> bool:
    return isinstance(value, dict) and all(_is_value(value.get(key)) for key in ("configured", "now"))


def _is_value(value: object) -> bool:
    """Whether it can be an address or a rate."""
    return isinstance(value, int) and 0 <= value <= _HIGHEST_RATE
