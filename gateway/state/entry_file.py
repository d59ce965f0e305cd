"""A JSON file of one gateway in the state folder: entries by key, each written as soon as it changes.

A change that cannot be written is tried again until it succeeds. A damaged file is moved aside, and its copy is used,
else what can be read of both: without its entry, a device that moved is asked at its old address, where another one may
be by now. So the damaged file also stays where it is until a sound one takes its place: a copy alone is not used,
because deleting the file means that all is to be forgotten. Each entry has a checksum: with a flipped bit, an address
could belong to another device.
"""

import json
import time
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from threading import Condition, Thread
from typing import Any, Final, NamedTuple
from zlib import crc32

from gateway.events import Emit, StateDamaged
from gateway.state import files
from gateway.state.file_trouble import FileTrouble

#: How long `close` waits for a change to be written, in seconds from the change: files that were changed together are
#: waited for together.
CLOSING_DEADLINE: Final = 1.0
#: The pause before a failed write is repeated, in seconds.
PAUSE: Final = 2.0
#: The key of the checksums by the keys of the entries. Earlier versions wrote none.
_SUMS: Final = "check sums"
#: A larger file counts as damaged, in bytes.
_LARGEST: Final = 1 << 20

Entries = dict[str, Any]
IsEntry = Callable[[object], bool]


class Content(NamedTuple):
    """The entries of a file that could be read, and what was wrong with it, in words; empty if nothing was."""

    entries: Entries
    damage: str = ""


class EntryFile:
    """Entries by key; `is_entry` says whether one is well-formed.

    A thread writes the changes; those that arrive during a write are written together. An event tells when writing
    begins to fail, and when it succeeds again.
    """

    def __init__(self, file: Path, is_entry: IsEntry, emit: Emit) -> None:
        self.file = file
        self._is_entry = is_entry
        self._emit = emit
        #: The content of the file as last known.
        self._entries: Entries = {}
        self._guard = Condition()
        self._changes: Entries = {}
        self._changed_at = 0.0
        self._writer: Thread | None = None
        self._trouble = FileTrouble(file, emit)
        self._closing = False
        #: Whether the damaged file, which is still there, has another name already.
        self._is_set_aside = False

    def read(self) -> Entries:
        """Read all entries; none if there is no file, or it cannot be read, which is logged."""
        damage = ""
        try:
            self._entries, damage = content = read_content(self.file, self._is_entry)
            if damage:
                self._set_aside(content)
                for key, entry in content.entries.items():
                    self.change(key, entry)
        except OSError as error:
            what = f"{damage}; it cannot be moved aside" if damage else "it cannot be read"
            self._emit(StateDamaged(str(self.file), f"{what}: {error.strerror}"))
        return dict(self._entries)

    def change(self, key: str, entry: object | None) -> None:
        """Write an entry soon; None deletes it."""
        with self._guard:
            self._changes[key] = entry
            self._changed_at = time.monotonic()
            self._closing = False
            if self._writer is None:
                self._writer = Thread(target=self._write, name=f"write {self.file.name}", daemon=True)
                self._writer.start()

    def close(self) -> None:
        """Wait until all changes are written, for CLOSING_DEADLINE at most. Failed ones are tried once more."""
        with self._guard:
            writer, since = self._writer, time.monotonic() if self._trouble.reason else self._changed_at
            self._closing = True
            self._guard.notify()
        if writer is not None:
            writer.join(max(0.0, since + CLOSING_DEADLINE - time.monotonic()))
            if writer.is_alive():
                self._trouble.tell("the disk takes too long")

    def _write(self) -> None:
        while changes := self._next():
            try:
                self._replace(changes)
            except Exception as error:  # noqa: BLE001 - the writer must survive for later changes
                self._trouble.failed(error)
                if not self._may_try_again(changes):
                    return
            else:
                self._trouble.tell("")

    def _next(self) -> Entries:
        with self._guard:
            changes, self._changes = self._changes, {}
            if not changes:
                self._writer = None
            return changes

    def _may_try_again(self, changes: Entries) -> bool:
        """Wait until failed `changes` are to be tried again; False when the gateway is stopping."""
        with self._guard:
            self._changes = changes | self._changes
            if not self._closing:
                self._guard.wait(PAUSE)
                return True
            self._writer = None
            return False

    def _replace(self, changes: Entries) -> None:
        """Write the changes into the file; an entry that was removed from it by hand stays removed.

        Raises:
            OSError: it cannot be read or written, or another gateway writes it now.
        """
        with files.lock(self.file.with_name(f"{self.file.name}.lock")):
            self._replace_alone(changes)

    def _replace_alone(self, changes: Entries) -> None:
        content = read_content(self.file, self._is_entry)
        entries = content.entries
        if content.damage:
            self._set_aside(content)
            entries = self._entries | entries
        self._entries = {key: entry for key, entry in (entries | changes).items() if entry is not None}
        sums = {_SUMS: {key: _check_sum(key, entry) for key, entry in self._entries.items()}} if self._entries else {}
        data = f"{json.dumps(self._entries | sums, indent=2)}\n".encode()
        for file in (_copy_of(self.file), self.file):  # in this order the copy is never older
            files.replace(file, data)
        self._is_set_aside = False

    def _set_aside(self, content: Content) -> None:
        """Keep a damaged file under another name, once. With entries left, it also stays until it is replaced.

        Raises:
            OSError: it cannot be renamed.
        """
        if self._is_set_aside:
            return
        aside = self.file.with_name(f"{self.file.name}.{datetime.now(UTC):%Y%m%d-%H%M%S-%f}")
        try:
            if content.entries or self._entries:
                aside.hardlink_to(self.file)
                self._is_set_aside = True
            else:
                self.file.rename(aside)
        except PermissionError:  # a file system without links
            self.file.rename(aside)
        left = f"{len(content.entries)} entries could be read"
        self._emit(StateDamaged(str(self.file), f"{content.damage}; {left}; it is now {aside}"))


def read_content(file: Path, is_entry: IsEntry) -> Content:
    """Read a file, and its copy if the file is damaged; empty if it does not exist.

    Raises:
        OSError: it cannot be read.
    """
    content = _read(file, is_entry)
    if content.damage:
        with suppress(OSError):
            copy = _read(_copy_of(file), is_entry)
            entries = copy.entries | content.entries if copy.damage else copy.entries or content.entries
            return Content(entries, content.damage)
    return content


def _copy_of(file: Path) -> Path:
    return file.with_name(f"{file.name}.copy")


def _read(file: Path, is_entry: IsEntry) -> Content:
    try:
        entries = json.loads(files.read(file, _LARGEST), object_pairs_hook=_without_doubles)
    except FileNotFoundError:
        return Content({})
    except (ValueError, RecursionError) as error:
        return Content({}, f"it is not valid JSON ({error})")
    if not isinstance(entries, dict):
        return Content({}, "it is not a file of this gateway")
    sums = entries.pop(_SUMS, None)
    sound = {
        key: entry
        for key, entry in entries.items()
        if is_entry(entry) and (sums is None or (isinstance(sums, dict) and sums.get(key) == _check_sum(key, entry)))
    }
    if len(sound) < len(entries):
        return Content(sound, f"{len(entries) - len(sound)} of {len(entries)} entries are not valid")
    return Content(sound)


def _check_sum(key: str, entry: object) -> int:
    return crc32(json.dumps([key, entry], sort_keys=True).encode())


def _without_doubles(pairs: list[tuple[str, Any]]) -> Entries:
    entries = dict(pairs)
    if len(entries) < len(pairs):
        raise ValueError("a key occurs twice")
    return entries
