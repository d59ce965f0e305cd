"""Records that are on the disk once `write` returns: a snapshot of all, and a log of what was written since.

The log has a fixed size. A commit is written over pages of an earlier generation, which costs the disk a block and
nothing else: neither the size of the file nor its place changes. When the log is full, the next commit becomes a new
snapshot. Reading finds what is damaged or missing, except a last commit that the disk reported as written but was not.

All calls block.
"""

import errno
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, suppress
from datetime import UTC, datetime
from pathlib import Path
from threading import Lock
from typing import IO, Final, NamedTuple

from gateway.errors import StateError
from gateway.state import files, pages

#: Pages of the log.
PAGES: Final = 256
SIZE: Final = PAGES * pages.PAGE
#: No file may be longer, in bytes. Forty full images fit; with more values, memory runs out first.
LONGEST: Final = 128 << 20


class Content(NamedTuple):
    """The records of a log, the latest last. `damage` says what is wrong with it, in words; empty if nothing is."""

    records: tuple[bytes, ...]
    damage: str = ""


class PageLog:
    """The files `NAME.snapshot` and `NAME.log` for the path `name`. No second process can write them meanwhile."""

    def __init__(self, name: Path) -> None:
        self.snapshot = Path(f"{name}.snapshot")
        self.log = Path(f"{name}.log")
        self._lock_file = Path(f"{name}.lock")
        self._lock: IO[bytes] | None = None
        self._turn = Lock()
        self._descriptor = -1
        self._generation = self._commit = 0
        #: Where in the log the next commit belongs; at its end, a snapshot is due.
        self._at = SIZE
        self._is_new = self._has_log = False
        #: Copies of damaged files, which are written before anything else.
        self._set_aside: dict[Path, bytes] = {}

    def open(self) -> Content:
        """Read all records. Nothing is written yet.

        Raises:
            StateError: another process has it open, or a later version has written it.
            OSError: it cannot be read, or is too long.
        """
        with ExitStack() as unless_read:
            unless_read.callback(self.close)
            with suppress(OSError):  # it may still be read; the first write raises the error
                self._hold()
            content = self._read({file: _read(file) for file in (self.snapshot, self.log)})
            unless_read.pop_all()
        return content

    def write(self, records: Iterable[bytes], everything: Callable[[], Iterable[bytes]]) -> None:
        """Write all of the records or none; they are on the disk on return. `everything` includes them.

        Raises:
            OSError: it cannot be written, or would be too long. A later start may or may not find the records.
            StateError: another process has it open.
        """
        with self._turn:
            data = pages.encode(self._generation, self._commit + 1, records)
            if self._at + len(data) > SIZE:
                self._begin_anew(everything())
                return
            at, self._at = self._at, SIZE  # if it fails, a snapshot follows
            if os.pwrite(self._descriptor, data, at) < len(data):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.log))
            os.fdatasync(self._descriptor)
            self._commit += 1
            self._at = at + len(data)

    def close(self) -> None:
        """Close the files."""
        with self._turn:
            if self._descriptor >= 0:
                os.close(self._descriptor)
            if self._lock is not None:
                self._lock.close()
            self._descriptor, self._lock = -1, None

    def _read(self, contents: dict[Path, bytes | None]) -> Content:
        there = {file: content for file, content in contents.items() if content is not None}
        try:
            found = pages.read(*there.values())
        except StateError as error:
            raise StateError(f"{self.log}: {error}") from None
        damage = "; ".join(self._damage(found, contents))
        if damage:
            aside = f"{datetime.now(UTC):%Y%m%d-%H%M%S}"
            self._set_aside = {file.with_name(f"{file.name}.{aside}"): content for file, content in there.items()}
            damage += f"; copies of the files have the ending .{aside}"
        self._generation = found.generation
        self._is_new = not there
        self._has_log = bool(there) and not damage
        # The last commit may be incomplete: it was being written when power failed, and was never acknowledged.
        whole = [commit for commit in sorted(found.commits) if commit == 0 or found.is_whole(commit)]
        return Content(tuple(record for commit in whole for record in found.records(commit)), damage)

    def _damage(self, found: pages.Found, contents: Mapping[Path, bytes | None]) -> Iterator[str]:
        if found.half:
            yield f"pages with one damaged copy, of which the other one was used: {found.half}"
        if found.lost:
            yield f"pages that are damaged, and whose content is lost: {found.lost}"
        for file, content in contents.items():
            if content is None and found.generation:
                yield f"{file} is missing"
        log = contents[self.log]
        if log is not None and len(log) != SIZE:
            yield f"{self.log} has {len(log)} bytes instead of {SIZE}"
        if contents[self.snapshot] is not None and not found.is_whole(0):
            yield "the snapshot is incomplete"
        missing = [commit for commit in range(1, max(found.commits, default=0)) if not found.is_whole(commit)]
        if missing:
            yield f"writes that are missing: {len(missing)}"

    def _hold(self) -> None:
        if self._lock is not None:
            return
        try:
            self._lock = files.lock(self._lock_file)
        except BlockingIOError:
            raise StateError(f"{self.log} is in use; is another modbus-gateway running?") from None

    def _begin_anew(self, records: Iterable[bytes]) -> None:
        self._at = SIZE
        snapshot = pages.encode(self._generation + 1, 0, records)
        if len(snapshot) > LONGEST:
            raise OSError(errno.EFBIG, f"{self.snapshot} would have more than {LONGEST} bytes")
        self._hold()
        for file, content in self._set_aside.items():
            files.replace(file, content)
        if self._is_new:  # a snapshot without a log would count as damage
            self._make_log()
        files.replace(self.snapshot, snapshot)
        if not self._has_log:
            self._make_log()
        if self._descriptor < 0:
            self._descriptor = files.open_plainly(self.log, os.O_WRONLY)
            # Else the kernel may have cached it as one piece, and write all of it each time.
            os.posix_fadvise(self._descriptor, 0, 0, os.POSIX_FADV_DONTNEED)
        self._set_aside = {}
        self._generation, self._commit, self._at = self._generation + 1, 0, 0

    def _make_log(self) -> None:
        files.replace(self.log, pages.unused(PAGES))
        self._is_new, self._has_log = False, True


def _read(file: Path) -> bytes | None:
    try:
        content = files.read(file, LONGEST + 1)
    except (FileNotFoundError, NotADirectoryError):
        return None
    if len(content) > LONGEST:
        raise OSError(errno.EFBIG, f"{file} has more than {LONGEST} bytes, more than the gateway writes: move it away")
    return content
