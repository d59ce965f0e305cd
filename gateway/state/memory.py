"""Values that survive a restart: addresses of devices that moved, and rates of lines that changed.

    {"/dev/ttyS1 silo-1": {"configured": 1, "now": 5}, "/dev/ttyS1": {"configured": 9600, "now": 19200}}
    {"/dev/ttyS1 silo-1": {"configured": 1, "now": 1, "maybe": [5]}}

In the second one a change to 5 was sent, and it is not known yet whether it took effect. An entry applies as long as
the configured value is the same: an edited config has priority.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from gateway.errors import StateError
from gateway.events import Emit
from gateway.state.entry_file import Entries, EntryFile, read_content

FILE_NAME: Final = "addresses.json"
_HIGHEST_RATE: Final = 100_000_000


def state_folder(environment: Mapping[str, str] = os.environ, *, is_root: bool = os.geteuid() == 0) -> Path:
    """Return the state folder: set by systemd, in /var/lib for root, else in the user's own state folder."""
    if given := environment.get("STATE_DIRECTORY"):
        return Path(given.split(":")[0])
    if is_root:
        return Path("/var/lib/modbus-gateway")
    home = environment.get("XDG_STATE_HOME") or Path(environment.get("HOME", "/")) / ".local" / "state"
    return Path(home) / "modbus-gateway"


class Memory:
    """Remembered values, one integer for each key, or several possible ones. `file` is their source."""

    def __init__(self, file: str = "", entries: Entries | None = None) -> None:
        self.file = file
        self._entries = entries or {}

    def moved(self, start: str) -> list[tuple[str, tuple[int, ...]]]:
        """List the keys that begin with `start`, each with the configured value and all values that it may have now."""
        return [
            (key, (entry["configured"], entry["now"], *entry.get("maybe", ())))
            for key, entry in self._entries.items()
            if key.startswith(start)
        ]

    def recall(self, key: str, configured: int) -> int:
        """Return the value of `key` now: the remembered one, unless the config has changed since."""
        return self.recall_all(key, configured)[0]

    def recall_all(self, key: str, configured: int) -> tuple[int, ...]:
        """Return all values that `key` may have now, the last known one first."""
        entry = self._entries.get(key)
        if entry is None or entry["configured"] != configured:
            return (configured,)
        return (entry["now"], *entry.get("maybe", ()))

    def remember(self, key: str, configured: int, now: int, *maybe: int) -> None:
        """Remember the value of `key`, and other possible ones; forget it if it is the configured one."""
        self._entries.pop(key, None)
        if maybe:
            self._entries[key] = {"configured": configured, "now": now, "maybe": list(maybe)}
        elif now != configured:
            self._entries[key] = {"configured": configured, "now": now}

    def expect(self, key: str, configured: int) -> None:
        """Forget the value of `key` for good if the config has changed since."""
        entry = self._entries.get(key)
        if entry is not None and entry["configured"] != configured:
            self.remember(key, configured, configured)

    def close(self) -> None:
        """Close the file, if there is one."""


def read_memory(folder: Path) -> Memory:
    """Read the remembered values in `folder`, for display.

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
    """A memory that is written to a file after each change. A damaged file is moved aside: see EntryFile."""

    def __init__(self, folder: Path, emit: Emit) -> None:
        self._shared = EntryFile(folder / FILE_NAME, _is_entry, emit)
        super().__init__(str(self._shared.file), self._shared.read())

    def remember(self, key: str, configured: int, now: int, *maybe: int) -> None:
        """Remember as Memory does, and have it written soon."""
        super().remember(key, configured, now, *maybe)
        self._shared.change(key, self._entries.get(key))

    def close(self) -> None:
        """Wait until all changes are written: see EntryFile.close."""
        self._shared.close()


def _is_entry(value: object) -> bool:
    if not isinstance(value, dict):
        return False
    maybe = value.get("maybe", [])
    return isinstance(maybe, list) and all(map(_is_value, (value.get("configured"), value.get("now"), *maybe)))


def _is_value(value: object) -> bool:
    """Tell whether it can be an address or a rate."""
    return isinstance(value, int) and 0 <= value <= _HIGHEST_RATE
