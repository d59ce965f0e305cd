"""What the gateway must not forget over a restart: devices that moved, and lines that changed their rate.

    {"/dev/ttyS1 silo-1": {"configured": 1, "now": 5}, "/dev/ttyS1": {"configured": 9600, "now": 19200}}

An entry holds as long as the config says what it said then: who edits the config knows better.
"""

import json
import os
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from fcntl import LOCK_EX, flock
from pathlib import Path
from typing import Final

from gateway.errors import StateError
from gateway.events import Emit, StateNotKept
from gateway.ports.ownership import give_to_owner_of_folder

FILE_NAME: Final = "whereabouts.json"

Entries = dict[str, dict[str, int]]


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
        return entry.get("now", configured) if entry.get("configured") == configured else configured

    def remember(self, key: str, configured: int, now: int) -> None:
        """Keep the value of `key`; nothing is kept once it is what the config says."""
        self._entries.pop(key, None)
        if now != configured:
            self._entries[key] = {"configured": configured, "now": now}

    def close(self) -> None:
        """Nothing more is remembered."""


def kept_in(folder: Path) -> Memory:
    """What is remembered in `folder`, to look at.

    Raises:
        StateError: the file is there and cannot be read.
    """
    file = folder / FILE_NAME
    return Memory(str(file), _read(file))


class StateFile(Memory):
    """A memory in a file, which is written anew by a thread with each change. A failure is told, and serving goes on.

    Several gateways may share a file: each changes its own entries only.

    Raises:
        StateError: the file is there and cannot be read.
    """

    def __init__(self, folder: Path, emit: Emit) -> None:
        self._file = folder / FILE_NAME
        super().__init__(str(self._file), _read(self._file))
        self._emit = emit
        self._writer = ThreadPoolExecutor(max_workers=1, thread_name_prefix="state")

    def remember(self, key: str, configured: int, now: int) -> None:
        """See Memory; the file follows."""
        super().remember(key, configured, now)
        self._writer.submit(_change, self._file, key, self._entries.get(key)).add_done_callback(self._written)

    def close(self) -> None:
        """Nothing more is remembered; returns when the file has been written."""
        self._writer.shutdown()

    def _written(self, writing: Future[None]) -> None:
        error = writing.exception()
        if error is not None:
            self._emit(StateNotKept(str(self._file), getattr(error, "strerror", None) or str(error)))


def _read(file: Path) -> Entries:
    try:
        entries = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise StateError(f"{file} cannot be read ({error}); move it away to start without it") from error
    if not isinstance(entries, dict) or not all(map(_is_entry, entries.values())):
        raise StateError(f"{file} is not a file of this gateway; move it away to start without it")
    return entries


def _is_entry(value: object) -> bool:
    return isinstance(value, dict) and all(isinstance(value.get(key), int) for key in ("configured", "now"))


def _change(file: Path, key: str, entry: dict[str, int] | None) -> None:
    """Change one entry; None takes it out. Others that were written meanwhile stay."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.with_suffix(".lock").open("w") as lock:
        give_to_owner_of_folder(Path(lock.name))
        flock(lock, LOCK_EX)
        entries = _read(file)
        entries.pop(key, None)
        if entry is not None:
            entries[key] = entry
        _write(file, json.dumps(entries, indent=2) + "\n")


def _write(file: Path, text: str) -> None:
    fresh = file.with_suffix(".new")
    with fresh.open("w", encoding="utf-8") as stream:
        stream.write(text)
        stream.flush()
        os.fsync(stream.fileno())
    give_to_owner_of_folder(fresh)
    fresh.replace(file)
